"""A small protocol for the simulated wire: a counter and workers that count together."""

from functools import partial

from cubepath.coordinator.simulation.faults import SECOND_US, Faults
from cubepath.coordinator.simulation.network import SimulatedNetwork, Trace
from cubepath.protocol.core.errors import CheckError, CubepathError
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Listen, Put, Timer

RUN = "cubepath/toy"
PATIENCE_US = 60 * SECOND_US
_TICKS_MAX = 200


class Counter:
    """Puts each number until every worker has answered it; gives up after so many ticks."""

    def __init__(self, workers: int, upto: int) -> None:
        self.workers = workers
        self.upto = upto
        self.number = 0
        self.heard: list[bytes] = []
        self._missing: set[int] = set()
        self._ticks = 0

    def start(self) -> list[Effect]:
        return [Listen((f"{RUN}/**",)), *self._next()]

    def _next(self) -> list[Effect]:
        self.number += 1
        self._ticks = 0
        self._missing = set(range(self.workers))
        if self.number > self.upto:
            return [Put(f"{RUN}/number", b"end"), End()]
        return self._put()

    def _put(self) -> list[Effect]:
        return [Put(f"{RUN}/number", b"%d" % self.number), Timer(0.3)]

    def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
        self.heard.append(data)
        worker, number = map(int, data.split())
        if number == self.number:
            self._missing.discard(worker)
        return self._next() if not self._missing else []

    def tick(self) -> list[Effect]:
        self._ticks += 1
        if self._ticks == _TICKS_MAX:
            raise CheckError(f"no answer to {self.number} from workers {sorted(self._missing)}")
        return self._put()

    def died(self, process: int, error: CubepathError | None) -> list[Effect]:
        raise CheckError(f"process_{process} died: {error or 'killed by signal 9'}")


class Worker:
    """Answers each number; it knows what it has counted, a number that comes twice once."""

    def __init__(self, number: int, *, drops_doubles: bool = True) -> None:
        self.number = number
        self.counted = 0
        self._last = 0
        self._drops_doubles = drops_doubles

    def start(self) -> list[Effect]:
        return [Listen((f"{RUN}/number",))]

    def receive(self, key: str, data: bytes) -> list[Effect]:  # noqa: ARG002
        if data == b"end":
            return [Ignore((f"{RUN}/number",)), End()]
        number = int(data)
        if number > self._last or not self._drops_doubles:
            self._last = number
            self.counted += 1
        return [Put(f"{RUN}/answer/{self.number}", b"%d %d" % (self.number, number))]

    def tick(self) -> list[Effect]:
        raise AssertionError("no timer was set")


def counted(
    faults: Faults, *, workers: int = 3, upto: int = 20, seed: int = 0, doubles: bool = True
) -> tuple[SimulatedNetwork, Counter, list[Worker], Trace]:
    """Let workers count to the end; return what is left of it."""
    trace = Trace()
    network = SimulatedNetwork(faults.at, seed, trace)
    counter = Counter(workers, upto)
    made: list[Worker] = []

    def make(number: int) -> Worker:
        made.append(Worker(number, drops_doubles=doubles))
        return made[-1]

    network.add("coordinator", lambda: counter)
    for number in range(workers):
        network.add(f"process_{number}", partial(make, number))
    network.on_death(counter.died)
    network.run(200_000, 1000 * PATIENCE_US)
    return network, counter, made, trace
