"""What ``cubepath view`` does for a browser: a page of one run, or of two beside each other."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from itertools import accumulate, chain, pairwise
from operator import add
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from cubepath.coordinator.commands.console import complain, progress_bar
from cubepath.protocol.core.errors import CubepathError

if TYPE_CHECKING:  # a command starts faster without them
    from cubepath.coordinator.normal_form.array_heap import NormalForm
    from cubepath.coordinator.tools.viewing.run_view import RunView
    from cubepath.protocol.core.actions import Action
    from cubepath.protocol.core.system import Scene
    from cubepath.protocol.recordings.recording import Recording


Mark: TypeAlias = tuple[int, str]
"""A step, from 1, and what the time axis says of it."""
_RESULTS = ("cube", "summary")
"""Messages of the coordinator about the whole run, which belong to no round."""


class DrawingInput(NamedTuple):
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


def write_page(drawn: Sequence[DrawingInput], path: Path) -> None:
    """Write a page that shows these, with a bar that names the part at work."""
    from cubepath.coordinator.tools.viewing.pages import run_page  # noqa: PLC0415 - only what is needed

    with progress_bar(None, "page", "") as bar:
        names = _names([each.source for each in drawn]) if len(drawn) > 1 else [""]
        marks = [_branches(each) for each in drawn]
        if len(drawn) > 1:
            bar.set_postfix_str("differences")
            marks = list(map(add, marks, _differences(drawn)))
        shown = [
            _shown(each, name, own) for each, name, own in zip(drawn, names, marks, strict=True)
        ]
        run_page(shown, path, progress=bar.set_postfix_str)


def _names(sources: Sequence[Path]) -> list[str]:
    """Return names that tell the inputs apart: short ones if these do."""
    stems = [source.stem for source in sources]
    return stems if len(set(stems)) == len(stems) else [str(source) for source in sources]


def _branches(drawn: DrawingInput) -> list[Mark]:
    """Return where a what-if departs from the recording that it goes on from."""
    if drawn.recording is None:
        return []
    from cubepath.coordinator.verification.parameters import spans, stages_in  # noqa: PLC0415

    stages = stages_in(drawn.recording)
    everyone = spans(range(len(drawn.scene.start)))
    found: list[Mark] = []
    for before, stage in pairwise(stages):
        rules = [
            rule if modules == everyone else f"{rule} for modules {modules}"
            for rule, modules in stage.rules.items()
        ]
        seed = "" if stage.seed == before.seed else f", seed {stage.seed}"
        found.append((stage.begins, f"what if {' and '.join(rules)}{seed}"))
    return found


def _differences(both: Sequence[DrawingInput]) -> list[list[Mark]]:
    """Return for each of two runs where they differ first, as `cubepath diff` finds it."""
    from cubepath.coordinator.tools.comparison.comparing import diff  # noqa: PLC0415
    from cubepath.coordinator.tools.comparison.moves import first_other  # noqa: PLC0415

    a, b = (each.recording for each in both)
    if a is None or b is None:
        place = first_other(*(list(chain.from_iterable(each.steps)) for each in both))
        return [_of_move(each, place) for each in both]
    try:
        found = diff(a, b)
    except CubepathError as error:
        complain(f"the differences are not marked: {error}")
        return [[], []]
    if found.clock == "moves":
        place = None if found.move is None else found.move.round - 1
        return [_of_move(each, place) for each in both]
    kinds: dict[tuple[int, int | None], list[str]] = {}
    message = found.message
    if message is not None and message.kind in _RESULTS:
        message = None
    for kind, each in (("choice", found.choice), ("message", message), ("move", found.move)):
        if each is not None:
            kinds.setdefault((each.round, each.module), []).append(kind)
    marks = [
        (step, f"first difference: {_listed(what)}" + ("" if who is None else f" of module {who}"))
        for (step, who), what in kinds.items()
    ]
    return [[mark for mark in marks if mark[0] <= len(each.steps)] for each in both]


def _of_move(drawn: DrawingInput, place: int | None) -> list[Mark]:
    """Return the mark of the first move that differs, by its number in the path, from 0."""
    if place is None or place >= sum(map(len, drawn.steps)):
        return []
    step = bisect_right(list(accumulate(map(len, drawn.steps))), place) + 1
    return [(step, "first difference: move")]


def _listed(words: Sequence[str]) -> str:
    return " and ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def _shown(drawn: DrawingInput, name: str, marks: Sequence[Mark]) -> RunView:
    from cubepath.coordinator.tools.viewing.run_view import RunView  # noqa: PLC0415

    cubes, found = drawn.schedule()
    return RunView(
        drawn.scene,
        drawn.steps,
        cubes,
        found,
        drawn.step_name,
        name,
        drawn.recording,
        _facts(drawn, cubes),
        drawn.chain,
        marks,
    )


def _facts(drawn: DrawingInput, cubes: Sequence[Sequence[Action]]) -> tuple[tuple[str, str], ...]:
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
