"""The gallery of the site: for each system in `gallery.toml` a run, its picture and its page.

All are made when the site is built, and kept in the folder of the site: a second build draws only
entries that changed. Delete the folder when the code did.
"""

import contextlib
import html
import io
import tempfile
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cubepath.coordinator.commands.main import main

SHOWN = Path(__file__).with_name("gallery.toml")
_STYLE = """<style>
.gallery {display: grid; gap: 1.2rem; grid-template-columns: repeat(auto-fill, minmax(14rem, 1fr))}
.gallery figure {margin: 0}
.gallery img {aspect-ratio: 1; background: white; object-fit: contain; width: 100%}
.gallery code {font-size: 0.7rem; overflow-wrap: anywhere}
.gallery p {font-size: 0.85rem; margin: 0.2rem 0}
</style>
"""


def shown() -> list[Mapping[str, Any]]:
    """Return the entries of the gallery, in their order."""
    entries: list[Mapping[str, Any]] = tomllib.loads(SHOWN.read_text("utf-8"))["shown"]
    return entries


def name_of(entry: Mapping[str, Any]) -> str:
    """Return the system's name without its keys, which is the name of its files."""
    return str(entry["system"]).partition(":")[0]


def command_of(entry: Mapping[str, Any]) -> list[str]:
    """Return the words of the command that the gallery prints.

    >>> command_of({"system": "arm:n=12", "cube": 11})
    ['run', 'arm:n=12']
    """
    verb = "run" if "cube" in entry else "complex"
    return [verb, entry["system"], *entry.get("options", ())]


def draw(entry: Mapping[str, Any], folder: Path) -> None:
    """Play an entry, and write its picture NAME.png and, of a run, its page NAME.html.

    RuntimeError if a command fails, or if the picture is of no cube of the run.
    """
    picture = folder / f"{name_of(entry)}.png"
    if "cube" not in entry:
        _call(*command_of(entry), "-o", str(picture))
        return
    with tempfile.TemporaryDirectory() as work:
        log = f"{work}/run.mcap"
        _call(*command_of(entry), "--processes=0", "--log", log)
        drawn = ("--what=schedule", f"--rounds={entry['cube']}", "--parts=states")
        _call("view", log, *drawn, "-o", str(picture))
        _call("view", log, "-o", str(picture.with_suffix(".html")))


def _call(*words: str) -> None:
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(words)
    if code:
        raise RuntimeError(f"cubepath {' '.join(words)}: exit code {code}\n{said.getvalue()}")


def grid(site: Path) -> str:
    """Return the gallery as HTML; first draw what the folder `site` does not have yet."""
    folder = site / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    lines = [_STYLE, '<div class="gallery">']
    for entry in shown():
        name, made = name_of(entry), folder / f"{name_of(entry)}.txt"
        if not made.exists() or made.read_text("utf-8") != repr(entry):
            draw(entry, folder)
            made.write_text(repr(entry), "utf-8")
        page = f"gallery/{name}.html" if "cube" in entry else f"gallery/{name}.png"
        command = html.escape(" ".join(["cubepath", *command_of(entry)]))
        lines += [
            f'<figure><a href="{page}"><img src="gallery/{name}.png" alt="{name}"></a>',
            f"<p>{html.escape(entry['says'])}</p>",
            f"<code>{command}</code></figure>",
        ]
    return "\n".join([*lines, "</div>\n"])
