"""Files for viewers: what others read in them is the recording, on a time line and in space."""

import json
import sys
from collections.abc import Iterable
from functools import cache
from math import atan2, cos, hypot, isclose, pi, sin, sqrt
from pathlib import Path
from typing import Any

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from mcap.reader import make_reader

from cubepath.agents.rendering.pictures import extent, solid_of
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.coordinator.runs.states import RunState, states_of
from cubepath.coordinator.tools.exports.exporting import export
from cubepath.coordinator.tools.exports.viewers import TOPICS, SceneEncoder, times_of
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.cutting import filter_recording, merge_recordings, split_recording
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.registry import all_families
from cubepath.protocol.scenes.specs import scene_from_spec
from processes.command_line import GOLDEN, ROOT
from samples.recordings import new_path
from samples.rolling import rolling_cubes

PATHS = sorted(GOLDEN.glob("*.mcap"))
SECOND = 10**9


def messages_in(path: Path) -> list[tuple[str, int, Any]]:
    """Return topic, log time and content of the messages of a file, as other libraries read it."""
    found = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            assert schema is not None
            if channel.message_encoding == "json":
                content = json.loads(message.data)
            else:
                content = kind_of(schema.name, schema.data).FromString(message.data)
            found.append((channel.topic, message.log_time, content))
    return found


@cache
def kind_of(name: str, data: bytes) -> Any:
    """Return the class of the messages of a schema of protobuf."""
    pool = DescriptorPool()
    for each in FileDescriptorSet.FromString(data).file:
        pool.Add(each)  # type: ignore[no-untyped-call, unused-ignore]
    return GetMessageClass(pool.FindMessageTypeByName(name))


def told_sites(recording: Recording) -> dict[int, list[Any]]:
    """Return the sites of the modules after each round as modules or keepers told them."""
    sites: list[Any] = list(recording.scene.start)
    found = {0: [*sites]}
    if recording.clock == "free":
        moves = recording.moves()
        for number, module, to in zip(moves["round"], moves["module"], moves["to"], strict=True):
            sites[module] = to
            found[int(number)] = [*sites]
        return found
    for logged in recording.messages("report"):
        report = logged.message
        found.setdefault(report.round, [*sites])[report.module] = site_from_json(report.site)
    return found


def middle(scene: Scene, site: Any) -> tuple[float, float]:
    """Return where a module of the recordings that are kept lies, by its coordinates alone."""
    match scene.system.drawing:
        case "hexagons":
            q, r = site
            return q + r / 2, r * sqrt(3) / 2
        case "edges":
            x, y, axis = site
            return x + (axis == 0) / 2, y + (axis == 1) / 2
        case _:
            place = scene.system.place_of(site)
            if isinstance(place, tuple):  # of a map
                return place[0], -place[1]
            count = len(scene.system.places)  # of a cycle
            turn = pi / 2 - 2 * pi * scene.system.places.index(place) / count
            return 1.5 * count / (2 * pi) * cos(turn), 1.5 * count / (2 * pi) * sin(turn)


@cache
def viewed(path: Path, **options: Any) -> list[tuple[str, int, Any]]:
    """Return the messages of a file for viewers with the robot in it."""
    export(path, out := new_path(".mcap"), foxglove=True, **options)
    return messages_in(out)


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_modules_are_where_they_said_in_every_round(path: Path) -> None:
    """Scene, poses and transforms have the sites that modules reported, at the round's second."""
    recording = read_recording(path)
    expected = {
        number * SECOND: [middle(recording.scene, site) for site in sites]
        for number, sites in told_sites(recording).items()
    }
    found: dict[str, dict[int, list[tuple[float, float]]]] = {}
    for topic, log_time, content in viewed(path):
        at = positions(topic, content)
        if at is not None and log_time % SECOND == 0:
            found.setdefault(topic, {})[log_time] = at
    assert set(found) == {"/robot/modules", "/tf"}
    for by_time in found.values():
        assert by_time.keys() == expected.keys()
        for log_time, places in expected.items():
            assert flat(by_time[log_time]) == pytest.approx(flat(places))


