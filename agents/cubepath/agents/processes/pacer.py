"""The pacing node of a coordinator: it starts each phase when the previous one is over.

It is a pure machine, like the node of a module process; `LockstepFleet` carries its effects out on
zenoh. It decides nothing for a module, and carries nothing between modules except how many messages
were sent to each region. A phase is over when every process has answered and everything it sent in
the phase has arrived here too, so that the recording is complete; the node asks again for missing
messages. It judges what arrives; a refused message changes nothing and is noted in the recording
(`Refusals`).
"""

from collections.abc import Callable, Sequence
from typing import Literal, TypeAlias

from cubepath.agents.processes.judge import (
    ASK_S_MAX,
    ASK_S_MIN,
    ORDER,
    Judge,
    Refusals,
    RefusedError,
    refuse,
)
from cubepath.protocol.core.errors import CheckError
from cubepath.protocol.wire.keys import everything, key_of, topic_key
from cubepath.protocol.wire.messages import (
    Bundle,
    ChosenAction,
    ChosenActions,
    Go,
    Message,
    Observations,
    Ready,
    Refused,
    Reports,
    Reset,
    Retransmit,
    Waiting,
    encode,
    kind_of,
)
from cubepath.protocol.wire.nodes import Effect, Keep, Listen, Put, Timer

Phase: TypeAlias = Literal["join", "sense", "observe", "claim", "settle", "over"]
PATIENCE_S = 60.0
"""How long a phase may make no progress, by default."""
Check: TypeAlias = Callable[[Message], object]
"""Takes each message of modules once, and the answer of a process when all its messages have come;
raises RefusedError if it cannot be, given where modules stand."""
_NAMED_MAX = 8
_ASKED_MAX = 1000
"""This many messages that ask again, or say that one waits, are taken of a process in a phase."""


class ProcessDied(CheckError):  # noqa: N818 - named for what happened
    """A module process ended before the run did, or did not answer."""


