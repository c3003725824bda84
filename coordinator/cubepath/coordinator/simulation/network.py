"""A simulated wire: nodes in processes, routers, links with delays and faults, virtual time.

One thread processes a heap of events, ordered by time and then by a number; nothing depends on the
clock, a hash or the order of a set. A message travels from its sender to the router and from there
to every listener but the sender. Links keep the order of messages unless a fault changes it. With
hosts, each has a router, and a partition is between hosts.

Events are kept in order as a trace, from which pictures are drawn: the same seed gives the same
trace.
"""

from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from heapq import heappop, heappush
from typing import Any, Literal, TypeAlias

from cubepath.coordinator.simulation.faults import ROUTER, SECOND_US, SLOW_MESSAGES, Fault
from cubepath.protocol.core.errors import CubepathError
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Keep, Listen, Node, Put, Timer

Fate: TypeAlias = Literal["arrived", "lost", "second"]
"""What became of a message on its way to one receiver; "second" is the copy of another."""


@dataclass(frozen=True, slots=True)
class Arrow:
    """One message on its way to one receiver; a message lost before the router has no receiver.

    `end_us` is when it arrived, or when it was lost.
    """

    begin_us: int
    end_us: int
    sender: str
    receiver: str | None
    key: str
    data: bytes
    fate: Fate


@dataclass(frozen=True, slots=True)
class Span:
    """A fault of a process or of the router, from when to when; without an end it is a crash."""

    begin_us: int
    end_us: int | None
    process: str
    kind: str


@dataclass(frozen=True, slots=True)
class Remark:
    """Something that a process did at one moment, as its end."""

    at_us: int
    process: str
    text: str


@dataclass(frozen=True, slots=True)
class Event:
    """One step of a run: what it is about, and the message, if there is one."""

    at_us: int
    process: str
    what: str
    """What a process does; empty if none does anything, as while a message is on its way."""
    sender: str
    put: Put | None
    fired: int
    """How many faults had happened before it."""


@dataclass(slots=True)
class Trace:
    """Everything that happened, in the order in which it was known."""

    events: list[Event] = field(default_factory=list)
    """By step, from the first on."""
    arrows: list[Arrow] = field(default_factory=list)
    spans: list[Span] = field(default_factory=list)
    remarks: list[Remark] = field(default_factory=list)


HOP_US = 100
"""How long a message takes to the router, or from it, at least; up to twice as long."""
SERVE_US, PUT_US = 20, 50
"""How long a process takes for a message, and for each put."""
NOTICE_US = 50_000
"""How long it takes until a dead process is noticed."""
RECONNECT_US = 10_000
"""How long it takes at most until a process finds the router that is back."""
EVERYTHING = "/**"
CUTS = ("cut", "torn", "leave")
"""Faults that end a process after it has taken a message: before it has sent all that follows,
before it has written all of it, or after both."""
STANDING = ("pause", "slow", "stall", "jump", "twin")
"""Faults that a process survives; after the last it has a successor."""

FaultAt: TypeAlias = "Callable[[str, int], Fault | None]"
"""Returns the fault at a place and count, as `Faults.at`."""
Take: TypeAlias = Callable[[Node], list[Effect]]
"""What the node of a process does with what has come."""
Tear: TypeAlias = Callable[[int], bool]
"""Undoes what a process has written in this step, from one record on, which a number decides;
returns whether there was any."""
Through: TypeAlias = Callable[[str, Put], "Put | None"]
"""Is shown what the process of a name puts; returns what goes onto the wire instead of it."""
Died: TypeAlias = Callable[[int, "CubepathError | None"], list[Effect]]
"""Called with the number of a process that has died, from 0, and the error; None for a signal."""


class EndlessRun(Exception):  # noqa: N818 - named for what happened
    """A simulated run did not come to its end within its steps or its virtual time."""


class NodeError(Exception):
    """A node raised what no node may raise; the message says which node and what."""


