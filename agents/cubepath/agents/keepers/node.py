"""A keeper as a node: strict decoding, keys, and ticks."""

from collections.abc import Sequence

from cubepath.agents.keepers.keeper import Keeper
from cubepath.protocol.wire import free_messages
from cubepath.protocol.wire.messages import Go, encode
from cubepath.protocol.wire.nodes import BatchNode, Effect, End, Listen, Put, Timer
from cubepath.protocol.wire.outgoing_log import OutgoingLog

TICK_S = 0.05


class KeeperNode(BatchNode):
    """A keeper between the wire and its own machine; it serves until `Go` says "stop"."""

    def __init__(
        self,
        keeper: Keeper,
        run: str,
        modules_of: Sequence[Sequence[int]] = (),
        incarnation: int = 1,
    ) -> None:
        """Know which modules each process may speak for."""
        self.keeper = keeper
        self._outgoing = OutgoingLog(run, incarnation)
        self._run = run
        self._process_of = {
            module: process for process, modules in enumerate(modules_of) for module in modules
        }
        self._ticking = False

    def start(self) -> list[Effect]:
        """Listen, and show the result of anything that was under way before."""
        return [Listen(free_messages.heard_by_keeper(self._run, self.keeper.me)), *self._effects()]

    def receive_all(self, messages: Sequence[tuple[str, bytes]]) -> list[Effect]:
        """Take messages; what follows from all of them is one message to each receiver.

        Anything else has no effect except that it is counted.
        """
        effects: list[Effect] = []
        for key, data in messages:
            message = free_messages.read_free(self._run, key, data)
            if isinstance(message, Go) and message.phase == "stop":
                return [*effects, *self._effects(), Timer(None), End()]
            if isinstance(message, free_messages.RetransmitRange):
                effects += self._outgoing.retransmit(message)
            else:
                self._take(message)
        return effects + self._effects()

    def _take(self, message: free_messages.FreeMessage | None) -> None:
        keeper = self.keeper
        match message:
            case free_messages.Requests(process=process, keeper=keeper.me, parts=parts):
                for part in parts:
                    if self._may_speak(process, part):
                        keeper.ask(process, part)
                    else:
                        keeper.refused += 1
            case free_messages.Forwards(keeper=other, to=keeper.me, parts=parts):
                for each in parts:
                    keeper.hear(other, each)
            case free_messages.CommitQuery(keeper=keeper.me, serial=serial, recorded=recorded):
                keeper.fetch(serial, recorded)
            case Go():
                pass  # for modules
            case _:
                keeper.refused += 1

    def tick(self) -> list[Effect]:
        """Ask for what is due."""
        self._ticking = False
        self.keeper.tick()
        return self._effects()

    def _may_speak(self, process: int, part: object) -> bool:
        if not isinstance(part, free_messages.Attempt | free_messages.EnterRequest):
            return True
        return self._process_of.get(part.module) == process

    def _effects(self) -> list[Effect]:
        effects: list[Effect] = [self._put(message) for message in self.keeper.outgoing()]
        if self.keeper.busy and not self._ticking:
            self._ticking = True
            effects.append(Timer(TICK_S))
        return effects

    def _put(self, message: free_messages.FreeMessage) -> Put:
        match message:
            case free_messages.Forwards() | free_messages.Replies() | free_messages.TileUpdate():
                return self._outgoing.append(message)
            case free_messages.CommitLog():
                return self._outgoing.stamp(message)
            case _:
                return Put(free_messages.free_key(self._run, message), encode(message))
