"""A module process: some modules of a run, one zenoh session, and a queue of what arrives.

Room: agents. Started as ``python -m cubepath.agents.processes.host`` with one line of JSON
(`Orders`) on standard input; it ends when it is told to, or when that input closes because its
parent is gone. Zenoh callbacks only enqueue; the loop does all the work, in the order of the queue.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Mapping
from itertools import chain
from queue import SimpleQueue

import msgspec
import zenoh

from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import Observation, goal_sets
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.schedule import scheduled
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.core.names import GeneratorPlacement
from cubepath.protocol.core.sites import Site
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.keys import heard_at, key_of, topic_key
from cubepath.protocol.wire.messages import Act, Go, Message, Observed, Ready, Reset, decode, encode
from cubepath.protocol.wire.sessions import open_client, put, subscribe

OUTSIDE = "outside"
"""Instead of a rule's name: the modules are driven from outside, by `Act` messages."""


TOLD = 4
"""Exit code of a process whose last line on standard error fully describes the error."""


class Orders(msgspec.Struct, frozen=True):
    """What a process is told at its birth."""

    endpoint: str
    run: str
    process: int
    modules: list[int]
    scene: str
    """The scene as TOML text: processes share no files."""
    rule: str
    seed: int
    hesitate: float
    note_length: int
    schedule: dict[int, dict[int, GeneratorPlacement]] | None = None
    """By module its own moves of a schedule, by round; the rule follows when that is over."""


