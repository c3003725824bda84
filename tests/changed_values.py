"""Recordings with one value changed: `verify` says what it finds, or refuses them in one line.

``python tests/changed_values.py --count 1000000 --seed 1 -n 2`` changes one value of a message, a
parameter or an attachment in each of so many copies of small recordings of either clock, and
verifies them in memory, with their rules asked again. Anything that is raised but `InputError` and
`CheckError`, and whatever takes longer than thirty seconds, is printed, and is exit code 1. It also
counts what passed every check, by the value that was changed.
"""

import json
import resource
import signal
import sys
import tomllib
import traceback
from argparse import ArgumentParser
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace as with_fields
from functools import cache
from importlib import import_module
from multiprocessing import get_context
from random import Random
from typing import Any, NamedTuple

import tomli_w
from msgspec.structs import replace

from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.verification.parameters import KNOWN
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.path_files.durations import schedule_to_jsonl
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.scenes.toml import scene_from_toml, scene_to_toml
from cubepath.protocol.wire.free_messages import decode_free
from cubepath.protocol.wire.messages import Edges, Summary, encode
from samples.free_runs import asked, free_recorded
from samples.recordings import new_path, recorded
from samples.schedules import carry_out, original
from tampering.junk import places_in, spelled
from tampering.tamperings_of_schedules import stopped

SECONDS_MAX, BYTES_MAX = 30, 4 << 30
"""In so much time of a processor, and in so much memory, a changed recording is to be verified."""
VALUES: tuple[Any, ...] = (
    *(
        None,
        True,
        False,
        -1,
        0,
        1,
        2,
        255,
        1 << 30,
        (1 << 31) - 1,
        1 << 31,
        (1 << 53) + 1,
        1 << 63,
        1 << 70,
        1.5,
        -0.0,
    ),
    *("", "x", "0", "0,0", "goal", "failed", "edge", "\x00", "\ud7ff", "x" * 300, "0-999999"),
    *([], {}, [0], [0, 0], ["x", 0], [0, 0, 0], [[0], 0], [[]], [None], {"x": 0}),
)
TEXTS = (
    *("", "0", "1", "2", "3", "-1", "07", "1e3", "0.5", "nan", "inf", "٣", "x", "x" * 300),
    *("9" * 20, "9" * 5000, "1 << 70", "{}", "[]", "[{}]", "null", "free", "lockstep", "wall"),
    *("level", "round", "chain", "random", "schedule", "tswap", "pibt", "word", "0-1", "1=2,0=1"),
    *("no/such.py:RULE", "stop", "continue", "\x00", "a\nb", "[[[[[[", '{"begins":1}'),
)
NAMES = (*sorted(KNOWN), "invented")
"""The parameters that recordings may have, and one that none has."""
GONE = object()
"""In place of a value: nothing."""
Path = tuple[Any, ...]


class Change(NamedTuple):
    """A recording with one value changed, and what was changed."""

    recording: Recording
    where: str
    """Of what kind the value is: a message and the names of its fields, or a parameter."""
    text: str
    """What was changed, so that it can be changed again."""


@dataclass(frozen=True)
class Base:
    """A recording to change, with its messages as JSON."""

    name: str
    recording: Recording
    kinds: Mapping[str, Sequence[int]]
    """The places of the messages of each kind."""
    documents: Sequence[Any]
    """The messages."""
    scene: Any
    """The scene, as TOML."""
    paths: dict[int, list[Path]] = field(default_factory=dict)
    """By place all values of the message, as they are asked for."""

    def paths_of(self, place: int) -> list[Path]:
        """Return the paths of all values of a message, but for the message itself."""
        if place not in self.paths:
            self.paths[place] = places_in(self.documents[place])[1:]
        return self.paths[place]