@dataclass(slots=True)
class _Link:
    """A link between a process and its router, in one direction."""

    name: str
    salt: int
    """Tells its small delays from those of others."""
    count: int = 0
    """The number of messages so far."""
    last_us: int = 0
    """When the last of them arrives."""
    slow_us: int = 0
    slow_left: int = 0
    """How many messages are still slow on it, and how slow."""


@dataclass(slots=True)
class SimulatedProcess:
    """A process that holds a node: what it has received, and how it is connected."""

    name: str
    number: int
    make: Callable[[], Node]
    node: Node
    tear: Tear | None = None
    alive: bool = True
    gone: bool = False
    """Whether it is dead and does not come back."""
    connected: bool = True
    life: int = 0
    """How often it has died: what was sent to it before is lost."""
    inbox: deque[Take] = field(default_factory=deque)
    serving: bool = False
    free_us: int = 0
    slow_us: int = 0
    slow_left: int = 0
    taken: int = 0
    timers: int = 0
    """Counts the timers set; only the last of them ticks."""
    listening: dict[str, None] = field(default_factory=dict)
    up: _Link = field(init=False)
    down: _Link = field(init=False)
    host: int = 0
    """The host whose router it is connected to."""
    replaced: bool = False
    """Whether another has taken its place while it slept: faults by its name are that one's."""
    declared_us: int = 0
    """When the last `Listen` or `Ignore` reaches the router."""

    def __post_init__(self) -> None:
        self.up = _Link(f"{self.name} up", 2 * self.number + 1)
        self.down = _Link(f"{self.name} down", 2 * self.number)


@dataclass(slots=True)  # not frozen: that would take three times as long to make
class _Letter:
    """What is under way: from whom, since when, and in which life of the sender's router."""

    sender: SimulatedProcess
    effect: Put | Listen | Ignore
    sent_us: int
    router_life: int

    def __call__(self, node: Node) -> list[Effect]:
        """Let the node of a receiver take it."""
        put = self.effect
        return node.receive(put.key, put.data) if isinstance(put, Put) else []