def test_a_cube_rolls_about_an_edge_that_it_keeps() -> None:
    """Half-way it stands on that edge, its middle above it, and has turned by 45 degrees."""
    scene = rolling_cubes()
    action = scene.system.action("along", (0, 0, 1))
    state = RunState(1, 0, ((1, 0, 1), *scene.start[1:]), {0: (0, 0, 1)}, {0: action})
    encoder = SceneEncoder(scene)
    data = dict(encoder.state(state, 0, 0.5))
    schema = encoder.schemas()["/tf"]
    pose, below, _ = kind_of(schema[0], schema[2]).FromString(data["/tf"]).transforms
    at, turn = pose.translation, pose.rotation
    assert (at.x, at.y, at.z) == pytest.approx((0.5, 0, 0.5 + sqrt(0.5)))
    assert 2 * atan2(hypot(turn.x, turn.y, turn.z), turn.w) == pytest.approx(pi / 4)
    assert (turn.x, turn.z, abs(turn.y) > 0) == (0, 0, True)
    assert (below.translation.x, below.translation.y, below.translation.z) == (0, 0, 0)


def flat(places: Iterable[tuple[float, float]]) -> list[float]:
    """Return the coordinates one after another."""
    return [number for place in places for number in place]


def positions(topic: str, content: Any) -> Any:
    """Return where the modules are by a message of the robot, None if it is another."""
    match topic:
        case "/tf":
            assert [each.child_frame_id for each in content.transforms] == [
                f"module_{number}" for number in range(len(content.transforms))
            ]
            assert {each.parent_frame_id for each in content.transforms} == {"robot"}
            places = [each.translation for each in content.transforms]
        case "/robot/modules":
            solids = [[*each.cubes, *each.cylinders][0] for each in content.entities]
            places = [each.pose.position for each in solids]
        case _:
            return None
    return [(place.x, place.y) for place in places]


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_modules_that_move_are_marked(path: Path) -> None:
    """They have an outline, and leave a pale body where they were; no other module has."""
    recording = read_recording(path)
    sites = told_sites(recording)
    before = sites[0]
    for topic, log_time, content in viewed(path):
        if topic == "/robot/modules" and log_time % SECOND == 0:
            now = sites[log_time // SECOND]
            moved = [number for number, site in enumerate(now) if site != before[number]]
            marked = [number for number, each in enumerate(content.entities) if each.lines]
            assert marked == moved
            for number in moved:
                entity = content.entities[number]
                body = [*entity.cubes, *entity.cylinders][0]
                tops = {round(point.z, 6) for point in entity.lines[0].points}
                assert tops == {round(body.pose.position.z + body.size.z / 2, 6)}
            for number, each in enumerate(content.entities):
                solids = [*each.cubes, *each.cylinders]
                assert len(solids) == 1 + (number in moved)
                assert [solid.color.a for solid in solids[1:]] == pytest.approx(
                    [0.3] * (len(solids) - 1)
                )
                assert each.texts[0].text == str(number)
            before = now


def test_each_module_keeps_its_colour() -> None:
    """Colours are by number, and differ."""
    hues = {
        number: {(c.r, c.g, c.b) for c in colours}
        for number, colours in _hues(viewed(GOLDEN / "hex-5.mcap")).items()
    }
    assert all(len(found) == 1 for found in hues.values())
    assert len(set.union(*hues.values())) == 5


def _hues(messages: Iterable[tuple[str, int, Any]]) -> dict[int, list[Any]]:
    found: dict[int, list[Any]] = {}
    for topic, _, content in messages:
        if topic == "/robot/modules":
            for number, each in enumerate(content.entities):
                found.setdefault(number, []).append(each.cylinders[0].color)
    return found


@pytest.mark.parametrize("name", sorted(all_families()))
def test_solids_at_lie_where_pictures_have_the_modules(name: str) -> None:
    """In every system each module has a place of its own within the frame of its picture."""
    scene = scene_from_spec(name)
    bodies = [body for site in scene.start if (body := solid_of(scene, site)) is not None]
    assert bodies
    assert len({(*body.middle, body.angle) for body in bodies}) == len(bodies)
    left, right, low, high = extent(scene, ())
    for body in bodies:
        assert left <= body.middle[0] <= right
        assert low <= body.middle[1] <= high
        assert min(body.size) > 0


def test_bars_lie_along_their_chords() -> None:
    """The diagonals of a polygon have the direction and nearly the length of the pictured ones."""
    scene = scene_from_spec("polygon:n=8")
    spots = scene.system.positions
    unit = {}
    for site in scene.start:
        assert isinstance(site, tuple)
        (ax, ay), (bx, by) = spots[site[0]], spots[site[1]]
        body = solid_of(scene, site)
        assert body is not None
        turn = body.angle - atan2(by - ay, bx - ax)
        assert isclose(turn, 0, abs_tol=1e-9)
        unit[site] = (body.size[0] + 0.2) / hypot(bx - ax, by - ay)
    assert max(unit.values()) == pytest.approx(min(unit.values()))


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
@pytest.mark.parametrize("log_time", [None, "wall"])
def test_messages_are_those_of_the_recording(path: Path, log_time: Any) -> None:
    """All of them, with all fields, in order; log times are rounds or the wall clock."""
    recording = read_recording(path)
    lasting = None if log_time == "wall" else 0.5
    export(path, out := new_path(".mcap"), log_time=log_time, round_seconds=lasting)
    expected = [
        (
            record.topic,
            record.wall_ns if log_time == "wall" else record.round * SECOND // 2,
            json.loads(record.data),
        )
        for record in recording.records
    ]
    # Other libraries sort by log time; what is said at one time stays in order.
    assert messages_in(out) == sorted(expected, key=lambda each: each[1])


def test_levels_are_found_where_a_run_was_recorded_by_the_wall_clock() -> None:
    """The same run by level and by the wall clock gives one file by levels."""
    by_level = read_recording(GOLDEN / "hex-free-5.mcap")
    told = {**by_level.parameters, "log_time": "wall"}
    with RecordingWriter(
        by_wall := new_path(), by_level.scene, told, written_as=by_level.format
    ) as writer:
        for each in by_level.records:
            writer.write(each.topic, each.data, round_number=each.wall_ns, wall_ns=each.wall_ns)
    found = []
    for recording in (by_level, read_recording(by_wall)):
        export(recording, out := new_path(".mcap"), foxglove=True)
        found.append([(topic, log_time) for topic, log_time, _ in messages_in(out)])
    assert found[0] == found[1]
    assert len({log_time for _, log_time in found[0]}) > 3


def test_a_range_and_topics_are_taken() -> None:
    """The robot as it was in these rounds, and the messages that were asked for."""
    options = {"first": 3, "until": 5, "exclude": ("bundle", "ready")}
    found = viewed(GOLDEN / "hex-5.mcap", **options)
    assert {log_time for _, log_time, _ in found} == {n * SECOND // 4 for n in range(12, 21)}
    whole = [each for each in viewed(GOLDEN / "hex-5.mcap") if each[:2] in {e[:2] for e in found}]
    robot = [each for each in found if each[0] in ("/tf", "/robot/modules")]
    assert robot == [each for each in whole if each[0] in ("/tf", "/robot/modules")]
    topics = {topic.partition("/")[0] for topic, _, _ in found}
    assert topics == {"", "go", "reports", "edges"}


def test_it_is_no_recording() -> None:
    """No command takes it for one, since its log times say something else."""
    export(GOLDEN / "agv-3.mcap", out := new_path(".mcap"))
    with pytest.raises(InputError, match="no cubepath recording: format 'cubepath-export'"):
        read_recording(out)


def test_a_part_from_the_middle_has_no_states() -> None:
    """One line says that the parts can be put together; the beginning alone is shown."""
    parts = split_recording(GOLDEN / "agv-3.mcap", new_path(""), parts=3)
    with pytest.raises(InputError, match="'cubepath log merge' puts parts together"):
        export(parts[1], new_path(".mcap"), foxglove=True)
    filter_recording(GOLDEN / "agv-3.mcap", some := new_path(), topics=["reports", "edges"])
    with pytest.raises(InputError, match="expected all from its beginning"):
        list(states_of(read_recording(some)))
    first = list(states_of(read_recording(parts[0])))
    whole = list(states_of(read_recording(GOLDEN / "agv-3.mcap")))
    assert first == whole[: len(first)]
    merge_recordings(parts, merged := new_path())
    assert list(states_of(read_recording(merged))) == whole


def test_the_layout_shows_what_is_exported() -> None:
    """Each panel of the layout for Foxglove is there, and each topic that it names is written."""
    layout = json.loads((ROOT / "docs" / "foxglove.json").read_text())

    def panels(tree: Any) -> list[str]:
        return (
            [tree] if isinstance(tree, str) else [*panels(tree["first"]), *panels(tree["second"])]
        )

    assert sorted(panels(layout["layout"])) == sorted(layout["configById"])
    (space,) = (each for name, each in layout["configById"].items() if name.startswith("3D!"))
    written = {topic for topic, _, _ in viewed(GOLDEN / "hex-5.mcap")}
    assert space["topics"].keys() == TOPICS.keys() - {"/tf"}
    assert written >= TOPICS.keys()
    assert space["followTf"] == "robot"
    others = [each["topicPath"] for each in layout["configById"].values() if "topicPath" in each]
    assert others
    assert {topic.partition(".")[0] for topic in others} <= written


@pytest.mark.slow
def test_a_new_run_is_shown(tmp_path: Path) -> None:
    """Batches of a recording of today are read as well as the messages of the first format."""
    run(
        Plan(
            "agv:graph=grid3x3,n=3",
            "random",
            seed=1,
            processes=0,
            max_rounds=6,
            log=tmp_path / "a.mcap",
        )
    )
    recording = read_recording(tmp_path / "a.mcap")
    expected = told_sites(recording)
    found = [list(state.sites) for state in states_of(recording)]
    assert found == [expected[number] for number in sorted(expected)]


@pytest.mark.parametrize("name", ["hex-5", "hex-free-5"])
@pytest.mark.parametrize(
    ("told", "why"),
    [
        ({"attached": "6"}, "begins in (round|level) 6, expected a recording from the start"),
        (
            {"topics": "go bundle"},
            r"messages were left out when it was recorded \(topics go bundle\)",
        ),
        ({"exclude": "commit reports/process_0"}, r"left out .* \(exclude commit reports"),
    ],
)
def test_where_nobody_knows_the_places_no_robot_is_shown(
    name: str, told: dict[str, str], why: str
) -> None:
    """Of a run recorded from its middle, or without reports: one line says so, nothing is left."""
    whole = read_recording(GOLDEN / f"{name}.mcap")
    parameters = {**whole.parameters, **told}
    with RecordingWriter(
        late := new_path(), whole.scene, parameters, written_as=whole.format
    ) as writer:
        for each in whole.records:
            if each.round >= 6:
                writer.write(each.topic, each.data, round_number=each.round, wall_ns=each.wall_ns)
    out = new_path(".mcap")
    with pytest.raises(InputError, match=why):
        export(late, out, foxglove=True)
    assert not out.exists()
    assert export(late, out).count > 0


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"log_time": "level"}, "log time 'level', expected 'round' or 'wall'"),
        ({"round_seconds": 0.0}, "a round of 0 s: expected at least 1e-09 s"),
        ({"round_seconds": float("nan")}, "a round of nan s"),
        ({"round_seconds": 1e12}, "expected less than 2\\^63 nanoseconds"),
        ({"form": "rrd", "topics": ["go"]}, "no tables and no kinds, expected a choice by rounds$"),
    ],
)
def test_what_cannot_be_shown_is_told(options: dict[str, Any], why: str) -> None:
    """In one line, and nothing is left."""
    out = new_path(".mcap")
    with pytest.raises(InputError, match=why):
        export(GOLDEN / "hex-5.mcap", out, **options)
    assert not out.exists()


@pytest.mark.parametrize(
    ("module", "out", "extra"),
    [("foxglove.messages", "a.mcap", "viewers"), ("rerun", "a.rrd", "rerun")],
)
def test_a_library_that_is_missing_is_named(
    module: str, out: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the command that installs it."""
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(InputError, match=rf"pip install 'cubepath\[{extra}\]'"):
        export(GOLDEN / "hex-5.mcap", tmp_path / out, foxglove=out.endswith("mcap"))
    assert not list(tmp_path.iterdir())


def test_rounds_of_a_run_without_rounds_are_levels() -> None:
    """It has no rounds to make log times of."""
    with pytest.raises(InputError, match="log time 'round', expected 'level' or 'wall'"):
        times_of(read_recording(GOLDEN / "hex-free-5.mcap"), "round", 1.0)