def with_own_schedule(recording: Recording) -> Recording:
    """Return a recording that says that it carried out its own moves, level by level."""
    levels, records = [], list(recording.records)
    for place, record in enumerate(records):
        message = decode_free(record.data)
        if isinstance(message, Edges):
            levels.append([GeneratorPlacement(each.generator, each.at) for each in message.moves])
        elif isinstance(message, Summary):
            data = encode(replace(message, schedule_cubes=len(levels)))
            records[place] = with_fields(record, data=data)
    told = {**recording.parameters, "schedule": "own.jsonl", "rule": "schedule"}
    schedule = schedule_to_jsonl(levels)
    return with_fields(recording, records=tuple(records), schedule=schedule, parameters=told)


def small_stages() -> Recording:
    """Return vehicles that go on by another rule."""
    first = recorded("agv:graph=grid3x3,n=3", "tswap", rounds=2)
    return what_if(first, "random", from_round=2, seed=2, processes=0, log=new_path()).recording()


RECORDINGS: Mapping[str, Callable[[], Recording]] = {
    "vehicles": lambda: recorded("agv:graph=grid3x2,n=2", "tswap", rounds=2),
    "labelled": lambda: recorded("agv-labelled:graph=C4,n=2", "pibt", rounds=2),
    "circle": lambda: recorded("agv:graph=C4,n=1", "random", rounds=3),
    "hex": lambda: recorded("hex:n=3", "chain", rounds=2),
    "hex-open": lambda: recorded("hex-open:n=3", "random", rounds=2, hesitate=0.2),
    "arm": lambda: recorded("arm:n=3", "word", rounds=2),
    "sliding": lambda: recorded("sliding:p=2,q=1,n=2", "random", rounds=2),
    "triangulation": lambda: recorded("triangulation:n=6", "random", rounds=2),
    "words": lambda: recorded("words:presentation=free2", "random", rounds=2),
    "schedule": lambda: carry_out(original("agv:graph=grid3x2,n=2", "tswap", 9).path)[1],
    "stopped": stopped,
    "stages": small_stages,
    "free vehicles": lambda: free_recorded("agv:graph=C4,n=2", moves=2, keepers=2, restarts=1),
    "free labelled": lambda: free_recorded(
        "agv-labelled:graph=grid3x2,n=2", moves=2, keepers=2, restarts=1
    ),
    "free hex": lambda: free_recorded("hex:n=2", moves=2, keepers=2, restarts=1),
    "free arm": lambda: free_recorded("arm:n=2", moves=1, keepers=2),
    "free sliding": lambda: free_recorded("sliding:p=2,q=1,n=2", moves=1, keepers=1),
    "free triangulation": lambda: free_recorded("triangulation:n=5", moves=1, keepers=2),
    "free words": lambda: free_recorded("words:presentation=free2", moves=1, keepers=1),
    "free schedule": lambda: with_own_schedule(
        free_recorded("agv:graph=C4,n=2", moves=2, keepers=2)
    ),
}
"""Small recordings of both clocks: what a case costs is what verifying them takes."""


@cache
def base(name: str) -> Base:
    """Return a recording to change."""
    recording = RECORDINGS[name]()
    recording = with_fields(recording, records=tuple(recording.records))
    kinds: dict[str, list[int]] = {}
    for place, record in enumerate(recording.records):
        kinds.setdefault(record.kind, []).append(place)
    documents = [json.loads(each.data) for each in recording.records]
    scene = tomllib.loads(scene_to_toml(recording.scene))
    return Base(name, recording, kinds, documents, scene)


def at(value: Any, path: Path) -> Any:
    """Return the value at a path."""
    for key in path:
        value = value[key]
    return value


def put(value: Any, path: Path, new: Any) -> Any:
    """Return a document with another value at a path, or without it."""
    if not path:
        return new
    key, *rest = path
    made = dict(value) if isinstance(value, dict) else list(value)
    if not rest and new is GONE:
        del made[key]
    else:
        made[key] = put(value[key], tuple(rest), new)
    return made