class SimulatedNetwork:
    """Processes and the router between them; `run` carries out what happens, in order."""

    def __init__(
        self, faults: FaultAt, seed: int, trace: Trace | None = None, hosts: int = 0
    ) -> None:
        """Begin at time zero; the seed is that of the small differences between delays.

        Processes are dealt to the hosts in turn. Without hosts there is one router, and a partition
        may be between any processes.
        """
        self.now_us = 0
        self.steps = 0
        self.fired: list[Fault] = []
        self.met = Counter[tuple[str, str]]()
        """By kind and state of what they struck, by `state_of`, how many faults there were."""
        self.state_of: Callable[[Fault], str] = lambda _: ""
        self.ended: CubepathError | None = None
        """The error with which the first process ended, if it did."""
        self._over = False
        self._faults = faults
        self._seed = seed
        self._trace = trace
        self._events: list[tuple[int, int, Callable[..., None], tuple[Any, ...]]] = []
        self._count = 0
        self._processes: list[SimulatedProcess] = []
        self._tables: list[dict[str, None]] = []
        """By process the keys that the router knows that it listens to."""
        self._exact: dict[str, dict[int, None]] = {}
        self._below: dict[str, dict[int, None]] = {}
        self._routed = 0
        self._hosts = hosts
        self._router_lives = [0] * max(1, hosts)
        """How often each router has died: what was under way before is lost."""
        self._down: set[int] = set()
        """The routers that are dead now."""
        self._died: Died | None = None
        self._routes: dict[str, tuple[int, ...]] = {}
        """By key who listens, as long as that does not change."""
        self._parted_us = 0
        """Until when some processes do not hear the others."""
        self._sides: list[bool] = []
        """By host on which side of the partition it is; without hosts, by process."""
        self._one_way = False
        self._through: Through | None = None
        self._after: Callable[[], None] | None = None
        self._branches: tuple[int, Callable[[], int]] = 0, lambda: seed

    def add(
        self, name: str, make: Callable[[], Node], start_us: int = 0, *, tear: Tear | None = None
    ) -> None:
        """Add a process that starts at a time; the end of the first is the end of the run."""
        process = self._joined(name, make, make(), tear)
        self._at(start_us, self._start, process, process.life)

    def _joined(
        self, name: str, make: Callable[[], Node], node: Node, tear: Tear | None = None
    ) -> SimulatedProcess:
        process = SimulatedProcess(name, len(self._processes), make, node, tear)
        process.host = process.number % len(self._router_lives)
        self._processes.append(process)
        self._tables.append({})
        return process

    def _start(self, process: SimulatedProcess, life: int) -> None:
        if life == process.life:  # it may have died, and come back, before it was to start
            self._take(process, lambda node: node.start())

    def on_death(self, died: Died) -> None:
        """Notify the first process when another has died; those after it count from 0."""
        self._died = died

    @property
    def gone(self) -> list[str]:
        """Return the names of the processes that are dead and do not come back."""
        return [process.name for process in self._processes if process.gone]

    @property
    def away(self) -> list[str]:
        """Return the names of those that do."""
        return [
            each.name for each in self._processes if not (each.alive or each.gone or each.replaced)
        ]

    def watch(self, through: Through, after: Callable[[], None]) -> None:
        """Let everything that is put go through a function, and call another after each event."""
        self._through, self._after = through, after

    def fire(self, fault: Fault) -> None:
        """Note that a fault comes to pass."""
        self.fired.append(fault)
        self.met[fault.kind, self.state_of(fault)] += 1

    def branch(self, step: int, begin: Callable[[], int]) -> None:
        """Let delays be those of another seed from a step on, which `begin` returns then."""
        self._branches = step, begin

    def lied(self, name: str, fault: Fault) -> None:
        """Note that a process has told a lie."""
        self.fire(fault)
        self._remark(name, fault.kind.replace("-", "s: ", 1))

    def stop(self) -> None:
        """End the run here, whatever its nodes would do next."""
        self._over = True

    def run(self, most_steps: int, most_us: int) -> None:
        """Carry out what happens until the first process has ended.

        RanAway if it does not end, NodeError if a node raises what is no CubepathError.
        """
        while not self._over:
            if not self._events:
                raise EndlessRun(f"nothing more happens after {self._clock()}")
            time_us, _, act, given = heappop(self._events)
            self.now_us = time_us
            self.steps += 1
            if self.steps == self._branches[0]:
                self._seed = self._branches[1]()
            if self._trace is not None:
                self._trace.events.append(self._event(act.__name__, *given))
            if self.steps > most_steps or time_us > most_us:
                raise EndlessRun(f"no end after {self.steps} steps, {self._clock()}")
            act(*given)
            if self._after is not None:
                self._after()

    def _clock(self) -> str:
        return f"{self.now_us / SECOND_US:.3f} s of virtual time"

    def _at(self, time_us: int, act: Callable[..., None], *given: Any) -> None:
        self._count += 1
        heappush(self._events, (time_us, self._count, act, given))

    # Processes.

    def _take(self, process: SimulatedProcess, take: Take) -> None:
        process.inbox.append(take)
        if not process.serving:
            process.serving = True
            self._at(max(self.now_us, process.free_us), self._serve, process, process.life)

    def _serve(self, process: SimulatedProcess, life: int) -> None:
        if process.life != life or not process.alive:
            return
        if self.now_us < process.free_us:
            self._at(process.free_us, self._serve, process, life)
            return
        nth = process.taken
        process.taken += 1
        fault = None if process.replaced else self._faults(process.name, nth)
        cut = fault if fault is not None and fault.kind in CUTS else None
        if fault is not None and cut is None and self._strike(process, fault):
            return
        take = process.inbox.popleft()
        cost = SERVE_US
        if process.slow_left:
            process.slow_left -= 1
            cost = process.slow_us
        process.free_us = self.now_us + cost
        self._act(process, take, cut)
        process.serving = process.alive and bool(process.inbox)
        if process.serving:
            self._at(process.free_us, self._serve, process, life)

    def _act(self, process: SimulatedProcess, take: Take, cut: Fault | None = None) -> None:
        try:
            effects = take(process.node)
        except CubepathError as error:
            self._end(process, error)
            return
        except Exception as error:
            raise _node_error(process, error) from error
        if cut is not None:
            cut, effects = self._cut_short(process, cut, effects)
        at_us = self.now_us
        for effect in effects:
            if process.alive:
                self._carry_out(process, effect, at_us)
            if isinstance(effect, Put):
                at_us += PUT_US
        process.free_us = max(process.free_us, at_us)
        if cut is not None and process.alive:
            self._kill(process, cut)

    def _cut_short(
        self, process: SimulatedProcess, cut: Fault, effects: list[Effect]
    ) -> tuple[Fault | None, list[Effect]]:
        """Return what follows from a step; and the fault, if there is anything that it cuts."""
        number = self._noise(process.number, process.taken)
        if cut.kind == "cut":
            return cut, effects[: number % (len(effects) + 1)]
        if cut.kind == "torn":
            torn = process.tear is not None and process.tear(number)
            return (cut, []) if torn else (None, effects)
        return cut, effects

    def _carry_out(self, process: SimulatedProcess, effect: Effect, at_us: int) -> None:
        match effect:
            case Put():
                put = effect if self._through is None else self._through(process.name, effect)
                if put is not None:
                    self._send(process, put, at_us)
            case Listen():
                self._will_hear(process, effect.keys)
                self._send(process, effect, at_us)
            case Ignore():
                self._will_ignore(process, effect.keys)
                self._send(process, effect, at_us)
            case Timer(seconds):
                self._set_timer(process, seconds)
            case Keep():
                pass  # the node of the coordinator keeps it itself
            case End():
                self._end(process, None)

    def _will_hear(self, process: SimulatedProcess, keys: tuple[str, ...]) -> None:
        for key in keys:
            if "*" in key.removesuffix(EVERYTHING):
                expected = f"expected a key, or one that ends in {EVERYTHING}"
                raise NodeError(f"{process.name} listens to {key}: {expected}")
            if key in process.listening:
                raise NodeError(f"{process.name} listens to {key} twice")
            process.listening[key] = None

    def _will_ignore(self, process: SimulatedProcess, keys: tuple[str, ...]) -> None:
        for key in keys:
            if key not in process.listening:
                raise NodeError(f"{process.name} ignores {key}, which it does not listen to")
            del process.listening[key]

    def _set_timer(self, process: SimulatedProcess, seconds: float | None) -> None:
        process.timers += 1
        if seconds is not None:
            due_us = self.now_us + max(1, round(seconds * SECOND_US))
            self._at(due_us, self._tick, process, process.timers)

    def _tick(self, process: SimulatedProcess, timer: int) -> None:
        if process.timers != timer or not process.alive:
            return
        # A process looks at its timer when no message waits for it.
        if self.now_us < process.free_us or process.inbox:
            self._at(max(process.free_us, self.now_us + 1), self._tick, process, timer)
            return
        process.free_us = self.now_us + SERVE_US
        self._act(process, lambda node: node.tick())

    def _end(self, process: SimulatedProcess, error: CubepathError | None) -> None:
        self._die(process)
        self._remark(process.name, "end" if error is None else str(error))
        if process.number == 0:
            self.ended = error
            self._over = True
        elif error is not None:
            self._tell_death(process, error)

    def _tell_death(self, process: SimulatedProcess, error: CubepathError | None) -> None:
        if self._died is not None:
            self._at(self.now_us + NOTICE_US, self._notice, process.number - 1, error)

    def _notice(self, number: int, error: CubepathError | None) -> None:
        died = self._died
        if died is not None:
            self._take(self._processes[0], lambda _: died(number, error))

    # Faults of processes and of the router.

    def _strike(self, process: SimulatedProcess, fault: Fault) -> bool:
        """Let a fault happen to a process; return whether it takes no message now."""
        if fault.kind not in STANDING:
            self._kill(process, fault)
            return True
        self.fire(fault)
        if fault.kind == "jump":
            self._span(process.name, fault, 0)
            self._set_timer(process, 0.0)
            return False
        if fault.kind == "slow":
            process.slow_us, process.slow_left = fault.amount_us, SLOW_MESSAGES
            self._span(process.name, fault, fault.amount_us * SLOW_MESSAGES)
            return False
        self._span(process.name, fault, fault.amount_us)
        if fault.kind == "twin":
            process = self._succeeded(process)
            self._at(self.now_us + fault.amount_us, self._tick, process, process.timers)
        process.free_us = self.now_us + fault.amount_us
        self._at(process.free_us, self._serve, process, process.life)
        return True

    def _succeeded(self, process: SimulatedProcess) -> SimulatedProcess:
        """Let a new node take a process's place; return the old one, which is still connected."""
        old = self._joined(process.name, process.make, process.node)
        old.host, old.connected = process.host, process.connected
        old.serving = old.replaced = True
        old.inbox, process.inbox = process.inbox, old.inbox
        old.listening, process.listening = process.listening, old.listening
        if old.connected:
            for key in old.listening:
                self._listen(old, key)
        self._die(process)
        self._come_back(process)
        return old

    def _kill(self, process: SimulatedProcess, fault: Fault) -> None:
        """End a process; if the fault takes time, another one takes its place after that."""
        self.fire(fault)
        self._end_for(process, fault)

    def _end_for(self, process: SimulatedProcess, fault: Fault) -> None:
        self._die(process)
        if process.replaced:
            return
        if fault.amount_us:
            self._span(process.name, fault, fault.amount_us)
            self._at(self.now_us + fault.amount_us, self._come_back, process)
        else:
            process.gone = True
            self._span(process.name, fault, None)
            self._tell_death(process, None)

    def _come_back(self, process: SimulatedProcess) -> None:
        try:
            process.node = process.make()
        except Exception as error:
            raise _node_error(process, error) from error
        process.alive = True
        process.connected = process.host not in self._down
        process.free_us = self.now_us
        how = "back without memory" if process.tear is None else "back from its journal"
        self._remark(process.name, how)
        self._start(process, process.life)

    def _die(self, process: SimulatedProcess) -> None:
        process.alive = process.serving = False
        process.life += 1
        process.timers += 1
        process.slow_left = 0
        process.inbox.clear()
        process.listening.clear()
        self._disconnect(process)

    def _disconnect(self, process: SimulatedProcess) -> None:
        process.connected = False
        self._routes.clear()
        for key in self._tables[process.number]:
            del self._listeners(key)[process.number]
        self._tables[process.number].clear()

    def _listeners(self, key: str) -> dict[int, None]:
        if key.endswith(EVERYTHING):
            return self._below.setdefault(key.removesuffix("**"), {})
        return self._exact.setdefault(key, {})

    def _part(self, fault: Fault) -> None:
        """Let one side not hear the other for a while, or neither; each side has some hosts."""
        self._parted_us = self.now_us + fault.amount_us
        self._one_way = fault.kind == "one-way"
        numbers = range(self._hosts or len(self._processes))
        sides = [self._noise(fault.nth, number) % 2 == 1 for number in numbers]
        if len({*sides}) == 1:
            alone = self._noise(fault.nth, fault.amount_us) % len(sides)
            sides[alone] = not sides[alone]
        self._sides = sides

    def _parted(self, sender: SimulatedProcess, receiver: SimulatedProcess) -> bool:
        one, other = (
            self._sides[each.host if self._hosts else each.number % len(self._sides)]
            for each in (sender, receiver)
        )
        return one != other and (one or not self._one_way)

    def _router_dies(self, fault: Fault) -> None:
        router = self._noise(fault.nth, 1) % len(self._router_lives)
        self._down.add(router)
        self._router_lives[router] += 1
        for process in self._processes:
            if process.host == router:
                self._disconnect(process)
        self._at(self.now_us + fault.amount_us, self._router_back, router)

    def _router_back(self, router: int) -> None:
        self._down.discard(router)
        for process in self._processes:
            if process.host == router:
                later = self._noise(process.number, self._routed) % RECONNECT_US
                self._at(self.now_us + later, self._connect, process)

    def _host_dies(self, fault: Fault) -> None:
        """End all processes of a host, but the first of all, until they come back."""
        host = self._noise(fault.nth, 1) % len(self._router_lives)
        for process in self._processes[1:]:
            if process.host == host and process.alive:
                self._end_for(process, fault)

    def _connect(self, process: SimulatedProcess) -> None:
        if process.alive and process.host not in self._down and not process.connected:
            process.connected = True
            for key in process.listening:
                self._listen(process, key)

    # Links.

    def _noise(self, one: int, other: int) -> int:
        """Return a number that looks drawn, from the seed and two numbers."""
        mixed = self._seed * 0x9E3779B1 + one * 0x85EBCA6B + other * 0xC2B2AE35
        mixed = (mixed ^ (mixed >> 15)) * 0x2C1B3C6D & 0xFFFFFFFF
        return mixed ^ (mixed >> 13)

    def _send(self, process: SimulatedProcess, effect: Put | Listen | Ignore, at_us: int) -> None:
        """Send an effect up to the router at a time, now or a little later."""
        letter = _Letter(process, effect, at_us, self._router_lives[process.host])
        if not process.connected:
            self._arrow(letter, None, "lost")
            return
        plain = isinstance(effect, Put)
        for time_us, fate in self._ways(process, process.up, at_us, plain=plain):
            reaches_us = time_us
            if not plain:
                # A session's declarations keep their order: no `Ignore` undoes a later `Listen`.
                reaches_us = process.declared_us = max(time_us, process.declared_us)
            self._at(reaches_us, self._reach_router, letter, fate)

    def _reach_router(self, letter: _Letter, fate: Fate) -> None:
        if fate == "lost" or letter.router_life != self._router_lives[letter.sender.host]:
            self._arrow(letter, None, "lost")
        elif isinstance(letter.effect, Put):
            self._route(letter, letter.effect, fate)
        elif letter.sender.alive:
            self._declare(letter.sender, letter.effect)

    def _ways(
        self, process: SimulatedProcess, link: _Link, from_us: int, *, plain: bool
    ) -> list[tuple[int, Fate]]:
        """Return when a message arrives over a link, and each copy of it.

        What is not `plain` is not lost and not doubled, as sessions repeat it until it is known.
        """
        nth = link.count
        link.count += 1
        noise = self._noise(link.salt, nth) % HOP_US
        fault = None if process.replaced else self._faults(link.name, nth)
        kind = "" if fault is None else fault.kind
        if kind == "drag" and fault is not None:
            self.fire(fault)
            link.slow_us, link.slow_left = fault.amount_us, SLOW_MESSAGES
        if link.slow_left:
            link.slow_left -= 1
            noise += link.slow_us
        if fault is None or kind == "drag" or (not plain and kind in ("loss", "duplicate")):
            arrival = link.last_us = max(from_us + HOP_US + noise, link.last_us)
            return [(arrival, "arrived")]
        self.fire(fault)
        held = fault.amount_us if kind == "delay" else 0
        arrival = max(from_us + HOP_US + noise + held, link.last_us)
        if kind == "reorder":  # those behind it do not wait
            return [(arrival + fault.amount_us, "arrived")]
        link.last_us = arrival
        if kind == "loss":
            return [(arrival, "lost")]
        if kind == "duplicate":
            return [(arrival, "arrived"), (arrival + fault.amount_us, "second")]
        return [(arrival, "arrived")]

    def _declare(self, process: SimulatedProcess, effect: Listen | Ignore) -> None:
        for key in effect.keys:
            if isinstance(effect, Listen):
                self._listen(process, key)
            elif key in self._tables[process.number]:
                self._routes.clear()
                del self._tables[process.number][key]
                del self._listeners(key)[process.number]

    def _listen(self, process: SimulatedProcess, key: str) -> None:
        self._routes.clear()
        self._tables[process.number][key] = None
        self._listeners(key)[process.number] = None

    def _route(self, letter: _Letter, put: Put, fate: Fate) -> None:
        fault = self._faults(ROUTER, self._routed)
        self._routed += 1
        if fault is not None:
            self.fire(fault)
            self._span(ROUTER, fault, fault.amount_us)
            if fault.kind in ("partition", "one-way"):
                self._part(fault)
            elif fault.kind == "host":
                self._host_dies(fault)
            else:
                self._router_dies(fault)
            if letter.router_life != self._router_lives[letter.sender.host]:
                self._arrow(letter, None, "lost")
                return
        parted = self.now_us < self._parted_us
        own = letter.sender.number
        for number in self._listeners_to(put.key):
            if number == own:
                continue
            receiver = self._processes[number]
            if parted and self._parted(letter.sender, receiver):
                self._arrow(letter, receiver, "lost")
                continue
            for time_us, way in self._ways(receiver, receiver.down, self.now_us, plain=True):
                outcome = fate if way == "arrived" else way
                lives = receiver.life, self._router_lives[receiver.host]
                self._at(time_us, self._arrive, letter, receiver, lives, outcome)

    def _listeners_to(self, key: str) -> tuple[int, ...]:
        found = self._routes.get(key)
        if found is None:
            listeners = dict(self._exact.get(key, ()))
            for prefix, below in self._below.items():
                if key.startswith(prefix):
                    listeners.update(below)
            found = self._routes[key] = tuple(sorted(listeners))
        return found

    def _arrive(
        self, letter: _Letter, receiver: SimulatedProcess, lives: tuple[int, int], fate: Fate
    ) -> None:
        if fate == "lost" or lives != (receiver.life, self._router_lives[receiver.host]):
            self._arrow(letter, receiver, "lost")
            return
        self._arrow(letter, receiver, fate)
        self._take(receiver, letter)

    # The trace.

    def _event(self, act: str, about: Any, life: int = 0, *_: object) -> Event:
        """Return what a step does that is about a process, a message, or the number of a router."""
        process, what, letter = ROUTER, "", about
        if isinstance(about, SimulatedProcess):
            process, letter = about.name, None
            ready = about.alive and self.now_us >= about.free_us
            if act == "_serve" and ready and life == about.life:
                what, letter = "takes", about.inbox[0]
            elif act == "_tick" and ready and not about.inbox and life == about.timers:
                what = "timer runs out"
            elif act == "_come_back":
                what = "comes back"
        sender, put = "", None
        if isinstance(letter, _Letter) and isinstance(letter.effect, Put):
            sender, put = letter.sender.name, letter.effect
        return Event(self.now_us, process, what, sender, put, len(self.fired))

    def _arrow(self, letter: _Letter, receiver: SimulatedProcess | None, fate: Fate) -> None:
        put = letter.effect
        if self._trace is not None and isinstance(put, Put):
            name = None if receiver is None else receiver.name
            times = (letter.sent_us, max(letter.sent_us, self.now_us))
            arrow = Arrow(*times, letter.sender.name, name, put.key, put.data, fate)
            self._trace.arrows.append(arrow)

    def _span(self, process: str, fault: Fault, long_us: int | None) -> None:
        if self._trace is not None:
            end = None if long_us is None else self.now_us + long_us
            self._trace.spans.append(Span(self.now_us, end, process, fault.kind))

    def _remark(self, process: str, text: str) -> None:
        if self._trace is not None:
            self._trace.remarks.append(Remark(self.now_us, process, text))


def _node_error(process: SimulatedProcess, error: Exception) -> NodeError:
    what = f"{type(error).__name__}: {' '.join(str(error).split())}"
    return NodeError(f"{process.name} raised {what}")
