"""The robot as entities of rerun, in a .rrd file.

The library is an extra, and is imported when something is written.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from math import cos, sin
from typing import IO, Any

from cubepath.agents.rendering.pictures import colours, solid_of
from cubepath.agents.rendering.style import INK, Solid
from cubepath.coordinator.runs.states import RunState, states_of
from cubepath.coordinator.tools.exports.foxglove import ExportTimes
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.recordings.cutting import MessageSelection
from cubepath.protocol.recordings.recording import Recording

_NS = 1_000_000_000
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
        for state in _taken(recording, selection):
            log.set_time("level" if recording.clock == "free" else "round", sequence=state.round)
            log_time = times.at(state.round, state.wall_ns)
            if times.by_wall:
                log.set_time("time", timestamp=log_time / _NS)
            else:
                log.set_time("time", duration=log_time / _NS)
            painter.state(state)
            count += 1
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
        self._solids_at: dict[Site, Solid | None] = {}

    def state(self, state: RunState) -> None:
        rr, log = self._rr, self._log
        hues = colours(self._scene, state.sites)
        found = [(number, self._body(site)) for number, site in enumerate(state.sites)]
        shown = [(number, body) for number, body in found if body is not None]
        log.log("robot/modules", self._boxes(shown, [hues[number] for number, _ in shown]))
        stirred = [(number, body) for number, body in shown if number in state.moved]
        ink = tuple(part / 255 for part in bytes.fromhex(INK[1:]))
        outline = self._boxes(stirred, [ink] * len(stirred), solid=False)
        log.log("robot/moving", outline)
        ways = [
            [before.middle, body.middle]
            for number, body in stirred
            if (before := self._body(state.moved[number])) is not None
        ]
        log.log("robot/ways", rr.LineStrips3D(ways, radii=0.05))
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

    def _body(self, site: Site) -> Solid | None:
        if site not in self._solids_at:
            self._solids_at[site] = solid_of(self._scene, site)
        return self._solids_at[site]

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
            quaternions=[
                rr.Quaternion(xyzw=[0, 0, sin(body.angle / 2), cos(body.angle / 2)])
                for _, body in bodies
            ],
            colors=[tuple(round(255 * part) for part in hue) for hue in hues],
            labels=[body.word or str(number) for number, body in bodies]
            if named and solid
            else None,
            fill_mode="solid" if solid else "majorwireframe",
        )