def others(value: Any) -> list[Any]:
    """Return what may stand in place of a value; most is like it."""
    found = [*VALUES, GONE]
    match value:
        case bool():
            found += [not value] * len(VALUES)
        case int():
            found += [value + 1, value - 1, value + 2, -value] * 6
        case str():
            found += [value + "x", value[1:], value[:-1]] * 4
        case list():
            found += [value[:-1], value[1:], [*value, 0], [*value, *value[:1]], [value]] * 6
            found += [value[::-1]] * 4
        case _:
            pass
    return found


def changed(found: Base, random: Random) -> Change:
    """Return a recording with one value changed; InputError if it is no recording any more."""
    while True:
        kind = random.randrange(40)
        if kind < 4:
            change = _with_parameter(found, random)
        elif kind == 4:
            change = _with_attachment(found, random)
        else:
            change = _with_value(found, random)
        if change is not None:
            return change


def _with_value(found: Base, random: Random) -> Change | None:
    kind = random.choice(sorted(found.kinds))
    place = random.choice(found.kinds[kind])
    document, paths = found.documents[place], found.paths_of(place)
    path = random.choice(paths)
    old = at(document, path)
    if random.randrange(3):
        new = random.choice(others(old))
    else:  # what another message of the kind has there, or anywhere
        other = random.choice(found.kinds[kind])
        theirs = found.paths_of(other)
        new = at(found.documents[other], path if path in theirs else random.choice(theirs))
    data = spelled(put(document, path, new))
    if new is not GONE and spelled(new) == spelled(old):
        return None
    records = list(found.recording.records)
    records[place] = with_fields(records[place], data=data)
    names = " ".join(key for key in path if isinstance(key, str))
    shown = "nothing" if new is GONE else repr(new)
    text = f"message {place} ({kind}), {path}: {shown} instead of {old!r}"
    return Change(with_fields(found.recording, records=tuple(records)), f"{kind}: {names}", text)


def _with_parameter(found: Base, random: Random) -> Change | None:
    told = dict(found.recording.parameters)
    key = random.choice((*sorted(told), *NAMES))
    new = random.choice((*TEXTS, *told.values(), GONE))
    if key == "stages" and key in told and random.randrange(4):
        stages = json.loads(told[key])
        path = random.choice(places_in(stages)[1:])
        new = spelled(put(stages, path, random.choice(others(at(stages, path))))).decode()
    old = told.pop(key, None)
    if new is not GONE:
        told[key] = str(new)
    if told == found.recording.parameters:
        return None
    text = f"parameter {key}: {'nothing' if new is GONE else repr(new)} instead of {old!r}"
    return Change(with_fields(found.recording, parameters=told), f"parameter {key}", text)


def _with_attachment(found: Base, random: Random) -> Change | None:
    recording = found.recording
    if recording.schedule is not None and random.randrange(2):
        lines = recording.schedule.splitlines()
        number = random.randrange(len(lines))
        document = json.loads(lines[number])
        path = random.choice(places_in(document)[1:] or [()])
        new = random.choice(others(at(document, path)))
        lines[number] = spelled(put(document, path, new))
        text = f"schedule, line {number + 1}: {lines[number].decode()}"
        whole = b"".join(line + b"\n" for line in lines)
        return Change(with_fields(recording, schedule=whole), "schedule", text)
    document = found.scene
    path = random.choice(places_in(document)[1:])
    new = random.choice(others(at(document, path)))
    try:
        scene = tomli_w.dumps(put(document, path, new))
    except (TypeError, ValueError):  # what has no form in TOML
        raise InputError("scene: a value that no TOML has") from None
    names = ".".join(key for key in path if isinstance(key, str))
    text = f"scene, {path}: {new!r} instead of {at(document, path)!r}"
    read = scene_from_toml(scene, "scene.toml")
    return Change(with_fields(recording, stored_scene=read), f"scene {names}", text)


class Answer(NamedTuple):
    """What `verify` makes of one recording."""

    fate: str
    """``refused``, ``failing`` or ``passing``."""
    where: str


