"""The contents of a recording, for people and for machines; nothing in it is checked here."""

from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any

import msgspec

from cubepath.coordinator.verification.partial import lacks, moves_in, whole_rounds
from cubepath.coordinator.verification.transcript import RECOVERED
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import counted, visible
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.recordings.cutting import FILTERED, SPLIT
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT, Counts
from cubepath.protocol.recordings.recording import Recording, recording_of
from cubepath.protocol.wire import messages as wire

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
    "keepers": int,
}
_GATHERED_FROM = ("reports", "commit", "commits")
"""The kinds of messages that carry moves where there are no edges."""
_ENDED = {
    "goal": "the goal was reached",
    "max-rounds": "the rounds were over",
    "failed": "it failed",
    "interrupted": "it was interrupted",
}
_NO_END = "its end is not on record"
_OF_A_PART = {
    FILTERED: "messages of the run were left out",
    SPLIT: "this is a part of a recording",
    LEFT_OUT[0]: "messages of the run were left out",
    LEFT_OUT[1]: "messages of the run were left out",
    RECOVERED: "this was recovered from a damaged file",
    ATTACHED: "the recorder may have left before the run ended",
}
"""Why the end may be missing, by the parameters that tell it."""


def info(recording: Recording | Source) -> dict[str, Any]:
    """Return the contents of a recording, or of its file, as JSON; what is not recorded is None.

    The numbers are those of its summary. If it has none, rounds and moves are counted from the
    coordinator's edges, or without those from what modules or keepers reported. Of a file that is
    whole only its end is read.

    >>> found = info("logs/golden/hex-5.mcap")
    >>> found["rounds"], found["moves"], found["ended"]
    (29, 28, 'goal')
    """
    recording = recording_of(recording)
    parameters = recording.parameters
    if recording.of_keys:
        return {
            "log": str(recording.path),
            "format": recording.format,
            "parameters": dict(parameters),
            **_amounts(recording),
        }
    summary, rounds, moves = _result(recording)
    known = (*_DESCRIBED, *_VERSIONS)
    return {
        "log": str(recording.path),
        "format": recording.format,
        "clock": recording.clock,
        **{key: _described(parameters, key) for key in _DESCRIBED},
        "processes": _described(counted_processes(recording), "processes"),
        "modules": len(recording.scene.start),
        "versions": {key: parameters[key] for key in _VERSIONS if key in parameters},
        "parameters": {key: value for key, value in parameters.items() if key not in known},
        "rounds": rounds,
        "moves": moves,
        **{key: getattr(summary, key, None) for key in _NUMBERS},
        **_schedule(summary),
        **_certificate(recording),
        "refused": _refused(recording),
        "ended": None if summary is None else summary.ended,
        "complete": summary is not None and not recording.problems and not lacks(recording),
        "error": None if summary is None else summary.error,
        **_amounts(recording),
    }


def _amounts(recording: Recording) -> dict[str, Any]:
    """Return how much there is of which messages, and what is damaged."""
    counts = recording.counts()
    first, last = counts.first_wall_ns, counts.last_wall_ns
    return {
        "messages": counts.messages,
        "kinds": _kinds(counts),
        "parts": dict(sorted(counts.parts.items())),
        "topics": counts.topics,
        "bytes": recording.size,
        "message_bytes": sum(kind.bytes for kind in counts.kinds.values()),
        "began": _moment(first),
        "seconds": 0.0 if first is None or last is None else round((last - first) / 1e9, 3),
        "problems": list(recording.problems),
    }


def counted_processes(recording: Recording) -> dict[str, str]:
    """Return the parameters of a run; one that waited for processes has those that joined it too.

    When the recording of such a run begins nobody knows how many there will be.
    """
    parameters = dict(recording.parameters)
    if "wait_for" in parameters and "processes" not in parameters:
        said = "requests/" if recording.clock == "free" else "ready/"
        joined = sum(topic.startswith(said) for topic in recording.topics())
        if joined:
            parameters["processes"] = str(joined)
    return parameters


def _described(parameters: Mapping[str, str], key: str) -> object:
    value = parameters.get(key)
    try:
        return None if value is None else _DESCRIBED[key](value)
    except ValueError:
        return value


def _result(recording: Recording) -> tuple[wire.Summary | None, int | None, int | None]:
    """Return the summary, and the numbers of rounds and moves, None if nothing tells them."""
    summary: wire.Summary | None = None
    for message in _decoded(recording, "summary"):
        if isinstance(message, wire.Summary):
            summary = message
    if summary is not None:
        return summary, summary.rounds, summary.moves
    edges: dict[int, int] = {}
    for message in _decoded(recording, "edges"):
        if isinstance(message, wire.Edges):
            edges[message.round] = len(message.moves)
    if edges:
        return None, len(edges), sum(edges.values())
    if any(recording.of_kind(*_GATHERED_FROM)):
        return None, whole_rounds(recording), moves_in(recording)
    return None, None, None


