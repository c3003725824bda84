"""Nodes of module processes with a bug each, which the simulator must find."""

import msgspec

from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.node import HostNode
from cubepath.coordinator.simulation.network import Trace
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.messages import Bundle, Go, Message, Retransmit, decode, encode
from cubepath.protocol.wire.nodes import Effect


class WrongLine:
    """Counts how often a planted bug does what is wrong; the first times it may do what is right.

    `steps` has when it was to do so, in steps of the run whose trace is given.
    """

    def __init__(self) -> None:
        self.right = 0
        self.steps: list[int] = []
        self.trace = Trace()

    def again(self, right: int = 0) -> Trace:
        """Begin anew for another run, whose trace is returned; so often it does what is right."""
        self.right, self.trace, self.steps = right, Trace(), []
        return self.trace

    def acts(self) -> bool:
        """Return whether the bug does now what is wrong."""
        self.steps.append(len(self.trace.events))
        return len(self.steps) > self.right


WRONG = WrongLine()
"""That of the bug of the run that is played."""


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
        twice = self._awaits(bundle) and self._inbox.knows(bundle)
        if not (twice and WRONG.acts()):
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
        if not isinstance(message, Go) or not message.sent or not WRONG.acts():
            return message
        return msgspec.structs.replace(message, sent={})


class Raises(Faultless):
    """Raises what no node may raise when others miss something."""

    def changed(self, message: Message) -> Message:
        if isinstance(message, Retransmit) and WRONG.acts():
            raise KeyError(message.region)
        return message


class IsDeaf(Faultless):
    """Hears nothing after the first round."""

    def receive(self, key: str, data: bytes) -> list[Effect]:
        deaf = decode(data).round > 1 and WRONG.acts()
        return [] if deaf else super().receive(key, data)
