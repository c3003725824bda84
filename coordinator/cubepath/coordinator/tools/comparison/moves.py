"""Two runs read round by round, and their edge paths as a whole.

Messages stand in the order of arrival, and in batches as modules were dealt out to processes; a
round holds each message of a module once, whatever process sent it. Paths are compared in the same
rounds, up to swapping, and up to cancelling.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Set as AbstractSet
from dataclasses import replace
from itertools import islice, zip_longest
from math import inf
from typing import Any

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.gathering import gathered
from cubepath.coordinator.shortening.path_input import (
    PathInput,
    hints_for_each,
    read_input,
    starts_to_compare,
)
from cubepath.coordinator.tools.comparison.results import (
    MoveDifference,
    PathComparison,
    RunComparison,
)
from cubepath.coordinator.verification.choices import Moment
from cubepath.coordinator.verification.dependencies import difference, label_of
from cubepath.coordinator.verification.round_spans import Span, add_to_spans
from cubepath.coordinator.verification.transcript import (
    RECOVERED,
    RecordedRound,
    Sorting,
    Transcript,
    is_cut_off,
)
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import InputFile, opened
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.file_forms import PlanHints, form_of
from cubepath.protocol.path_files.moves import is_by_generator
from cubepath.protocol.recordings.cutting import FILTERED, SPLIT, whole_of
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Report, decode

ODD_MAX = 3
"""This many lines on what is odd with a recording are kept."""


class Contradiction(Exception):  # noqa: N818 - a state of affairs, not an error
    """A recording says two things that cannot both be; the text says where."""


class Reading:
    """Reads a recording round by round, of which it holds those in progress."""

    def __init__(self, recording: Recording, *, in_order: bool, first: int | None = None) -> None:
        """Begin before the first message; without `in_order` all rounds are kept to the end.

        `first` is the first whole round, None if that is not known yet.
        """
        self.recording = recording
        self.cut = cut_text(recording)
        """What it was cut from, in words; None if it was not cut."""
        self.partial = (
            self.cut is not None
            or bool(recording.problems)
            or is_cut_off(recording)
            or ATTACHED in recording.parameters
        )
        """Whether rounds, or messages, can be missing that the run had."""
        self.first = _first_whole(recording, self.partial) if first is None else first
        self.spans: list[Span] = []
        """The whole rounds, as far as it was read."""
        parameters = recording.parameters
        self.by_kind = any(
            word in parameters.get(FILTERED, "") for word in ("topics", "without")
        ) or any(key in parameters for key in LEFT_OUT)
        """Whether messages of some kinds were left out."""
        self.odd: list[str] = []
        """What is odd, without anything being derived: the first lines."""
        self.cut_off: str | None = None
        """Why the end of the run is not recorded, None if it is."""
        self._in_order = in_order
        self._sorting = Sorting(recording, self._fail, first=self.first, gaps=True)

    @property
    def transcript(self) -> Transcript:
        """What stands beside the rounds, as far as it was read."""
        return self._sorting.found

    def _fail(self, check: str, why: str) -> None:
        if check == "complete":
            self.cut_off = self.cut_off or why
        elif self.partial and why.endswith(": no report"):
            pass  # that messages are missing is told as a whole
        elif len(self.odd) < ODD_MAX:
            self.odd.append(why)

    def rounds(self) -> Iterator[tuple[int, RecordedRound]]:
        """Yield the rounds that all modules have reported, in order; others are gaps between them.

        OutOfOrder if a message stands where its round is over, and rounds are not kept.
        """
        blocks = self.recording.blocks() if self._in_order else [(self.recording.records, inf)]
        for records, least in blocks:
            self._sorting.take(records)
            for number, recorded in self._sorting.close(least):
                add_to_spans(self.spans, number)
                yield number, recorded
        self._sorting.end()

    def lacks(self, number: int) -> bool:
        """Return whether messages of a whole round can be missing although they were sent."""
        damaged = bool(self.recording.problems) or RECOVERED in self.recording.parameters
        if self.by_kind or damaged:
            return True
        # What was cut by rounds or in between has all of the others.
        return self.partial and number == self.first

    @property
    def ended(self) -> bool:
        """Whether the last round that was read is the last that the run had."""
        found = self.transcript
        return found.summary is not None and found.summary.rounds == found.complete_rounds


def start_of(reading: Reading, number: int, recorded: RecordedRound) -> tuple[Site, ...]:
    """Return where modules stand when a round begins: at the start, or else by their own word."""
    scene = reading.recording.scene
    if number == 1:
        return scene.start
    reported = (recorded.reports[module].before for module in range(len(scene.start)))
    return tuple(
        there if site is None else site for site, there in zip(reported, scene.start, strict=True)
    )


def cut_text(recording: Recording) -> str | None:
    """Return in words which messages a recording has of a run; None if none were left out."""
    parameters, whole = recording.parameters, whole_of(recording)
    how = [f"filtered: {parameters[FILTERED]}"] if FILTERED in parameters else []
    how += [f"part {parameters[SPLIT]}"] if SPLIT in parameters else []
    left = [f"{key} {parameters[key]}" for key in LEFT_OUT if key in parameters]
    if whole is None and not left:
        return None
    what = "not all" if whole is None else f"{len(recording.records)} of {whole}"
    return f"{what} messages ({'; '.join([*left, *how]) or 'cut'})"


def _first_whole(recording: Recording, partial: bool) -> int:  # noqa: FBT001 - one argument
    """Return the first round that every module has reported; 1 if there is none."""
    if not partial:
        return 1
    everyone = len(recording.scene.start)
    known: dict[int, set[int]] = {}
    for record in recording.of_kind("report"):
        try:
            report = decode(record.data)
        except InputError:
            continue
        if isinstance(report, Report):
            known.setdefault(report.round, set()).add(report.module)
            if len(known.get(1, ())) == everyone:
                return 1
    return min((number for number, modules in known.items() if len(modules) == everyone), default=1)


def moments(reading: Reading) -> Iterator[Moment]:
    """Yield each whole round as derived from the moves before it, back to the last gap.

    Contradiction where a move in the recording is none from where its module stands, or a module
    says that it stands elsewhere.
    """
    scene = reading.recording.scene
    sites = list(scene.start)
    due = 0
    for number, recorded in reading.rounds():
        if number != due:
            sites = list(start_of(reading, number, recorded))
        due = number + 1
        where = f"round {number}, module_"
        motion: dict[Site, Site] = {}
        for module, report in recorded.reports.items():
            if report.before != sites[module]:
                stood = site_text(sites[module])
                raise Contradiction(f"{where}{module}: its moves lead to {stood}, not to its word")
            if report.move is None:
                continue
            at = report.move.at
            move = None
            if at is not None:
                move = scene.system.move_named(sites[module], report.move.generator, at)
            if move is None:
                raise Contradiction(f"{where}{module}: its move is none from where it stands")
            motion.update(move.motion)
        yield Moment(number, tuple(sites), frozenset(sites) | scene.system.filled, recorded)
        sites = [motion.get(site, site) for site in sites]


def action_text(generator: str, at: Any) -> str:
    """Return a move in words."""
    return f"{generator} at {site_text(at)}"


class Path:
    """The moves of a run: for each its action, and its round and mover."""

    def __init__(self, system: System) -> None:
        self._system = system
        self._known: dict[tuple[str, Site], Action] = {}
        self.actions: list[Action] = []
        """The actions in order."""
        self._places: list[tuple[int, int]] = []
        self.wrong: str | None = None
        """Why the path is not known, if a move is none of the system."""

    def add(self, number: int, report: Report) -> None:
        """Add what a module reports to have done in a round."""
        if report.move is not None:
            self.move(number, report.module, report.move.generator, report.move.at)

    def move(self, number: int, module: int, generator: str, at: Site) -> None:
        """Add a move."""
        place: Any = at  # what is none is none of the system
        known = self._known.get((generator, place))
        if known is None:
            try:
                action = self._system.action(generator, place)
            except (InputError, TypeError, ValueError, IndexError) as error:
                self.wrong = self.wrong or f"round {number}, module_{module}: {error}"
                return
            known = self._known[generator, place] = named(action, generator, place)
        self.actions.append(known)
        self._places.append((number, module))

    def identical(self, other: Path) -> bool:
        """Return whether both have equal moves, by the same modules in the same rounds."""
        return self._places == other._places and all(
            one is two or one == two for one, two in zip(self.actions, other.actions, strict=True)
        )


def named(action: Action, generator: str, place: Site) -> Action:
    """Return an action with the label that moves have everywhere in a comparison."""
    one, other = action.ends
    label = action_text(generator, place)
    return Action(
        action.support,
        action.trace,
        one,
        other,
        free=action.free,
        guards=action.guards,
        label=label,
    )


def compare_paths(
    one: Sequence[Action],
    other: Sequence[Action],
    starts: tuple[AbstractSet[Site] | None, AbstractSet[Site] | None],
    end: str | None,
    *,
    identical: bool,
) -> PathComparison:
    """Return how two paths compare as a whole; `end` as `PathComparison` has it."""
    # Equal moves in equal rounds from one start need no comparing.
    known = identical and starts[0] == starts[1]
    same = None if known else difference(one, other, starts)
    homotopic = same and difference(one, other, starts, homotopic=True)
    same, homotopic = (
        each and each.replace("in the first", "in a").replace("in the second", "in b")
        for each in (same, homotopic)
    )
    cubes = _cubes(one)
    return PathComparison(
        (len(one), len(other)),
        (cubes, cubes if known else _cubes(other)),
        identical,
        same,
        homotopic,
        end,
    )


def _cubes(actions: Sequence[Action]) -> int:
    heap = FastHeap()
    heap.extend(actions)
    return heap.cubes


def states_text(a: AbstractSet[Site] | None, b: AbstractSet[Site] | None) -> str | None:
    """Return in one line how two states differ, None if they do not or are not known."""
    if a is None or b is None or a == b:
        return None
    texts = [
        f"{', '.join(map(site_text, in_order(some)))} in {name} alone"
        for some, name in ((a - b, "a"), (b - a, "b"))
        if some
    ]
    return f"on are {'; '.join(texts)}"


def scenes_text(a: Scene, b: Scene) -> str | None:
    """Return in one line how two scenes differ first, None if they are equal."""
    if a.system.to_table() != b.system.to_table():
        return f"the systems differ: {a.spec}, {b.spec}"
    if len(a.start) != len(b.start):
        return f"the numbers of modules differ: {len(a.start)}, {len(b.start)}"
    for module, sites in enumerate(zip(a.start, b.start, strict=True)):
        if sites[0] != sites[1]:
            one, two = map(site_text, sites)
            return f"the starts differ: module_{module} at {one}, at {two}"
    return _goals_text(a, b)


def _goals_text(a: Scene, b: Scene) -> str | None:
    if a.goal != b.goal:
        return f"the goals differ: {states_text(a.goal or frozenset(), b.goal or frozenset())}"
    for module, goals in enumerate(zip(a.goals, b.goals, strict=False)):
        if goals[0] != goals[1]:
            one, two = (", ".join(map(site_text, each)) or "none" for each in goals)
            return f"the goals of module_{module} differ: {one}; {two}"
    if len(a.goals) != len(b.goals):
        return "the goals differ: modules know their own in one of the scenes alone"
    return None


def first_other(one: Sequence[Action], two: Sequence[Action]) -> int | None:
    """Return where the moves of two paths differ first, from 0; None if they are the same."""
    both = enumerate(zip_longest(one, two))
    return next((number for number, (move, other) in both if move != other), None)


def compare_files(
    a: Recording | InputFile, b: Recording | InputFile, system: str | None, hints: PlanHints
) -> RunComparison:
    """Compare the moves of two files of any kind; errors as for `read_input`."""
    notes: list[str] = []
    files = [None if isinstance(each, Recording) else each for each in (a, b)]
    (one_system, one_hints), (two_system, two_hints) = hints_for_each(files, system, hints)
    systems = _system_for(a, b, one_system), _system_for(b, a, two_system)
    for name, given in zip("ab", systems, strict=True):
        if isinstance(given, Scene):
            what = f"the moves of {name} are read as those of {given.spec}"
            notes.append(f"{what}, as the recording is")
    both = _moves_in(a, systems[0], one_hints), _moves_in(b, systems[1], two_hints)
    (one, _), (two, _) = both
    notes += [f"{name} {odd}" for name, (_, each) in zip("ab", both, strict=True) for odd in each]
    first = first_other(one.actions, two.actions)
    move = None
    if first is not None:
        mine, theirs = (
            label_of(each.actions[first]) if first < len(each.actions) else None
            for each in (one, two)
        )
        move = MoveDifference(first + 1, None, mine, theirs)
    scene = None
    if one.given_scene is not None and two.given_scene is not None:
        scene = scenes_text(one.given_scene, two.given_scene)
    starts = starts_to_compare(one, two)
    identical = first is None and starts[0] == starts[1]
    paths = compare_paths(one.actions, two.actions, starts, None, identical=identical)
    end, unknown = _ends(one, two, homotopic=paths.homotopic is None)
    return RunComparison(
        a=str(a.path),
        b=str(b.path),
        clock="moves",
        same=paths.identical,
        scene=scene,
        compared="the moves, in their order; nothing else is in both",
        notes=tuple(notes),
        move=move,
        paths=replace(paths, end=end, end_unknown=unknown),
    )


def _ends(one: PathInput, two: PathInput, *, homotopic: bool) -> tuple[str | None, str | None]:
    """Return how the states at the end differ, or else why it is not known whether they do."""
    ends = _end(one), _end(two)
    if ends[0] is None or ends[1] is None:
        # Homotopic paths end alike, wherever they begin.
        return None, None if homotopic else "the moves do not say which sites are on"
    if one.given_scene is not None and two.given_scene is not None:
        return states_text(*ends), None
    common = one.touched & two.touched
    apart = states_text(ends[0] & common, ends[1] & common)
    if apart is not None:
        return apart, None
    # What one alone touches is in the other as that began, which is not known.
    odd = [
        (name, in_order((end ^ each.start) - common))
        for name, each, end in (("a", one, ends[0]), ("b", two, ends[1]))
        if each.start is not None and (end ^ each.start) - common
    ]
    if odd:
        name, sites = odd[0]
        return None, f"{name} alone has moves of {site_text(sites[0])}, and leaves it changed"
    return None, None


def _moves_in(
    source: Recording | InputFile, system: str | Scene | None, hints: PlanHints
) -> tuple[PathInput, list[str]]:
    """Return a path, and what is odd with the recording that it is of."""
    if not isinstance(source, Recording):
        return read_input(source, system, hints), []
    found, cut = gathered(source), cut_text(source)
    odd = [f"is damaged: {problem}" for problem in source.problems]
    odd += [] if cut is None else [f"has {cut}"]
    odd += [] if found.unfinished is None else [f"has not all moves: {found.unfinished}"]
    return PathInput(source.path, "recording", found.numbered, 0.0, source.scene), odd


def _system_for(
    source: Recording | InputFile, other: Recording | InputFile, system: str | None
) -> str | Scene | None:
    """Return the system whose moves a file names: the one given, or that of the other recording."""
    if isinstance(source, Recording):
        return None
    if system is not None or not isinstance(other, Recording) or not _names_generators(source):
        return system
    return other.scene


def _names_generators(source: InputFile) -> bool:
    """Return whether a file names moves by their generators or ends alone."""
    with opened(source) as file:
        return form_of(file).name == "plain" or any(
            is_by_generator(line) for _, line in islice(file.numbered_lines(), 1)
        )


def _end(moves: PathInput) -> frozenset[Site] | None:
    if moves.start is None:
        return None
    state = set(moves.start)
    for action in moves.actions:
        advance(state, action)
    return frozenset(state)


def advance(state: set[Site], action: Action) -> None:
    """Make a move in place; of one that is not admissible, as in a damaged record, what it can."""
    on = frozenset(site for site in action.support - action.free if site in state)
    one, other = action.ends
    gone, come = (one, other) if on == one else (other, one)
    state -= gone
    state |= come
