"""Files for viewers: messages of Foxglove or entities of rerun, with log times that they can show.

The libraries are extras, and are imported when something is written. Each message for Foxglove
holds all modules, because viewers show the last message of a topic before the chosen time and no
other. A file for viewers is no recording, and no command reads it; its log times are rounds that
last some time, or the wall clock.
"""

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from importlib import import_module
from itertools import chain
from math import cos, isfinite, pi, sin
from types import ModuleType
from typing import IO, Any, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np
from mcap.writer import Writer

from cubepath.agents.rendering.pictures import colours, solid_of, way_of
from cubepath.agents.rendering.style import GOAL, INK, WALL, Colour, Solid, parts_of
from cubepath.agents.rendering.ways import Leg, along
from cubepath.coordinator.runs.states import RunState, states_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.cutting import MessageSelection
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.recordings.writing import CHUNK_BYTES, TOPICS_MAX, CountedStream, mcap_writer
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.free_messages import Commit, CommitLog, decode_free
from cubepath.protocol.wire.on_record import schema_of

FRAME = "robot"
"""The frame in which everything lies: x and y as in a picture, z upwards, in cells."""
TOPICS: Mapping[str, str] = {
    "/robot/ground": "SceneUpdate",
    "/robot/modules": "SceneUpdate",
    "/tf": "FrameTransforms",
}
"""The topics and the schemas of their messages."""
_GHOST = 0.3
_NS = 1_000_000_000


def library() -> ModuleType:
    """Return the messages of the library; InputError says how to install it."""
    try:
        return import_module("foxglove.messages")
    except ImportError:
        raise InputError(
            "messages of Foxglove take the library foxglove-sdk: pip install 'cubepath[viewers]'"
        ) from None


