"""What ``cubepath view`` does for a browser: a page of one run, or of two beside each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from cubepath.coordinator.commands.progress import progress_bar

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.normal_form.array_heap import NormalForm
    from cubepath.coordinator.viewing.shown import Shown
    from cubepath.protocol.core.actions import Action
    from cubepath.protocol.core.system import Scene
    from cubepath.protocol.recordings.recording import Recording


class Drawn(NamedTuple):
    """The input of a drawing; the schedule is computed when it is asked for."""

    source: Path
    scene: Scene
    step_name: str
    steps: Sequence[Sequence[Action]]
    schedule: Callable[[], tuple[Sequence[Sequence[Action]], NormalForm]]
    unsolved: str | None = None
    recording: Recording | None = None
    chain: Sequence[int] | None = None
    """Of a certificate, whose schedule it then is: the chain that proves it, by places in it."""


def write_page(drawn: Sequence[Drawn], path: Path) -> None:
    """Write a page that shows these, with a bar that names the part at work."""
    from cubepath.coordinator.viewing.pages import run_page  # noqa: PLC0415 - only what is needed

    with progress_bar(None, "page", "") as bar:
        names = _names([each.source for each in drawn]) if len(drawn) > 1 else [""]
        shown = [_shown(each, name) for each, name in zip(drawn, names, strict=True)]
        run_page(shown, path, progress=bar.set_postfix_str)


def _names(sources: Sequence[Path]) -> list[str]:
    """Return names that tell the inputs apart: short ones if these do."""
    stems = [source.stem for source in sources]
    return stems if len(set(stems)) == len(stems) else [str(source) for source in sources]


def _shown(drawn: Drawn, name: str) -> Shown:
    from cubepath.coordinator.viewing.shown import Shown  # noqa: PLC0415

    cubes, found = drawn.schedule()
    return Shown(
        drawn.scene,
        drawn.steps,
        cubes,
        found,
        drawn.step_name,
        name,
        drawn.recording,
        _facts(drawn, cubes),
        drawn.chain,
    )


def _facts(drawn: Drawn, cubes: Sequence[Sequence[Action]]) -> tuple[tuple[str, str], ...]:
    """Return what the head of a page says: the rule and its seed, and the counts of both paths."""
    known = {} if drawn.recording is None else drawn.recording.parameters
    facts = [(key, known[key]) for key in ("rule", "seed") if key in known]
    moves, left = sum(map(len, drawn.steps)), sum(map(len, cubes))
    given = [] if drawn.step_name == "move" else [_counted(len(drawn.steps), drawn.step_name)]
    before = ", ".join([*given, _counted(moves, "move")])
    after = f"{_counted(len(cubes), 'cube')}, {_counted(left, 'move')}"
    largest = max(map(len, cubes), default=0)
    facts.append(("", f"{before} \N{RIGHTWARDS ARROW} {after}, largest cube {largest}"))
    if drawn.chain is not None:
        facts.append(
            ("", f"proved: no schedule in the class has fewer than {_counted(len(cubes), 'cube')}")
        )
    return tuple(facts)


def _counted(count: int, what: str) -> str:
    return f"{count:,} {what}" + ("" if count == 1 else "s")
