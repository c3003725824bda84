"""A whole run in one thread, without zenoh and without faults: nodes, pacer and conductor.

What is put is heard by all who listen, in order. Before each message an intruder may tell any node
what it likes.
"""

from collections import deque
from collections.abc import Callable, Sequence
from random import Random

from cubepath.agents.processes.config import OUTSIDE, ProcessConfig
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.pacer import Pacer
from cubepath.agents.rules.registry import rule_named
from cubepath.coordinator.runs.conductor import Conductor
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import ChosenAction, Observations
from cubepath.protocol.wire.nodes import Effect, Ignore, Keep, Listen, Put, Timer

RUN = "run"
COORDINATOR = -1
Intruder = Callable[[], Sequence[tuple[int, str, bytes]]]
"""Returns what to tell which node now: its number, or that of the coordinator, a key and bytes."""
CASES = (
    ("hex:n=4", "chain"),
    ("agv-labelled:graph=grid3x3,n=3", "pibt"),
    ("agv:graph=C7,n=3", "tswap"),
    ("arms:n=1", "random"),
    ("arm:n=4", "random"),
    ("triangulation:n=6", "random"),
    ("words:word=abcab,relations=ab~ba+bc~cb", "random"),
    ("sliding:p=2,q=1,n=3", "random"),
    ("agv:graph=grid12x2,n=4", OUTSIDE),
    ("hex:n=5", OUTSIDE),
)
"""Systems of every kind with a rule each, or driven from outside."""


class Driven:
    """A run of some rounds."""

    def __init__(self, spec: str, rule: str, *, processes: int = 3, seed: int = 5) -> None:
        self.scene = scene_from_spec(spec)
        self.outside = rule == OUTSIDE
        modules_of = dealt(self.scene, min(processes, len(self.scene.start)))
        system = self.scene.system
        judge = Judge(RUN, modules_of, system)
        note_length = 0
        if not self.outside:
            note_length = rule_named(rule, system).note_length(len(self.scene.start))
        judge.note_length = note_length
        self.nodes = [
            HostNode(
                ProcessConfig(
                    "", RUN, process, modules, modules_of, "", rule, seed, 0.0, note_length
                ),
                self.scene,
            )
            for process, modules in enumerate(modules_of)
        ]
        self.conductor = Conductor(self.scene, max_rounds=1000, record=lambda _: None)
        self.conductor.gatherer.plausibility.know(modules_of, seed)
        self.pacer = Pacer(
            RUN, modules_of, judge=judge, check=self.conductor.gatherer.plausibility.check
        )
        self.put: list[tuple[str, bytes]] = []
        """The last messages that were put."""
        self.names: list[str] = [f"process_{process}" for process in range(len(modules_of))]
        self._seed = seed
        self._queue: deque[tuple[int, str, bytes]] = deque()
        self._listening: list[set[str]] = [set() for _ in self.nodes]
        self._observed: dict[int, ChosenAction] = {}
        self._timers: set[int] = set()
        self.say_nothing = False
        """Whether what is put gets nowhere."""

    def start(self) -> None:
        """Let all begin."""
        self._carry_out(COORDINATOR, self.pacer.start())
        for number, node in enumerate(self.nodes):
            self._carry_out(number, node.start())

    def play(self, rounds: int, intruder: Intruder = tuple) -> str:
        """Play some rounds, or to the goal; return the digest of the edge path."""
        self.start()
        self._until_idle(intruder)
        for _ in range(rounds):
            if self.conductor.gatherer.reached:
                break
            self._carry_out(COORDINATOR, self.pacer.begin_round(driven=self.outside))
            self._until_idle(intruder)
            if self.outside:
                acts = [self._observed[module] for module in range(len(self.scene.start))]
                self._carry_out(COORDINATOR, self.pacer.act(acts))
                self._until_idle(intruder)
        return self.conductor.gatherer.digest

    def _until_idle(self, intruder: Intruder) -> None:
        while not (self.pacer.idle and not self._queue):
            for number, key, data in intruder():
                self.tell(number, key, data)
            if self._queue:
                self.tell(*self._queue.popleft())
            else:
                self.tick()

    def tick(self) -> None:
        """Let every timer run out."""
        for number in sorted(self._timers):
            self._timers.discard(number)
            node = self.pacer if number == COORDINATOR else self.nodes[number]
            self._carry_out(number, node.tick())

    def tell(self, number: int, key: str, data: bytes) -> None:
        """Let a node take a message."""
        node = self.pacer if number == COORDINATOR else self.nodes[number]
        self._carry_out(number, node.receive(key, data))

    def _carry_out(self, number: int, effects: Sequence[Effect]) -> None:
        for effect in effects:
            match effect:
                case Put(key=key, data=data):
                    self.put = [*self.put[-63:], (key, data)]
                    self._spread(number, key, data)
                case Keep(message=message) if number == COORDINATOR:
                    self.conductor.hear(message)
                    if isinstance(message, Observations):
                        for part in message.parts:
                            legal = [n for n, may in enumerate(part.action_mask) if may]
                            # Of its own: whoever is heard first must not change what is drawn.
                            own = Random(f"{self._seed}/{part.round}/{part.module}")  # noqa: S311
                            action = own.choice(legal)
                            self._observed[part.module] = ChosenAction(
                                part.round, part.module, action, []
                            )
                case Listen(keys=keys) if number != COORDINATOR:
                    self._listening[number] |= set(keys)
                case Ignore(keys=keys):
                    self._listening[number] -= set(keys)
                case Timer(seconds=seconds):
                    (self._timers.add if seconds is not None else self._timers.discard)(number)
                case _:
                    pass

    def _spread(self, sender: int, key: str, data: bytes) -> None:
        if self.say_nothing:
            return
        if sender != COORDINATOR:
            self._queue.append((COORDINATOR, key, data))
        for number, keys in enumerate(self._listening):
            if number != sender and any(_matches(each, key) for each in keys):
                self._queue.append((number, key, data))


def _matches(expression: str, key: str) -> bool:
    return (
        key.startswith(expression.removesuffix("**")) if "**" in expression else key == expression
    )


def fate(driven: Driven, rounds: int, intruder: Intruder) -> str:
    """Play with an intruder who may end the run; return its digest, or the line that ends it."""
    try:
        return driven.play(rounds, intruder)
    except CubepathError as error:
        return str(error)
