"""The coordinator of a simulated run as one node: the pacing node, and what a run does with it.

It does what a run over zenoh does between the pacing node and the conductor.
"""

from __future__ import annotations

from collections.abc import Callable

from cubepath.agents.processes.pacer import Pacer
from cubepath.coordinator.runs.conductor import Conductor, Ending
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.messages import Message
from cubepath.protocol.wire.nodes import Effect, End, Keep

Record = Callable[[bytes, Message], None]


class Coordinator:
    """Paces the processes round by round until the run has come to its end."""

    def __init__(self, pacer: Pacer, conductor: Conductor, record: Record) -> None:
        """Begin; `record` is given what belongs on record."""
        self.ending: Ending | None = None
        """How the run has ended; None while it goes on."""
        self._pacer = pacer
        self._conductor = conductor
        self._record = record

    def start(self) -> list[Effect]:
        """Wait for the processes."""
        return self._guarded(self._pacer.start)

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message."""
        return self._guarded(lambda: self._pacer.receive(key, data))

    def tick(self) -> list[Effect]:
        """Take note that the timer has run out."""
        return self._guarded(self._pacer.tick)

    def died(self, process: int, error: CubepathError | None) -> list[Effect]:
        """End the run since a process has died, of an error or of a signal."""
        if error is None:
            error = self._pacer.died(process, "killed by signal 9")
        return self._ended(self._conductor.failed(str(error)))

    def _guarded(self, do: Callable[[], list[Effect]]) -> list[Effect]:
        try:
            return self._go_on(do())
        except CubepathError as error:
            return self._ended(self._conductor.failed(str(error)))

    def _go_on(self, effects: list[Effect]) -> list[Effect]:
        """Keep what belongs on record; begin the next round when one is over, or end the run."""
        done: list[Effect] = []
        while True:
            self._keep(effects)
            done += effects
            if not self._pacer.idle:
                return done
            ending = self._conductor.between(self._pacer.round, lambda: None)
            if ending is not None:
                return [*done, *self._ended(ending)]
            effects = self._pacer.begin_round()

    def _ended(self, ending: Ending) -> list[Effect]:
        self.ending = ending
        effects = self._pacer.stop()
        self._keep(effects)
        return [*effects, End()]

    def _keep(self, effects: list[Effect]) -> None:
        for effect in effects:
            if isinstance(effect, Keep):
                self._record(effect.data, effect.message)
                self._conductor.hear(effect.message)
