"""What the coordinator says about a run at its end, compared with what was derived.

Part of `cubepath verify`; runs with rounds and without both end with `concluded`.
"""

from collections.abc import Mapping, Sequence, Set as AbstractSet
from itertools import pairwise
from typing import NamedTuple

from cubepath.coordinator.normal_form.definitions import is_cube, too_late
from cubepath.coordinator.verification import findings
from cubepath.coordinator.verification.certificate import check_recorded_certificate
from cubepath.coordinator.verification.dependencies import check_dependencies, cubes_of
from cubepath.coordinator.verification.rounds import make, why_not
from cubepath.coordinator.verification.transcript import Fail, Transcript, is_cut_off
from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Cube


def without_end(found: Transcript, *, cut_off: bool) -> dict[str, str]:
    """Return why checks of the closing messages of a run were not made, by name.

    Without a summary `complete` is not checked either, if the recording says itself that its end
    may be missing (`cut_off`); else it fails. A certificate that is not there proves nothing.
    """
    if found.summary is not None:
        return {} if found.certificate else {"certificate": "not checked: there is none on record"}
    names = ["complete"] * cut_off + ["summary", "ended"]
    names += [] if found.cubes else ["normal", "ends", "class"]
    names += [] if found.certificate else ["certificate"]
    return dict.fromkeys(names, findings.NO_END)


def recorded_cubes(scene: Scene, transcript: Transcript, fail: Fail) -> list[list[Action]] | None:
    """Return the recorded cubes, None if a move of them is none of the system."""
    cubes: list[list[Action]] = []
    for cube in transcript.result:
        actions = _actions(scene, cube, fail)
        if actions is None:
            return None
        cubes.append(actions)
    return cubes


def check_cubes(
    scene: Scene,
    cubes: Sequence[Sequence[Action]],
    state: AbstractSet[Site],
    normal_form: Sequence[Sequence[Action]],
    fail: Fail,
    *,
    whole: bool,
) -> None:
    """Check the recorded cubes against those derived, and the state after them."""
    _check_normal(cubes, fail)
    end = _end(scene, cubes, fail)
    if not whole:
        # That the end is missing is reported already: the recorded cubes must be the first ones.
        normal_form = normal_form[: len(cubes)]
    elif end is not None and end != state:
        stray = min(end ^ state, key=repr)
        where = "cubes" if stray in end else "moves"
        fail("ends", f"after the {where} {stray!r} is on, but not after the other")
    for number, (one, other) in enumerate(zip(cubes, normal_form, strict=False), 1):
        apart = _apart(frozenset(one), frozenset(other))
        if apart is not None:
            fail("class", f"cube {number} is not that of the moves: {apart}")
            return
    if len(cubes) != len(normal_form):
        fail("class", f"{len(cubes)} cubes, the moves have {len(normal_form)}")


def _actions(scene: Scene, cube: Cube, fail: Fail) -> list[Action] | None:
    found = []
    for placed in cube.moves:
        try:
            found.append(scene.system.action(placed.generator, placed.at))
        except InputError as error:
            fail("normal", f"cube {cube.index}: {error}")
            return None
    return found


def _check_normal(cubes: Sequence[Sequence[Action]], fail: Fail) -> None:
    for number, cube in enumerate(cubes, 1):
        if not cube:
            fail("normal", f"cube {number} holds no move")
        elif not is_cube(cube):
            fail("normal", f"cube {number}: its moves do not commute")
    for number, (cube, following) in enumerate(pairwise(cubes), 2):
        for action in too_late(cube, following) if is_cube(cube) else ():
            fail("normal", f"cube {number}: {action.label} belongs in the cube before")


def _end(scene: Scene, cubes: Sequence[Sequence[Action]], fail: Fail) -> set[Site] | None:
    """Return the state after the cubes, None if one is not admissible."""
    state = set(scene.start) | scene.system.filled
    for number, cube in enumerate(cubes, 1):
        for action in cube:
            why = why_not(action, state)
            if why is not None:
                fail("ends", f"cube {number}: {why}")
                return None
            make(action, state)
    return state


def _apart(one: frozenset[Action], other: frozenset[Action]) -> str | None:
    if one == other:
        return None
    extra = min((action.label for action in one - other), default=None)
    if extra is not None:
        return f"{extra} is too many"
    return f"{min(action.label for action in other - one)} is missing"


class Derived(NamedTuple):
    """What was derived of a run, for its conclusion."""

    actions: Sequence[Action]
    """The edge path."""
    ends: Sequence[int]
    """After how many of them each round, or level, ended."""
    rounds: int
    state: AbstractSet[Site]
    """What is on at the end."""
    reached: bool
    """Whether the modules are at the goal."""
    digest: str


def concluded(
    recording: Recording,
    transcript: Transcript,
    derived: Derived,
    failures: findings.Failures,
    *,
    stage: int,
    missing: findings.MissingMessages,
    unchecked: Mapping[str, str],
) -> findings.Verification:
    """Compare the recorded end with what was derived, and return the result.

    What fails is found in a `stage`. `unchecked` says of checks on the rest why they were not made.
    """
    scene, summary, fail = recording.scene, transcript.summary, failures.stage(stage)
    normal_form = cubes_of(derived.actions)
    cubes = recorded_cubes(scene, transcript, fail)
    whole = summary is not None
    check_dependencies(derived.actions, derived.ends, cubes, fail, whole=whole)
    if cubes is not None:  # without all actions nothing more can be checked
        check_cubes(scene, cubes, derived.state, normal_form, fail, whole=whole)
    check_recorded_certificate(scene, transcript, derived.actions, fail)
    if summary is not None:
        expected = {
            "round": derived.rounds,
            "rounds": derived.rounds,
            "moves": len(derived.actions),
            "reduced_moves": sum(map(len, normal_form)),
            "cubes": len(normal_form),
            "max_cube_dimension": max(map(len, normal_form), default=0),
            "goal_reached": derived.reached,
            "path_digest": derived.digest,
            "refused": transcript.refused,
        }
        for key, value in expected.items():
            if getattr(summary, key) != value:
                fail("summary", f"{key} is {getattr(summary, key)}, derived is {value}")
    ending = without_end(transcript, cut_off=is_cut_off(recording))
    checks = failures.checks({**unchecked, **ending})
    sound = all(check.ok for check in checks if check.name in ("readable", "complete"))
    return findings.Verification(
        ok=all(check.ok for check in checks),
        complete=sound and whole,
        missing=missing,
        checks=checks,
        moves=len(derived.actions),
        rounds=derived.rounds,
        cubes=len(normal_form),
        path_digest=derived.digest,
    )