class Host:
    """The modules of one process, which run until it is told to stop."""

    def __init__(self, orders: Orders) -> None:
        """Read the scene and the rule; nothing is opened yet."""
        self._orders = orders
        self._scene = scene_from_toml(orders.scene, "the orders")
        self._system = self._scene.system
        self._rule: RuleType | None = None
        if orders.rule != OUTSIDE:
            self._rule = rule_named(orders.rule, self._system)
        self._actors: dict[int, Actor] = {}
        self._cores: dict[int, ModuleCore] = {}
        self._queue: SimpleQueue[tuple[int | None, bytes]] = SimpleQueue()
        self._subscribers: dict[int, list[zenoh.Subscriber[None]]] = {}
        self._settling = False
        self._acts: dict[int, Act] = {}

    def run(self) -> None:
        """Join the run and serve until `Go` says "stop"."""
        orders = self._orders
        with open_client(orders.endpoint) as session:
            self._session = session
            topics = [("go", "*"), ("reset", "*")]
            if self._rule is None:
                topics += [("act", f"module_{module}") for module in orders.modules]
            control = [
                subscribe(session, topic_key(orders.run, kind, who), self._enqueue(None))
                for kind, who in topics
            ]
            self._join(orders.seed)
            while self._serve(*self._queue.get()):
                pass
            for subscriber in chain(control, *self._subscribers.values()):
                subscriber.undeclare()

    def _join(self, seed: int) -> None:
        """Put the modules at their start, with no memory, and say that they are ready."""
        orders, scene = self._orders, self._scene
        self._settling = False
        self._acts.clear()
        self._seed = seed
        rule, note_length = self._rule, orders.note_length
        if orders.schedule is not None:
            rule = scheduled(orders.schedule)
        if rule is not None:
            note_length = self._assign(rule)
        goals = goal_sets(scene)
        self._cores = {
            module: ModuleCore(
                scene.system,
                module=module,
                site=scene.start[module],
                goals=goals[module],
                seed=seed,
                note_length=note_length,
            )
            for module in orders.modules
        }
        for module, core in self._cores.items():
            self._listen(module, core.place)
        self._say(Ready(0, orders.process, "join"))

    def _assign(self, rule: RuleType, sites: Mapping[int, Site] | None = None) -> int:
        """Give every module an actor with this rule; return the length of its notes."""
        orders, scene = self._orders, self._scene
        self._actors = actors_for(
            scene,
            rule,
            seed=self._seed,
            hesitate=orders.hesitate,
            modules=orders.modules,
            sites=sites,
        )
        return rule.note_length(len(scene.start))

    def _end_schedule(self) -> None:
        """Let every module follow its rule from where it stands."""
        if self._rule is None or self._orders.schedule is None:
            return  # there is no schedule
        note_length = self._assign(
            self._rule, {module: core.site for module, core in self._cores.items()}
        )
        for core in self._cores.values():
            core.follow(note_length)

    def _enqueue(self, module: int | None) -> Callable[[zenoh.Sample], None]:
        def enqueue(sample: zenoh.Sample) -> None:
            self._queue.put((module, sample.payload.to_bytes()))

        return enqueue

    def _listen(self, module: int, place: Site) -> None:
        old = self._subscribers.get(module, [])
        self._subscribers[module] = [
            subscribe(self._session, key, self._enqueue(module))
            for key in heard_at(self._orders.run, self._system, place)
        ]
        for subscriber in old:
            subscriber.undeclare()

    def _say(self, *messages: Message) -> None:
        for message in messages:
            key = key_of(self._orders.run, self._system, message)
            if key is not None:
                put(self._session, key, encode(message))

    def _serve(self, module: int | None, data: bytes) -> bool:
        message = decode(data)
        if module is not None:
            self._say(*self._cores[module].hear(message))
            self._conclude()
        elif isinstance(message, Act):
            self._acts[message.module] = message
            self._claim_from_outside()
        elif isinstance(message, Reset):
            self._join(message.seed)
        elif isinstance(message, Go):
            self._go(message)
            return message.phase != "stop"
        return True

    def _go(self, go: Go) -> None:
        match go.phase:
            case "sense":
                for core in self._cores.values():
                    self._say(*core.sense(go.round))
                self._say(Ready(go.round, self._orders.process, "sense"))
            case "claim":
                self._choose(go.round)
            case "settle":
                for core in self._cores.values():
                    self._say(*core.arbitrate())
                self._settling = True
                self._conclude()
            case "over":
                self._end_schedule()
            case "stop":
                pass  # the loop ends

    def _choose(self, round_number: int) -> None:
        """Let actors claim; modules driven from outside send their observations."""
        for module, core in self._cores.items():
            if not self._actors:
                self._say(_observed(round_number, module, core.observation()))
                continue
            choice = self._actors[module].act(core.observation())
            self._say(*core.claim(choice.action, choice.note, choice.failed))
        if self._actors:
            self._say(Ready(round_number, self._orders.process, "claim"))

    def _claim_from_outside(self) -> None:
        if self._acts.keys() < self._cores.keys():
            return
        acts, self._acts = self._acts, {}
        for module, core in self._cores.items():
            act = acts[module]
            self._say(*core.claim(act.action, tuple(act.note)))
        self._say(Ready(acts[self._orders.modules[0]].round, self._orders.process, "claim"))

    def _conclude(self) -> None:
        if not self._settling or not all(core.finished for core in self._cores.values()):
            return
        self._settling = False
        for module, core in self._cores.items():
            place = core.place
            report = core.report()
            # Listen at the new place before reporting that the round is done: messages of the next
            # round must find the subscriber there.
            if core.place != place:
                self._listen(module, core.place)
            self._say(report)
        some = next(iter(self._cores.values()))
        self._say(Ready(some.round, self._orders.process, "settle"))


def _observed(round_number: int, module: int, seen: Observation) -> Observed:
    return Observed(
        round=round_number,
        module=module,
        observation=seen["observation"].tolist(),
        action_mask=seen["action_mask"].tolist(),
        notes=seen["notes"].tolist() if "notes" in seen else [],
    )


def _end_with_parent() -> None:
    # Not through sys.stdin: its lock would be held when the interpreter shuts down, and abort it.
    while os.read(0, 1):
        pass
    os._exit(3)


def main() -> int:
    """Read the orders and run; on failure print one line on standard error and return `TOLD`."""
    # The coordinator handles interrupts; a terminal sends them to every process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    orders = msgspec.json.decode(sys.stdin.buffer.readline(), type=Orders)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        Host(orders).run()
    except CubepathError as error:
        print(error, file=sys.stderr)
        return TOLD
    return 0


if __name__ == "__main__":
    sys.exit(main())
