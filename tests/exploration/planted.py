"""Nodes of module processes with a bug each, which the simulator must find."""

import msgspec

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.messages import Bundle, Go, Message, Retransmit, decode, encode
from cubepath.protocol.wire.nodes import Effect


class Faultless:
    """The node as it is, with one place for a bug."""

    def __init__(self, orders: ProcessConfig, scene: Scene) -> None:
        self._node = HostNode(orders, scene)

    def start(self) -> list[Effect]:
        return self._node.start()

    def tick(self) -> list[Effect]:
        return self._node.tick()

    def receive(self, key: str, data: bytes) -> list[Effect]:
        return self._node.receive(key, encode(self.changed(decode(data))))

    def changed(self, message: Message) -> Message:
        return message


class _Twice(HostNode):
    """Keeps what comes twice as if it were two messages."""

    def _hear(self, bundle: Bundle) -> list[Effect]:
        if not self._awaits(bundle) or not self._inbox.knows(bundle):
            return super()._hear(bundle)
        self._judge.check(bundle)
        self._inbox.keep(msgspec.structs.replace(bundle, number=bundle.number + 100))
        return self._try_to_begin()


class TakesDoubles(Faultless):
    """Takes what is said to it twice for two messages."""

    def __init__(self, orders: ProcessConfig, scene: Scene) -> None:
        super().__init__(orders, scene)
        self._node = _Twice(orders, scene)


class ForgetsCounts(Faultless):
    """Begins a phase without what it has missed of the one before."""

    def changed(self, message: Message) -> Message:
        return msgspec.structs.replace(message, sent={}) if isinstance(message, Go) else message


class Raises(Faultless):
    """Raises what no node may raise when others miss something."""

    def changed(self, message: Message) -> Message:
        if isinstance(message, Retransmit):
            raise KeyError(message.region)
        return message


class IsDeaf(Faultless):
    """Hears nothing after the first round."""

    def receive(self, key: str, data: bytes) -> list[Effect]:
        return [] if decode(data).round > 1 else super().receive(key, data)
