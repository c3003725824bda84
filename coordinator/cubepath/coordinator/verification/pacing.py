"""The pace of a run: each phase begins once, in its order, when every process has answered.

Part of `cubepath verify`. It follows the messages in the order in which they were recorded, which
is the order in which the coordinator sent and received them, and holds one phase at a time.
docs/protocol.md has the phases.
"""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TypeAlias

from cubepath.coordinator.verification.parameters import processes_of
from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.recordings.description import ATTACHED
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire import messages as wire

CHECK = "pacing"
_AFTER = {
    "join": {("sense", 1), ("over", 0)},
    "sense": {("claim", 0), ("observe", 0)},
    "observe": {("claim", 0)},
    "claim": {("settle", 0)},
    "settle": {("sense", 1), ("over", 0)},
    "over": {("sense", 1)},
}
"""The phases that may follow a phase, each with how many rounds later."""
_COUNTING = {"sense": ("claim", "observe"), "claim": ("settle",)}
"""The phases before which messages are counted, each with those that carry the counts."""

_Answer: TypeAlias = wire.Ready | wire.Bundle | wire.Reports | wire.Observations
_Said: TypeAlias = _Answer | wire.Retransmit | wire.Waiting


class Pacing:
    """The phases of a run as they are recorded; `fail` is called for each violation."""

    def __init__(self, recording: Recording, fail: Fail) -> None:
        """Begin before the first message, when processes are still to join."""
        self.phase = "join"
        self.round = 0
        """The phase that was begun last, and its round."""
        self._fail = fail
        known = processes_of(recording)
        self._processes = None if known is None else range(known)
        self._joined: set[int] = set()
        self._attached = ATTACHED in recording.parameters
        """Whether somebody came to listen, maybe after the processes had joined."""
        self._stopped = False
        self._begin()

    def _begin(self) -> None:
        self._ready: dict[int, Mapping[str, int]] = {}
        self._sent: dict[int, set[tuple[str, int]]] = {}
        self._reported: set[int] = set()

    def take(self, message: wire.Message) -> None:
        """Take the next message in the recording."""
        match message:
            case wire.Go():
                self._go(message)
            case wire.Ready() | wire.Bundle() | wire.Reports() | wire.Observations():
                if self._is_of_a_process(message):
                    self._answer(message)
            case wire.Retransmit() | wire.Waiting():
                if self._is_of_a_process(message) and message.round != self.round:
                    self._wrong(message, f"in round {self.round}")
                elif message.phase not in _AFTER:
                    self._wrong(message, "which is none")
            case _:
                pass  # a part by itself, or what the coordinator says of the run

    def _is_of_a_process(self, message: _Said) -> bool:
        if self._processes is None or message.process in self._processes:
            return True
        self._wrong(message, "which is no process of the run")
        return False

    def _wrong(self, message: _Said, why: str) -> None:
        kind = type(message).__name__.lower()
        phase = getattr(message, "phase", None)
        of = "" if phase is None else f" of phase {phase}"
        self._fail(CHECK, f"round {message.round}, process_{message.process}: {kind}{of}, {why}")

    def _answer(self, message: _Answer) -> None:
        process = message.process
        match message:
            case wire.Ready(phase=phase) | wire.Bundle(phase=phase):
                pass
            case wire.Reports():
                phase = "settle"
            case wire.Observations():
                phase = "observe"
        if (message.round, phase) != (self.round, self.phase):
            self._wrong(message, f"in phase {self.phase} of round {self.round}")
            return
        match message:
            case wire.Ready(sent=counts):
                doubled = process in self._ready
                self._ready[process] = _counts(counts)
                if phase == "join":
                    self._joined.add(process)
            case wire.Bundle(region=region, number=number):
                known = self._sent.setdefault(process, set())
                doubled = (region, number) in known
                known.add((region, number))
            case _:
                doubled = process in self._reported
                self._reported.add(process)
        if doubled:
            self._wrong(message, "a second time")

    def _go(self, go: wire.Go) -> None:
        where = f"round {go.round}: go {go.phase}"
        if go.phase == "stop":
            if self._stopped or go.round != self.round:
                self._fail(CHECK, f"{where} in round {self.round}, or a second time")
            self._stopped = True
            return
        if self._stopped:
            self._fail(CHECK, f"{where}, after all were ordered to stop")
        if (go.phase, go.round - self.round) not in _AFTER[self.phase]:
            self._fail(CHECK, f"{where} after phase {self.phase} of round {self.round}")
        unheard = self._attached and self.phase == "join"
        why = None if unheard else self.unfinished()
        if why is not None:
            self._fail(CHECK, f"{where}, but {why}")
        counts: Counter[str] = Counter()
        if go.phase in _COUNTING.get(self.phase, ()):
            for counted in self._ready.values():
                counts.update(counted)
        if _counts(go.sent) != dict(counts):
            self._fail(
                CHECK, f"{where} counts {_counts(go.sent)} messages, said were {dict(counts)}"
            )
        self.phase, self.round = go.phase, go.round
        self._begin()

    def unfinished(self) -> str | None:
        """Return in one line what the phase that was begun last still lacks; None if nothing."""
        expected: Iterable[int] = self._joined if self._processes is None else self._processes
        for process in sorted(expected):
            name = f"process_{process}"
            if process not in self._ready:
                return f"{name} has not answered phase {self.phase} of round {self.round}"
            if self.phase in ("settle", "observe") and process not in self._reported:
                what = "reports" if self.phase == "settle" else "observations"
                return f"{name} has sent no {what} in round {self.round}"
            counts = Counter(region for region, _ in self._sent.get(process, ()))
            if counts != self._ready[process]:
                return (
                    f"{name} counts {dict(self._ready[process])} messages in phase {self.phase} of"
                    f" round {self.round}, on record are {dict(sorted(counts.items()))}"
                )
        return None

    @property
    def is_begun(self) -> bool:
        """Return whether any process has been heard of."""
        return bool(self._ready or self._sent) or self.round > 0

    def missing(self) -> int:
        """Return how many messages of the last phase were counted, and are not recorded."""
        return sum(
            max(0, sum(counts.values()) - len(self._sent.get(process, ())))
            for process, counts in self._ready.items()
        )


def _counts(counts: Mapping[str, int]) -> dict[str, int]:
    return {region: count for region, count in sorted(counts.items()) if count}