class SceneEncoder:
    """Encodes the states of a scene; bodies are worked out once for each site."""

    def __init__(self, scene: Scene) -> None:
        """Begin with nothing encoded; InputError if the library is missing."""
        self._scene = scene
        self._messages: Any = library()
        self.body = cache(partial(solid_of, scene))
        """Returns what stands at a site."""
        self._resting: dict[int, tuple[Site, Colour, dict[str, list[Any]]]] = {}
        """By module its site, its colour and the parts of its entity there."""

    def schemas(self) -> dict[str, tuple[str, str, bytes]]:
        """Return name, encoding and bytes of the schema of each topic."""
        found = {
            topic: getattr(self._messages, name).get_schema() for topic, name in TOPICS.items()
        }
        return {topic: (each.name, each.encoding, each.data) for topic, each in found.items()}

    def ground(self, log_time: int) -> tuple[str, bytes]:
        """Return what does not move: obstacles, the goal, and lines between places."""
        messages, system = self._messages, self._scene.system
        entities = [
            self._fixed("obstacles", log_time, self._bodies(system.filled), WALL),
            self._fixed("goal", log_time, map(_sunk, self._bodies(self._scene.goal or ())), GOAL),
        ]
        lines = [
            self._line([self._middle(one), self._middle(other)], 0.04, parts_of(WALL))
            for one, other in system.lines()
        ]
        entities.append(self._entity("lines", log_time, lines=lines))
        return "/robot/ground", messages.SceneUpdate(entities=entities).encode()

    def _middle(self, place: Site) -> tuple[float, float, float]:
        label = self._scene.system.labels
        found = self.body(place if label is None else (place, 0))
        return (0.0, 0.0, 0.0) if found is None else found.middle

    def _bodies(self, sites: Iterable[Site]) -> Iterable[Solid]:
        return filter(None, map(self.body, sites))

    def _fixed(self, name: str, log_time: int, bodies: Iterable[Solid], colour: str) -> Any:
        parts: dict[str, list[Any]] = {"cubes": [], "cylinders": []}
        for body in bodies:
            self._solid(parts, body, parts_of(colour), 0.6)
        return self._entity(name, log_time, **parts)

    def state(
        self, state: RunState, log_time: int, part: float = 1.0
    ) -> Iterator[tuple[str, bytes]]:
        """Yield the messages of a state: the scene and the transforms.

        With a `part` below 1, modules that moved are on their ways.
        """
        messages = self._messages
        hues = colours(self._scene, state.sites)
        bodies = _bodies(self._scene, state, part, self.body)
        entities = [
            self._module(number, state, log_time, hues[number], body)
            for number, body in enumerate(bodies)
        ]
        yield "/robot/modules", messages.SceneUpdate(entities=entities).encode()
        transforms = [
            messages.FrameTransform(
                timestamp=self._timestamp(log_time),
                parent_frame_id=FRAME,
                child_frame_id=f"module_{number}",
                translation=messages.Vector3(**_xyz(body.middle)),
                rotation=self._turn(body),
            )
            for number, body in enumerate(bodies)
            if body is not None
        ]
        yield "/tf", messages.FrameTransforms(transforms=transforms).encode()

    def _module(
        self, number: int, state: RunState, log_time: int, hue: Colour, body: Solid | None
    ) -> Any:
        """Return the entity of a module: empty where nothing stands."""
        site, before = state.sites[number], state.moved.get(number)
        resting = body == self.body(site)
        parts = self._at_rest(number, site, hue) if resting else self._parts(number, body, hue)
        if before is not None:
            parts = {name: [*values] for name, values in parts.items()}
            left = self.body(before)
            if body is not None:
                parts["lines"].append(self._line(_rim(body), 0.06, parts_of(INK)))
            if left is not None:
                self._solid(parts, left, hue, _GHOST)
        return self._entity(f"module_{number}", log_time, **parts)

    def _at_rest(self, number: int, site: Site, hue: Colour) -> dict[str, list[Any]]:
        """Return the parts of a module that has not moved, made once while it stays."""
        known = self._resting.get(number)
        if known is not None and known[:2] == (site, hue):
            return known[2]
        parts = self._parts(number, self.body(site), hue)
        self._resting[number] = site, hue, parts
        return parts

    def _parts(self, number: int, body: Solid | None, hue: Colour) -> dict[str, list[Any]]:
        parts: dict[str, list[Any]] = {"cubes": [], "cylinders": [], "lines": [], "texts": []}
        if body is not None:
            self._solid(parts, body, hue, 1.0)
            parts["texts"].append(self._text(body, number))
        return parts

    def _solid(self, parts: dict[str, list[Any]], body: Solid, hue: Colour, alpha: float) -> None:
        messages = self._messages
        red, green, blue = hue
        given = {
            "pose": self._pose(body),
            "size": messages.Vector3(**_xyz(body.size)),
            "color": messages.Color(r=red, g=green, b=blue, a=alpha),
        }
        if body.is_round:
            parts["cylinders"].append(
                messages.CylinderPrimitive(bottom_scale=1.0, top_scale=1.0, **given)
            )
        else:
            parts["cubes"].append(messages.CubePrimitive(**given))

    def _text(self, body: Solid, number: int) -> Any:
        messages = self._messages
        x, y, z = body.middle
        above = Solid((x, y, z + body.size[2] / 2 + 0.15), body.size)
        return messages.TextPrimitive(
            pose=self._pose(above),
            billboard=True,
            font_size=0.3,
            scale_invariant=False,
            color=messages.Color(r=0.0, g=0.0, b=0.0, a=1.0),
            text=str(number) if body.word is None else body.word,
        )

    def _line(self, points: Sequence[tuple[float, float, float]], wide: float, hue: Colour) -> Any:
        messages = self._messages
        red, green, blue = hue
        return messages.LinePrimitive(
            type=messages.LinePrimitiveLineType.LineStrip,
            pose=self._pose(None),
            thickness=wide,
            scale_invariant=False,
            points=[messages.Point3(**_xyz(point)) for point in points],
            color=messages.Color(r=red, g=green, b=blue, a=1.0),
        )

    def _entity(self, name: str, log_time: int, **parts: Any) -> Any:
        return self._messages.SceneEntity(
            timestamp=self._timestamp(log_time), frame_id=FRAME, id=name, **parts
        )

    def _timestamp(self, log_time: int) -> Any:
        return self._messages.Timestamp(log_time // _NS, log_time % _NS)

    def _pose(self, body: Solid | None) -> Any:
        messages = self._messages
        body = body or Solid((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        return messages.Pose(
            position=messages.Vector3(**_xyz(body.middle)), orientation=self._turn(body)
        )

    def _turn(self, body: Solid) -> Any:
        x, y, z, w = body.quaternion
        return self._messages.Quaternion(x=x, y=y, z=z, w=w)


def _xyz(point: tuple[float, float, float]) -> dict[str, float]:
    x, y, z = point
    return {"x": x, "y": y, "z": z}


def _sunk(body: Solid) -> Solid:
    """Return a body as a flat one below its place."""
    (x, y, z), (wide, deep, tall) = body.middle, body.size
    return replace(body, middle=(x, y, z - 0.55 * tall), size=(wide, deep, 0.1 * tall))


def _rim(body: Solid) -> list[tuple[float, float, float]]:
    """Return a closed line around the top of a body."""
    (x, y, z), (wide, deep, tall) = body.middle, body.size
    if body.is_round:
        turns = [2 * pi * number / 12 for number in range(13)]
        outline = [(wide / 2 * cos(turn), deep / 2 * sin(turn)) for turn in turns]
    else:
        outline = [
            (a * wide / 2, b * deep / 2) for a, b in [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
        ]
    top = np.array([(a, b, tall / 2) for a, b in outline])
    turn = (Leg((0.0, 0.0, 0.0), body.axis, body.angle),) if body.angle else ()
    points = np.array((x, y, z)) + along(turn, 1, top)
    return [(a, b, c) for a, b, c in points.tolist()]


def _bodies(
    scene: Scene, state: RunState, part: float, body: Callable[[Site], Solid | None]
) -> list[Solid | None]:
    """Return what stands for each module, of those that moved after a part of their ways."""
    found = [body(site) for site in state.sites]
    for number, source in state.moved.items() if part < 1 else ():
        left = body(source)
        if left is not None:
            way = way_of(scene, state.by[number], source, state.sites[number])
            found[number] = left.on_its_way(way, part)
    return found


LogTime: TypeAlias = Literal["round", "level", "wall"]


@dataclass(frozen=True, slots=True)
class ExportTimes:
    """How log times are made: from rounds or levels, each `round_ns` nanoseconds, or `by_wall`."""

    by_wall: bool
    round_ns: int

    def at(self, number: int, wall_ns: int) -> int:
        """Return the log time of a round or level, and of a wall time, in nanoseconds.

        InputError if it has more than 63 bits.
        """
        found = wall_ns if self.by_wall else number * self.round_ns
        if not 0 <= found < 1 << 63:
            raise InputError(f"log time {found}: expected less than 2^63 nanoseconds")
        return found


def times_of(
    recording: Recording, log_time: LogTime | None, round_seconds: float | None
) -> ExportTimes:
    """Return how log times are made; by default from rounds, or without rounds from levels.

    InputError if the run has none of what is asked for, or a round lasts no time.
    """
    logical = "level" if recording.clock == "free" else "round"
    if log_time not in (None, logical, "wall"):
        raise InputError(f"{recording.path}: log time {log_time!r}, expected '{logical}' or 'wall'")
    if log_time == "wall" and round_seconds is not None:
        raise InputError(
            f"a round of {round_seconds:g} s: by the wall clock a round lasts as long as it took,"
            f" expected log time '{logical}'"
        )
    round_seconds = 1.0 if round_seconds is None else round_seconds
    if not (isfinite(round_seconds) and round_seconds * _NS >= 1):
        raise InputError(f"a round of {round_seconds:g} s: expected at least 1e-09 s")
    return ExportTimes(log_time == "wall", round(round_seconds * _NS))


def numbered(recording: Recording) -> Iterator[tuple[int, Record]]:
    """Yield the messages in the order of writing, each with its round or the greatest level so far.

    InputError if a commit cannot be decoded.
    """
    if recording.clock != "free" or recording.parameters.get("log_time") != "wall":
        for record in recording.written():
            yield record.round, record
        return
    level = 0
    for record in recording.written():
        if record.kind in ("commit", "commits"):
            level = max([level, *_levels(recording, record)])
        yield level, record


def _levels(recording: Recording, record: Record) -> list[int]:
    try:
        message: msgspec.Struct = decode_free(record.data)
    except InputError as error:
        where = f"{recording.path}: message {record.sequence} ({record.topic})"
        raise InputError(f"{where}: {error}") from None
    commits = (
        message.parts
        if isinstance(message, CommitLog)
        else [message]
        if isinstance(message, Commit)
        else []
    )
    return [moved.level for moved in commits]


PROFILE = "cubepath-export"


class _Timed(NamedTuple):
    """A message with its log time and its publish time in nanoseconds."""

    log_time: int
    wall_ns: int
    topic: str
    data: bytes


def write_viewer_mcap(
    stream: IO[bytes],
    recording: Recording,
    *,
    times: ExportTimes,
    selection: MessageSelection,
    in_space: bool,
) -> int:
    """Write the messages that are taken, and with `in_space` the robot; return their number.

    Topics of a recording are as they are there, as JSON; those of the robot are protobuf.
    """
    stage = SceneEncoder(recording.scene) if in_space else None
    messages = _messages(recording, times, selection)
    robot = iter(()) if stage is None else _robot(recording, times, selection, stage)
    writer = mcap_writer(CountedStream(stream), PROFILE, CHUNK_BYTES)
    notes = {"format": PROFILE, "recorded_as": recording.format}
    writer.add_metadata("cubepath", {**recording.parameters, **notes})
    writer.add_attachment(
        0, 0, "scene.toml", "application/toml", scene_to_toml(recording.scene).encode()
    )
    channel = _channels(writer, {} if stage is None else stage.schemas())
    count = 0
    for timed in heapq.merge(robot, messages, key=lambda timed: timed.log_time):
        channel_id = channel(timed.topic)
        writer.add_message(channel_id, timed.log_time, timed.data, timed.wall_ns, count)
        count += 1
    writer.finish()
    return count


def _messages(
    recording: Recording, times: ExportTimes, selection: MessageSelection
) -> Iterator[_Timed]:
    for number, record in numbered(recording):
        if selection.keeps(record):
            log_time = times.at(number, record.wall_ns)
            yield _Timed(log_time, record.wall_ns, record.topic, record.data)


def _robot(
    recording: Recording, times: ExportTimes, selection: MessageSelection, stage: SceneEncoder
) -> Iterator[_Timed]:
    begun = False
    for state, part, log_time in _moments(recording, times, selection):
        encoded = stage.state(state, log_time, part)
        for each in encoded if begun else chain([stage.ground(log_time)], encoded):
            yield _Timed(log_time, state.wall_ns, *each)
        begun = True


_PARTS = 4
"""The number of moments of a round in which a module does not go straight."""


def _moments(
    recording: Recording, times: ExportTimes, selection: MessageSelection
) -> Iterator[tuple[RunState, float, int]]:
    """Yield the states with their log times, each after parts of the ways to it if one is bent."""
    before: int | None = None
    for state in _taken(recording, selection):
        log_time = times.at(state.round, state.wall_ns)
        ways = (
            way_of(recording.scene, state.by[number], source, state.sites[number])
            for number, source in state.moved.items()
        )
        if before is not None and any(leg.turn or len(way) > 1 for way in ways for leg in way):
            for part in range(1, _PARTS):
                yield state, part / _PARTS, before + (log_time - before) * part // _PARTS
        yield state, 1.0, log_time
        before = log_time


def _channels(
    writer: Writer, protobuf: Mapping[str, tuple[str, str, bytes]]
) -> Callable[[str], int]:
    """Return a function that returns the channel of a topic, and adds it when it is first used."""
    schema = cache(writer.register_schema)
    json_schema = cache(lambda kind: msgspec.json.encode(schema_of(kind)))

    @cache
    def channel(topic: str) -> int:
        if channel.cache_info().currsize == TOPICS_MAX:
            raise InputError(f"{topic}: one more topic than a file can have, {TOPICS_MAX}")
        if topic in protobuf:
            return writer.register_channel(topic, "protobuf", schema(*protobuf[topic]))
        kind = topic.partition("/")[0]
        told = schema(f"cubepath.{kind}", "jsonschema", json_schema(kind))
        return writer.register_channel(topic, "json", told)

    return channel


_FLUSHED = 64
"""Rounds after which what was logged is written."""


def write_rerun(
    stream: IO[bytes], recording: Recording, *, times: ExportTimes, selection: MessageSelection
) -> int:
    """Write the robot after each round that is taken; return the number of rounds.

    The time lines are ``round`` (or ``level``) and ``time``. Entities are ``robot/modules``, boxes
    by number; ``robot/moving``, outlines of those that have just moved, with ``robot/ways`` from
    where; ``robot/goal`` and ``robot/obstacles``; ``moves``, what was moved as text; and
    ``moves_in_round``. InputError if the library is missing, and as for `states_of`.
    """
    try:
        rr: Any = import_module("rerun")
    except ImportError:
        raise InputError(
            "entities of rerun take the library rerun-sdk: pip install 'cubepath[rerun]'"
        ) from None
    name = recording.path.name
    log = rr.RecordingStream("cubepath", recording_id=name, send_properties=False)
    log.set_log_time_enabled(False)  # when this was written is of no use, and never the same
    written = log.binary_stream()
    painter = _Painter(rr, log, recording)
    count = 0
    try:
        steps = "level" if recording.clock == "free" else "round"
        for state, part, log_time in _moments(recording, times, selection):
            if part == 1:
                log.set_time(steps, sequence=state.round)
            else:
                log.disable_timeline(steps)
            if times.by_wall:
                log.set_time("time", timestamp=log_time / _NS)
            else:
                log.set_time("time", duration=log_time / _NS)
            painter.state(state, part)
            count += part == 1
            if count % _FLUSHED == 0:
                stream.write(written.read() or b"")
        painter.ground()
        stream.write(written.read() or b"")
        log.disconnect()
        stream.write(written.read() or b"")
    except BaseException:
        log.disconnect()
        written.read()  # what nobody reads rerun complains of at its end
        raise
    return count


def _taken(recording: Recording, selection: MessageSelection) -> Iterator[RunState]:
    for state in states_of(recording):
        if selection.until is not None and state.round > selection.until:
            return
        if selection.first is None or state.round >= selection.first:
            yield state


class _Painter:
    def __init__(self, rr: Any, log: Any, recording: Recording) -> None:
        self._rr = rr
        self._log = log
        self._scene = recording.scene
        self._body = cache(partial(solid_of, recording.scene))

    def state(self, state: RunState, part: float) -> None:
        rr, log = self._rr, self._log
        hues = colours(self._scene, state.sites)
        found = _bodies(self._scene, state, part, self._body)
        shown = [(number, body) for number, body in enumerate(found) if body is not None]
        log.log("robot/modules", self._boxes(shown, [hues[number] for number, _ in shown]))
        stirred = [(number, body) for number, body in shown if number in state.moved]
        outline = self._boxes(stirred, [parts_of(INK)] * len(stirred), solid=False)
        log.log("robot/moving", outline)
        ways = [
            [before.middle, body.middle]
            for number, body in stirred
            if (before := self._body(state.moved[number])) is not None
        ]
        log.log("robot/ways", rr.LineStrips3D(ways, radii=0.05))
        if part < 1:
            return
        log.log("moves_in_round", rr.Scalars(len(state.moved)))
        for number in sorted(state.moved):
            ends = f"{site_text(state.moved[number])} to {site_text(state.sites[number])}"
            log.log("moves", rr.TextLog(f"module {number}: {ends}"))

    def ground(self) -> None:
        """Log what does not move."""
        for name, sites, colour in (
            ("goal", self._scene.goal or (), (214, 36, 110, 120)),
            ("obstacles", self._scene.system.filled, (90, 94, 101, 255)),
        ):
            bodies = [(0, body) for site in sites if (body := self._body(site)) is not None]
            if bodies:
                solid = name == "obstacles"
                hues = [tuple(part / 255 for part in colour)] * len(bodies)
                entity = self._boxes(bodies, hues, solid=solid, named=False)
                self._log.log(f"robot/{name}", entity, static=True)

    def _boxes(
        self,
        bodies: list[tuple[int, Solid]],
        hues: list[Any],
        *,
        solid: bool = True,
        named: bool = True,
    ) -> Any:
        rr = self._rr
        return rr.Boxes3D(
            centers=[body.middle for _, body in bodies],
            half_sizes=[[length / 2 for length in body.size] for _, body in bodies],
            quaternions=[rr.Quaternion(xyzw=body.quaternion) for _, body in bodies],
            colors=[tuple(round(255 * part) for part in hue) for hue in hues],
            labels=[body.word or str(number) for number, body in bodies]
            if named and solid
            else None,
            fill_mode="solid" if solid else "majorwireframe",
        )
