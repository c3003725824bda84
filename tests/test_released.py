"""Files of releases: this version reads them all, and answers what the release answered."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from released import ANSWERS, FOLDER, answer

RELEASES = sorted(path.name for path in FOLDER.iterdir())


def _holds(expected: Any, found: Any) -> bool:
    """Whether all that was answered still is; there may be more keys, and more checks that hold."""
    if isinstance(expected, dict):
        return all(key in found and _holds(value, found[key]) for key, value in expected.items())
    if isinstance(expected, list) and all(isinstance(each, dict) for each in expected):
        named = {each.get("name"): each for each in found}
        return all(_holds(each, named.get(each.get("name"), {})) for each in expected)
    return bool(expected == found)


@pytest.mark.slow
@pytest.mark.parametrize("release", RELEASES)
def test_files_of_a_release_give_the_answers_that_they_gave(release: str, tmp_path: Path) -> None:
    """Recordings of every format, moves, cubes, a certificate and a proof."""
    folder = shutil.copytree(FOLDER / release, tmp_path / release)
    answers = json.loads((folder / ANSWERS).read_text())
    assert answers
    for command, expected in answers.items():
        found = answer(command, folder)
        assert _holds(expected, found), (command, expected, found)


def test_every_format_that_is_promised_has_a_file() -> None:
    """Each that docs/files.md names has one, in the newest release."""
    page = (Path(__file__).parent.parent / "docs" / "files.md").read_text()
    promised = page.partition("## Versions")[2].partition("\n## ")[0]
    formats = re.findall(r"`(cubepath[- ][a-z]+[- ]\d+)`", promised)
    assert len(formats) == 8
    held = b"".join(path.read_bytes() for path in (FOLDER / RELEASES[-1]).iterdir())
    for name in formats:
        assert name.encode() in held or name.encode("utf-32-le") in held  # numpy's texts