class Pacer:
    """Paces the processes of one run."""

    def __init__(
        self,
        run: str,
        modules_of: Sequence[Sequence[int]],
        *,
        judge: Judge,
        check: Check | None = None,
        patience_s: float = PATIENCE_S,
        hears_all: bool = True,
    ) -> None:
        """Wait for the processes with these modules to join.

        `check` is asked about what modules say and report, after `judge`. Unless it `hears_all`,
        the node listens to the answers alone and keeps nothing else.
        """
        self.round = 0
        self._run = run
        self._modules_of = [list(modules) for modules in modules_of]
        self._judge = judge
        self._check = check
        self._refusals = Refusals()
        self._asked_in = -1
        self._patience_s = patience_s
        self._hears_all = hears_all
        self._driven = False
        self._go: Message | None = None
        self._acts: list[ChosenActions] = []
        self._begin_phase("join")

    def _begin_phase(self, phase: Phase) -> None:
        self.phase: Phase = phase
        self.idle = False
        """Whether the phases that were asked for are over."""
        self._ready: dict[int, Ready] = {}
        self._answers: dict[int, bytes] = {}
        self._sent: dict[int, dict[tuple[str, int], bytes]] = {}
        self._reported: dict[int, bytes] = {}
        self._asked: dict[int, int] = {}
        self._through: set[int] = set()
        self._held: dict[int, list[Keep[Message]]] = {}
        self._false: set[int] = set()
        self._there: set[int] = set()
        self._waited: set[int] = set()
        self._waited_s = 0.0
        self._moved = False
        self._ask_s = min(ASK_S_MIN, self._patience_s)

    def start(self) -> list[Effect]:
        """Listen, and wait until all processes have joined."""
        keys: tuple[str, ...] = (everything(self._run),)
        if not self._hears_all:
            keys = tuple(topic_key(self._run, kind) for kind in ("ready", "waiting"))
        return [Listen(keys), Timer(self._ask_s)]

    # What is asked of the processes.

    def begin_round(self, *, driven: bool = False) -> list[Effect]:
        """Begin the next round; with modules `driven` from outside, up to their observations."""
        effects = self._refusals.new_refusals()
        self.round += 1
        self._driven = driven
        self._acts = []
        self._counts: dict[str, int] = {}
        return [*effects, *self._ask("sense")]

    def act(self, acts: Sequence[ChosenAction]) -> list[Effect]:
        """Finish a round with the actions of all modules."""
        by_module = {act.module: act for act in acts}
        self._acts = [
            ChosenActions(self.round, process, [by_module[module] for module in modules])
            for process, modules in enumerate(self._modules_of)
        ]
        found: list[Effect] = []
        for message in self._acts:
            found += self._put(message)
        return [*found, *self._ask("claim")]

    def end_schedule(self) -> list[Effect]:
        """Let all modules follow their rule from the next round on; between two rounds."""
        return self._ask("over")

    def reset(self, seed: int) -> list[Effect]:
        """Put every module back at its start, with another seed."""
        self.round += 1  # no message of a round before can be taken for one of these
        self._go = Reset(self.round, seed)
        self._begin_phase("join")
        return [*self._put(self._go), Timer(self._ask_s)]

    def stop(self) -> list[Effect]:
        """Let all processes end."""
        return [*self._refusals.new_refusals(), *self._put(Go(self.round, "stop")), Timer(None)]

    def _ask(self, phase: Phase) -> list[Effect]:
        if phase == "join":
            raise AssertionError("processes join by themselves")
        counts = self._counts if phase in ("observe", "claim", "settle") else {}
        self._go = Go(self.round, phase, counts)
        self._begin_phase(phase)
        return [*self._put(self._go), Timer(self._ask_s)]

    def _put(self, message: Message) -> list[Effect]:
        data = encode(message)
        return [Put(key_of(self._run, message), data), Keep(data, message)]

    # Effects.

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message; a refused message has no effect except a note in the recording."""
        try:
            message = self._judge.read(key, data)
            match message:
                case Bundle():
                    due = self._is_of_now(message) and self._is_true(message, data)
                    return self._take(message, data) if due else []
                case Ready() | Reports() | Observations():
                    due = self._is_of_now(message) and self._is_new(message, data)
                    return self._take(message, data) if due else []
                case Waiting() | Retransmit():
                    return self._take_asking(message, data)
                case _:
                    # What the coordinator says does not come back to it.
                    refuse("foreign", f"{kind_of(message)}, which the coordinator alone says")
        except RefusedError as error:
            return [*self._refusals.add(self.round, key, data, error)]

    @property
    def refused(self) -> int:
        """Return how many messages were refused."""
        return self._refusals.count

    def _take_asking(self, message: Waiting | Retransmit, data: bytes) -> list[Effect]:
        if message.round > self.round:
            refuse("out of place", f"round {message.round}, in round {self.round}")
        if message.round < self.round:
            return []  # who asked for it has got it
        asked = self._asked[message.process] = self._asked.get(message.process, 0) + 1
        if asked > _ASKED_MAX:
            refuse("too many", f"more than {_ASKED_MAX} in phase {self.phase}")
        self._asked_in = self.round
        if isinstance(message, Waiting):
            self._there.add(message.process)
            self._waited.add(message.process)
        return [Keep(data, message)]

    def _is_true(self, bundle: Bundle, data: bytes) -> bool:
        """Return whether a bundle is new, as `_is_new`; who says what cannot be is not through.

        Others may have heard it: were another message taken for it, they would know otherwise.
        """
        known = self._sent.get(bundle.process, {}).get((bundle.region, bundle.number)) == data
        try:
            return self._is_new(bundle, data)
        except RefusedError:
            if not known:
                self._false.add(bundle.process)
                self._through.discard(bundle.process)
            raise

    def _is_new(self, message: Ready | Bundle | Reports | Observations, data: bytes) -> bool:
        """Return whether a message is new; False for a repetition, RefusedError for all else."""
        if self._is_known(message, data):
            if self._asked_in >= message.round or self.phase == "join":
                return False  # somebody has asked for it again, or it joins until it is heard
            refuse("doubled", f"{kind_of(message)} of {_when(message)} came before")
        if self.idle:
            refuse("out of place", f"{kind_of(message)} of {_when(message)}, which is over")
        if isinstance(message, Bundle):
            self._judge.check(message)
        elif isinstance(message, Reports | Observations):
            self._judge.check_whole(message)
        if self._check is not None and not isinstance(message, Ready):
            self._check(message)  # an answer is checked once all that it counts has come
        return True

    def _is_of_now(self, message: Ready | Bundle | Reports | Observations) -> bool:
        """Return whether a message is of this phase; False for a repetition of one before."""
        match message:
            case Reports():
                phase = "settle"
            case Observations():
                phase = "observe"
            case _:
                phase = message.phase
        if phase == "join" and self.phase != "join":
            if message.round + 1 >= self.round:
                return False  # it said so before it heard that it is to begin
            refuse("out of place", "it joins, and has joined before: it may have lost its memory")
        if (message.round, phase) == (self.round, self.phase):
            return True
        if (message.round, ORDER[phase]) > (self.round, ORDER[self.phase]):
            now = f"in phase {self.phase} of round {self.round}"
            refuse("out of place", f"{kind_of(message)} of {_when(message)}, {now}")
        if self._asked_in < message.round:
            refuse("stale", f"{kind_of(message)} of {_when(message)}")
        return False

    def _is_known(self, message: Ready | Bundle | Reports | Observations, data: bytes) -> bool:
        """Return whether a message is known; RefusedError if it was another one."""
        process = message.process
        match message:
            case Ready():
                known = self._answers.get(process)
            case Bundle(region=region, number=number):
                known = self._sent.get(process, {}).get((region, number))
            case _:
                known = self._reported.get(process)
        if known not in (None, data):
            refuse("contradicts", f"another {kind_of(message)} of {_when(message)} came before")
        return known is not None

    def _take(self, message: Ready | Bundle | Reports | Observations, data: bytes) -> list[Effect]:
        match message:
            case Ready():
                self._ready[message.process] = message
                self._answers[message.process] = data
            case Bundle():
                sent = self._sent.setdefault(message.process, {})
                sent[message.region, message.number] = data
            case Reports() | Observations():
                self._reported[message.process] = data
        self._moved = True
        if not isinstance(message, Ready) and not isinstance(message, Reports):
            return [Keep(data, message), *self._pass(message.process)]
        # On record they say that all of it is: so not before it is.
        self._held.setdefault(message.process, []).append(Keep(data, message))
        return self._pass(message.process)

    def _pass(self, process: int) -> list[Effect]:
        """Let a process be through if it is, and if it sent everything that was due."""
        if process in self._false | self._through or not self._is_through(process):
            return []
        self._through.add(process)
        try:
            if self._check is not None and self._hears_all:
                self._check(self._ready[process])
        except RefusedError as error:
            return [
                *self._refuse_answer(process if error.process is None else error.process, error)
            ]
        found: list[Effect] = [*self._held.pop(process)]
        if len(self._through) == len(self._modules_of):
            return [*found, *self._next()]
        return found

    def _refuse_answer(self, process: int, error: RefusedError) -> list[Keep[Refused]]:
        """Refuse what a process says of its phase, after all of that has come."""
        self._false.add(process)
        self._through.discard(process)
        key = key_of(self._run, self._ready[process])
        return self._refusals.add(self.round, key, self._answers[process], error)

    def _is_through(self, process: int) -> bool:
        """Return whether a process has answered, and all its messages have arrived."""
        ready = self._ready.get(process)
        if ready is None:
            return False
        if not self._hears_all:
            return True
        if self.phase in ("settle", "observe") and process not in self._reported:
            return False
        return len(self._sent.get(process, ())) >= sum(ready.sent.values())

    def _next(self) -> list[Effect]:
        self._counts = {}
        for process in sorted(self._ready):  # not in the order of arrival: it is recorded
            for region, count in self._ready[process].sent.items():
                self._counts[region] = self._counts.get(region, 0) + count
        match self.phase:
            case "sense":
                return self._ask("observe" if self._driven else "claim")
            case "claim":
                return self._ask("settle")
            case _:
                self.idle = True
                return [Timer(None)]

    def tick(self) -> list[Effect]:
        """Ask those again who have not answered; ProcessDied if patience is over."""
        if self.idle:
            return []
        # The time before what came last does not count, nor the rest of that interval.
        self._waited_s = 0.0 if self._moved else self._waited_s + self._ask_s
        self._moved = False
        self._asked_in = self.round
        missing = [each for each in range(len(self._modules_of)) if each not in self._through]
        patience_s = self._patience_s
        if self.phase == "join":
            patience_s = max(patience_s, PATIENCE_S)  # processes take some time to start
        if self._waited_s >= patience_s:
            raise ProcessDied(self._too_late(missing))
        self._there.clear()  # a process that still waits repeats its question
        found: list[Effect] = [*self._refusals.new_refusals()]
        if self._go is not None:  # processes join by themselves, and say so until they are heard
            data = encode(self._go)
            for process in missing:
                if self.phase == "claim" and self._acts:
                    acts = self._acts[process]
                    found.append(Put(key_of(self._run, acts), encode(acts)))
                kind = "reset" if isinstance(self._go, Reset) else "go"
                found.append(Put(topic_key(self._run, kind, f"process_{process}"), data))
        self._ask_s = min(2 * self._ask_s, ASK_S_MAX, patience_s - self._waited_s)
        return [*found, Timer(self._ask_s)]

    def _too_late(self, missing: list[int]) -> str:
        # Others may be waiting for the one that is late: these have said so, at least once.
        silent = [process for process in missing if process not in self._there]
        unheard = [process for process in silent if process not in self._waited]
        late = [process for process in missing if process in self._false]
        late = late or unheard or silent or missing
        names = ", ".join(self.name(process) for process in late)
        what = f"phase {self.phase} of round {self.round}"
        line = f"no answer within {self._waited_s:g} s to {what} from {names}"
        refused = self._refusals.last
        if refused is not None:
            line += f"; last refused, on {refused.key}: {refused.detail}"
        if unheard or not self._false.isdisjoint(late):
            return line
        return f"{line}, waiting for others" + (" when last heard of" if silent else "")

    def died(self, process: int, how: str) -> ProcessDied:
        """Return the error for a process that has ended."""
        return ProcessDied(f"{self.name(process)} died in round {self.round}: {how}")

    def name(self, process: int) -> str:
        """Return a process by its modules and its number."""
        modules = self._modules_of[process]
        names = [f"module_{module}" for module in modules[:_NAMED_MAX]]
        if len(modules) > _NAMED_MAX:
            names.append(f"{len(modules) - _NAMED_MAX} more")
        return f"{', '.join(names)} (process {process})"


def _when(message: Ready | Bundle | Reports | Observations) -> str:
    """Return the phase, if a message tells it, and the round."""
    phase = f"phase {message.phase} of " if isinstance(message, Ready | Bundle) else ""
    return f"{phase}round {message.round}"
