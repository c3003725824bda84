"""Recordings replayed into the code under test: a function, or a rule."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, TypeVar

from cubepath.coordinator.runs.continuing import what_if
from cubepath.coordinator.runs.live import LiveReplay, replay_live
from cubepath.coordinator.testing.log import RunLog, What, pattern_of
from cubepath.coordinator.testing.wire_messages import RESULTS, WireMessage
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.given import function
from cubepath.protocol.wire.free_messages import free_key
from cubepath.protocol.wire.keys import key_of

T = TypeVar("T")
RUN = "replayed"
_POLL_S = 0.01


def replay_into(
    log: RunLog, to: Callable[[WireMessage], T], what: What = "", *, run: str = RUN, **pattern: Any
) -> list[T]:
    """Call a function with each message of a log, in its order; return what it returned.

    The bytes are those of the recording, and the keys those of a run of this name. What the
    coordinator found at the end was on no wire, and is left out. With `what` and the keys of
    `Pattern`, messages are those that they mean.
    """
    _check_log(log)
    function("to", to)
    meant = pattern_of(what, **pattern)
    return [
        to(_on_wire(each, run))
        for each in log.all_deliveries
        if each.kind not in RESULTS and meant.holds(each)
    ]


def _check_log(log: object) -> None:
    if not isinstance(log, RunLog):
        raise InputError(f"{log!r}: expected a Log")


def _on_wire(seen: WireMessage, run: str) -> WireMessage:
    message: Any = seen.message
    if message is None:
        return seen
    has_rounds = getattr(message, "round", None) is not None
    key = key_of(run, message) if has_rounds else free_key(run, message)
    return WireMessage(key, seen.data, seen.at_s)


def live_modules(
    log: RunLog, modules: Iterable[int] | None = None, *, diverging: bool = False, **options: Any
) -> LiveReplay:
    """Replay a log with these modules live, by default all, and the others as on record.

    The options are those of `cubepath.coordinator.replay_live`, such as ``rule``. AssertionError
    names the first divergence, or with `diverging` says that there was none.

    >>> log = RunLog.read("logs/golden/agv-6.mcap")
    >>> live_modules(log, [0, 1], processes=0).rounds
    20
    """
    __tracebackhide__ = True
    _check_log(log)
    found = replay_live(log.recording, modules, **options)
    if diverging and found.same:
        raise AssertionError(f"no divergence in {found.rounds} rounds, expected one")
    if not diverging and not found.same:
        raise AssertionError(f"the same for {found.rounds} rounds, then {found.divergence}")
    return found


def other_rule(
    log: RunLog,
    rule: str,
    *,
    from_round: int,
    failing: bool = False,
    out: Path | str | None = None,
    **options: Any,
) -> RunLog:
    """Go on from a round of a log with another rule; return the log of the new run.

    It is recorded in the file `out`, by default a new one in the folder ``logs``. The options are
    those of `cubepath.coordinator.what_if`. AssertionError if the run fails, or if it does not and
    is expected to (`failing`).

    >>> log = RunLog.read("logs/golden/agv-6.mcap")
    >>> other_rule(log, "random", from_round=5, max_rounds=9, processes=0, out="if.mcap").rounds
    9
    """
    __tracebackhide__ = True
    _check_log(log)
    outcome = what_if(log.recording, rule, from_round=from_round, log=out, **options)
    if (outcome.ended == "failed") is not failing:
        found = f"it ended: {outcome.ended}" if failing else outcome.error
        raise AssertionError(f"rule {rule} from round {from_round} on: {found}")
    return RunLog(outcome.recording())
