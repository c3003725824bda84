"""The contents of a recording, for people and for machines; nothing in it is checked here.

Room: coordinator.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from typing import Any

import msgspec

from cubepath.protocol.core.control_characters import visible
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Certified, Edges, Summary, decode

_VERSIONS = ("cubepath", "python", "eclipse-zenoh", "mcap", "pettingzoo", "numpy", "platform")
_NUMBERS = ("reduced_moves", "cubes", "max_cube_dimension", "goal_reached", "path_digest")
_DESCRIBED: dict[str, Callable[[str], object]] = {
    "system": str,
    "family": str,
    "rule": str,
    "seed": int,
    "hesitate": float,
    "processes": int,
    "modules": int,
    "max_rounds": int,
}
_ENDED = {
    "goal": "the goal was reached",
    "max-rounds": "the rounds were over",
    "failed": "it failed",
    "interrupted": "it was interrupted",
    None: "its end is not on record: the run was killed, or the file is damaged",
}


def info(recording: Recording) -> dict[str, Any]:
    """Return the contents of a recording as one JSON document; what is not on record is None.

    The numbers are those of its summary. If it has none, rounds and moves are counted from the
    coordinator's edges.
    """
    parameters = recording.parameters
    summary, rounds, moves = _result(recording)
    walls = [record.wall_ns for record in recording.records]
    known = (*_DESCRIBED, *_VERSIONS)
    return {
        "log": str(recording.path),
        "format": recording.format,
        **{key: _described(parameters, key) for key in _DESCRIBED},
        "modules": len(recording.scene.start),
        "versions": {key: parameters[key] for key in _VERSIONS if key in parameters},
        "parameters": {key: value for key, value in parameters.items() if key not in known},
        "rounds": rounds,
        "moves": moves,
        **{key: getattr(summary, key, None) for key in _NUMBERS},
        **_schedule(summary),
        **_certificate(recording),
        "ended": None if summary is None else summary.ended,
        "complete": summary is not None and not recording.problems,
        "error": None if summary is None else summary.error,
        "messages": len(recording.records),
        "kinds": _kinds(recording),
        "topics": len({record.topic for record in recording.records}),
        "bytes": recording.size,
        "message_bytes": sum(len(record.data) for record in recording.records),
        "began": _moment(min(walls, default=None)),
        "seconds": round((max(walls) - min(walls)) / 1e9, 3) if walls else 0.0,
        "problems": list(recording.problems),
    }


def _described(parameters: Mapping[str, str], key: str) -> object:
    value = parameters.get(key)
    try:
        return None if value is None else _DESCRIBED[key](value)
    except ValueError:
        return value


def _result(recording: Recording) -> tuple[Summary | None, int, int]:
    """Return the summary, and the numbers of rounds and moves."""
    summary: Summary | None = None
    edges: dict[int, int] = {}
    for record in recording.of_kind("edges", "summary"):
        try:
            message = decode(record.data)
        except InputError:
            continue  # left to `cubepath verify`
        match message:
            case Summary():
                summary = message
            case Edges():
                edges[message.round] = len(message.moves)
            case _:
                pass
    if summary is not None:
        return summary, summary.rounds, summary.moves
    return None, len(edges), sum(edges.values())


def _schedule(summary: Summary | None) -> dict[str, Any]:
    """Return the number of cubes of the schedule that was carried out, and where it stopped."""
    if summary is None or summary.schedule_cubes is None:
        return {}
    stopped: Any = msgspec.to_builtins(summary.schedule_stopped)
    return {"schedule_cubes": summary.schedule_cubes, "schedule_stopped": stopped}


def _certificate(recording: Recording) -> dict[str, Any]:
    """Return how many pairs of moves cancelled, and the length of the certificate's chain."""
    for record in recording.of_kind("certificate"):
        try:
            message = decode(record.data)
        except InputError:
            continue  # left to `cubepath verify`
        if isinstance(message, Certified):
            found = message.certificate
            return {"certificate": {"cancelled": len(found.cancelled), "chain": len(found.chain)}}
    return {}


def _kinds(recording: Recording) -> dict[str, dict[str, int]]:
    found: dict[str, dict[str, int]] = {}
    for record in recording.records:
        kind = found.setdefault(record.kind, {"messages": 0, "bytes": 0})
        kind["messages"] += 1
        kind["bytes"] += len(record.data)
    return dict(sorted(found.items()))


def _moment(wall_ns: int | None) -> str | None:
    if wall_ns is None:
        return None
    try:
        return datetime.fromtimestamp(wall_ns / 1e9, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return None  # the recorded time was not a valid one


def render(document: Mapping[str, Any]) -> str:
    """Return the result of `info` as a readable table, with control characters shown."""
    ended = _ENDED[document["ended"]]
    rows: list[tuple[str, object]] = [
        ("log", document["log"]),
        ("format", document["format"]),
        ("system", document["system"]),
        ("rule", f"{document['rule']}, seed {document['seed']}, hesitate {document['hesitate']}"),
        ("modules", f"{document['modules']} in {document['processes'] or 'no other'} processes"),
        ("ended", ended + (f": {document['error']}" if document["error"] else "")),
        ("complete", "yes" if document["complete"] else "no"),
        ("rounds", document["rounds"]),
        ("moves", document["moves"]),
    ]
    if document["ended"] is not None:
        rows += [
            ("reduced moves", document["reduced_moves"]),
            ("cubes", document["cubes"]),
            ("largest cube", document["max_cube_dimension"]),
            ("goal", "reached" if document["goal_reached"] else "not reached"),
            ("path digest", document["path_digest"]),
        ]
    if "schedule_cubes" in document:
        stopped = document["schedule_stopped"]
        how = "" if stopped is None else f", stopped at round {stopped['round']}"
        rows.append(("carried out", f"{document['schedule_cubes']} cubes{how}"))
    if "certificate" in document:
        told = document["certificate"]
        rows.append(
            ("certificate", f"{told['cancelled']} pairs cancelled, a chain of {told['chain']}")
        )
    rows += [
        ("began", document["began"] or "unknown"),
        ("took", f"{document['seconds']:.3f} s"),
        ("messages", f"{document['messages']} on {document['topics']} topics"),
    ]
    rows += [
        (f"  {kind}", f"{found['messages']:>7}  {found['bytes']:>10} bytes")
        for kind, found in document["kinds"].items()
    ]
    rows.append(
        (
            "size",
            f"{document['bytes']} bytes, {document['message_bytes']} of messages before packing",
        )
    )
    rows += document["parameters"].items()
    rows += [(f"  {name}", version) for name, version in document["versions"].items()]
    rows += [("problem", problem) for problem in document["problems"]] or [("problems", "none")]
    width = max(len(name) for name, _ in rows)
    return "\n".join(visible(f"{name:<{width}}  {value}") for name, value in rows)
