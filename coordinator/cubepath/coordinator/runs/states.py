"""Where modules are after each round of a recording, or after each step of a run or schedule.

Places follow from the start state and the reported moves, so a recording is read once, in order.
Pictures and films are drawn from the snapshots.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

from cubepath.coordinator.runs.gathering import check_from_the_start
from cubepath.protocol.core.actions import Action, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.recordings.cutting import is_beginning, left_out
from cubepath.protocol.recordings.recording import Recording, rounds_in_turn

Steps: TypeAlias = Sequence[Iterable[Action]]
"""A run or a cube path: the actions of each round or cube, which commute."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """Where modules are after a step; which moved in it, from which site and by which action."""

    sites: tuple[Site, ...]
    moved: Mapping[int, Site]
    by: Mapping[int, Action]


def snapshots(scene: Scene, steps: Iterable[Iterable[Action]]) -> Iterator[Snapshot]:
    """Follow the modules through the steps: first the start, then a snapshot after each step.

    InputError if an action is not admissible when its turn comes.
    """
    sites = list(scene.start)
    module_at = {site: number for number, site in enumerate(sites)}
    state = set(scene.start_state)
    yield Snapshot(tuple(sites), {}, {})
    for number, actions in enumerate(steps, 1):
        moved: dict[int, Site] = {}
        by: dict[int, Action] = {}
        for action in actions:
            index = end_at(action, state)
            if index is None:
                raise InputError(f"step {number}: {why_inadmissible(action, state)}")
            motion = motion_of(scene.system, action, index)
            apply_in_place(action, state)
            movers = [module_at.pop(source) for source, _ in motion]
            for module, (source, target) in zip(movers, motion, strict=True):
                moved[module], by[module] = source, action
                sites[module] = target
                module_at[target] = module
        yield Snapshot(tuple(sites), moved, by)


def visited(found: Iterable[Snapshot]) -> Iterator[Site]:
    """Yield the sites that modules come to, each once."""
    return iter(dict.fromkeys(snap.sites[module] for snap in found for module in snap.moved))


def motion_of(system: System, action: Action, index: int) -> Sequence[tuple[Site, Site]]:
    """Return where the action takes each module of its trace from its end `index`."""
    before = in_order(action.ends[index] & action.trace)
    for move in system.moves_of(action):
        if set(before) == {source for source, _ in move.motion}:
            return move.motion
    after = in_order(action.ends[1 - index] & action.trace)
    if len(before) != len(after):
        raise InputError(f"{action!r} makes {len(after)} modules of {len(before)}")
    return list(zip(before, after, strict=True))


@dataclass(frozen=True, slots=True)
class RunState:
    """The sites of the modules, by number, after a round; without rounds after a level."""

    round: int
    wall_ns: int
    """When the last of the round was reported; of the start, when the recording begins."""
    sites: tuple[Site, ...]
    moved: Mapping[int, Site]
    """The modules that have just moved, and from where."""
    by: Mapping[int, Action]
    """What each of them made."""


def states_of(recording: Recording) -> Iterator[RunState]:
    """Yield the start as round 0, and the state after each round, or without rounds each level.

    InputError as for `check_from_the_start`, if messages are missing in
    between, if one cannot be decoded, or if a move is not admissible when its turn comes.

    >>> states = list(states_of(read_recording("logs/golden/hex-5.mcap")))
    >>> len(states), states[1].moved, states[1].sites[0]
    (30, {0: (0, 0)}, (1, -1))
    """
    if left_out(recording) and not is_beginning(recording):
        raise InputError(
            f"{recording.path}: holds {len(recording.records)} messages of a longer recording,"
            " expected all from its beginning ('cubepath log merge' puts parts together)"
        )
    check_from_the_start(recording)
    first = recording.counts().first_wall_ns or 0
    ahead: list[tuple[int, int]] = [(0, first)]

    def steps() -> Iterator[list[Action]]:
        for number, wall_ns, actions in _rounds(recording):
            ahead.append((number, wall_ns))
            yield actions

    try:
        for snapshot in snapshots(recording.scene, steps()):
            yield RunState(*ahead[-1], snapshot.sites, snapshot.moved, snapshot.by)
    except InputError as error:
        where = f"{recording.path}: "
        raise InputError(f"{where}{str(error).removeprefix(where)}") from None


def _rounds(recording: Recording) -> Iterator[tuple[int, int, list[Action]]]:
    """Yield each round with the wall time of its last report, and its moves."""
    system = recording.scene.system
    for records in rounds_in_turn(recording):
        ends: dict[int, int] = {}
        actions: dict[int, list[Action]] = {}
        if recording.clock != "free":
            for record in records:
                if record.kind == "reports":
                    ends[record.round] = max(record.wall_ns, ends.get(record.round, 0))
        moves = replace(recording, records=records).moves()
        names = ("round", "wall_ns", "generator", "at")
        rows = zip(*(moves[name].tolist() for name in names), strict=True)
        for number, wall_ns, generator, at in rows:
            ends[number] = max(wall_ns, ends.get(number, 0))
            actions.setdefault(number, []).append(system.action(generator, at))
        for number in sorted(ends):
            yield number, ends[number], actions.get(number, [])