class Raised(Exception):  # noqa: N818 - what is looked for
    """What `verify` may not raise was raised; the message tells of which recording."""


def answer(name: str, seed: str) -> Answer:
    """Change a recording and verify it; Raised if that raises what it may not."""
    random = Random(seed)  # noqa: S311 - not for secrets
    text, where = "made no recording", "attachment"
    try:
        change = changed(base(name), random)
        text, where = change.text, change.where
        ok = asked(change.recording).ok
    except (InputError, CheckError) as error:
        if "\n" in str(error):
            raise Raised(f"{name}, {seed}: {text}: more than one line: {error!r}") from None
        return Answer("refused", where)
    except BaseException as error:
        if isinstance(error, KeyboardInterrupt):
            raise
        raise Raised(f"{name}, {seed}: {text}\n{traceback.format_exc()}") from None
    return Answer("passing" if ok else "failing", where)


def answers(count: int, seed: int, names: Sequence[str] = tuple(RECORDINGS)) -> Iterator[Answer]:
    """Yield what comes of so many cases, the recordings in turn."""
    for number in range(count):
        yield answer(names[number % len(names)], f"{seed}/{number}")


# The script.


class _TooSlow(Exception):  # noqa: N818 - caught as what may not be raised
    """A recording took too long."""


def _ring(number: int, frame: object) -> None:
    del number, frame
    raise _TooSlow


def _many(task: tuple[int, int, int, Sequence[str]]) -> tuple[Counter[Answer], list[str]]:
    """Return what came of some cases, and what was raised."""
    first, last, seed, names = task
    signal.signal(signal.SIGPROF, _ring)
    found: Counter[Answer] = Counter()
    raised: list[str] = []
    for number in range(first, last):
        signal.setitimer(signal.ITIMER_PROF, SECONDS_MAX)
        try:
            found[answer(names[number % len(names)], f"{seed}/{number}")] += 1
        except Raised as error:
            raised.append(str(error))
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
    return found, raised


def main() -> int:
    """Run the cases, and print what came of them."""
    parser = ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=10_000, help="how many recordings (10000)")
    parser.add_argument("--seed", type=int, default=0, help="of all that is random (0)")
    parser.add_argument("-n", type=int, default=1, metavar="N", help="processes (1)")
    parser.add_argument("--only", action="append", choices=list(RECORDINGS), help="change this")
    given = parser.parse_args()
    names = given.only or list(RECORDINGS)
    for name in names:
        base(name)
    import_module("numba")  # which would be loaded in the middle of a case
    resource.setrlimit(resource.RLIMIT_AS, (BYTES_MAX, BYTES_MAX))
    size = 1000
    tasks = [
        (first, min(first + size, given.count), given.seed, names)
        for first in range(0, given.count, size)
    ]
    found: Counter[Answer] = Counter()
    raised: dict[str, int] = {}
    with get_context("fork").Pool(given.n) as pool:
        for done, (some, wrong) in enumerate(pool.imap_unordered(_many, tasks), 1):
            found += some
            for text in wrong:
                last = text.rstrip().rpartition("\n")[2]
                raised[last] = raised.get(last, 0) + 1
                if raised[last] <= 3:
                    print(text, flush=True)
            if done % 10 == 0:
                print(f"{done * size} recordings, {sum(raised.values())} raised", flush=True)
    fates: Counter[str] = Counter()
    for each, times in found.items():
        fates[each.fate] += times
    passing = Counter({each.where: n for each, n in found.items() if each.fate == "passing"})
    for where, times in passing.most_common():
        print(f"{times:8} passed  {where}")
    for text, times in raised.items():
        print(f"{times:8} raised  {text}")
    print(f"{given.count} recordings: {dict(sorted(fates.items()))}, {sum(raised.values())} raised")
    return 1 if raised else 0


if __name__ == "__main__":
    sys.exit(main())