def _decoded(recording: Recording, kind: str) -> Iterator[wire.Message]:
    for record in recording.of_kind(kind):
        try:
            message = wire.decode(record.data)
        except InputError:
            continue  # left to `cubepath verify`
        yield message


def _schedule(summary: wire.Summary | None) -> dict[str, Any]:
    """Return the number of cubes of the schedule that was carried out, and where it stopped."""
    if summary is None or summary.schedule_cubes is None:
        return {}
    stopped: Any = msgspec.to_builtins(summary.schedule_stopped)
    return {"schedule_cubes": summary.schedule_cubes, "schedule_stopped": stopped}


def _certificate(recording: Recording) -> dict[str, Any]:
    """Return how many pairs of moves cancelled, and the length of the certificate's chain."""
    for message in _decoded(recording, "certificate"):
        if isinstance(message, wire.Certified):
            found = message.certificate
            return {"certificate": {"cancelled": len(found.cancelled), "chain": len(found.chain)}}
    return {}


def _refused(recording: Recording) -> list[dict[str, Any]]:
    """Return what was refused by sender and reason, with the first key and line, and how often."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    for message in _decoded(recording, "refused"):
        if isinstance(message, wire.Refused):
            entry = found.setdefault(
                (message.sender, message.reason),
                {"sender": message.sender, "reason": message.reason, "count": 0}
                | {"round": message.round, "key": message.key, "detail": message.detail},
            )
            entry["count"] += message.count
    return [found[key] for key in sorted(found)]


def _kinds(counts: Counts) -> dict[str, dict[str, int]]:
    return {
        name: {"messages": kind.messages, "bytes": kind.bytes}
        for name, kind in sorted(counts.kinds.items())
    }


def _moment(wall_ns: int | None) -> str | None:
    if wall_ns is None:
        return None
    try:
        return datetime.fromtimestamp(wall_ns / 1e9, UTC).isoformat(timespec="milliseconds")
    except (OverflowError, ValueError, OSError):
        return None  # the recorded time was not a valid one


def _ended(document: Mapping[str, Any]) -> str:
    ended, error = document["ended"], document["error"]
    if ended is None:
        parameters = document["parameters"]
        part = (why for key, why in _OF_A_PART.items() if key in parameters)
        return f"{_NO_END}: {next(part, 'the run was killed, or the file is damaged')}"
    return _ENDED[ended] + (f": {error}" if error not in (None, ended) else "")


def _known(count: int | None) -> object:
    return "unknown" if count is None else count


def _modules(document: Mapping[str, Any]) -> str:
    processes = document["processes"]
    where = "" if processes is None else f" in {processes or 'no other'} processes"
    return f"{document['modules']}{where}"


def render(document: Mapping[str, Any]) -> str:
    """Return the result of `info` as a readable table, with control characters shown."""
    rows: list[tuple[str, object]] = [("log", document["log"]), ("format", document["format"])]
    if "system" in document:
        rows += _run_rows(document)
    rows += [
        ("began", document["began"] or "unknown"),
        ("took", f"{document['seconds']:.3f} s"),
        ("messages", f"{document['messages']} on {document['topics']} topics"),
    ]
    rows += [
        ("refused", f"{each['count']} of {each['sender']}, {each['reason']}: {each['detail']}")
        for each in document.get("refused", ())
    ]
    rows += [
        (f"  {kind}", f"{found['messages']:>7}  {found['bytes']:>10} bytes")
        for kind, found in document["kinds"].items()
    ]
    rows += [
        (f"  {kind}", f"{found:>7}  in batches")
        for kind, found in document["parts"].items()
        if kind not in document["kinds"]
    ]
    rows.append(
        (
            "size",
            f"{document['bytes']} bytes, {document['message_bytes']} of messages before packing",
        )
    )
    rows += document["parameters"].items()
    if document.get("versions"):
        rows.append(("versions", ""))
        rows += [(f"  {name}", version) for name, version in document["versions"].items()]
    rows += [("problem", problem) for problem in document["problems"]] or [("problems", "none")]
    width = max(len(name) for name, _ in rows)
    return "\n".join(visible(f"{name:<{width}}  {value}".rstrip()) for name, value in rows)


def _run_rows(document: Mapping[str, Any]) -> list[tuple[str, object]]:
    """Return what is told of a run."""
    rows: list[tuple[str, object]] = [
        ("system", document["system"]),
        ("rule", f"{document['rule']}, seed {document['seed']}, hesitate {document['hesitate']}"),
        ("modules", _modules(document)),
        *([("keepers", document["keepers"])] if document["clock"] == "free" else []),
        ("ended", _ended(document)),
        ("complete", "yes" if document["complete"] else "no"),
        ("levels" if document["clock"] == "free" else "rounds", _known(document["rounds"])),
        ("moves", _known(document["moves"])),
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
        rows.append(("carried out", f"{counted(document['schedule_cubes'], 'cube')}{how}"))
    if "certificate" in document:
        certificate = document["certificate"]
        rows.append(
            (
                "certificate",
                f"{certificate['cancelled']} pairs cancelled, a chain of {certificate['chain']}",
            )
        )
    return rows
