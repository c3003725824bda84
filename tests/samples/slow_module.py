"""A slow module among quick ones, in virtual time: how long it wants to move and does not.

With cubepath installed: ``python tests/samples/slow_module.py [--seeds 4] [--seconds 15]`` prints
the figures of docs/free-clock.md.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median

from cubepath.agents.free.config import FreeProcessConfig
from cubepath.agents.free.host_node import FreeHostNode
from cubepath.agents.free.mover import THINK_S
from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import KeeperNode
from cubepath.coordinator.simulation.faults import SECOND_US, ListedFaults
from cubepath.coordinator.simulation.free_simulated import Watch
from cubepath.coordinator.simulation.network import SimulatedNetwork
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import Commit, FreeMessage, Turns, decode_free
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.nodes import Node, Put

SLOW = 100.0
"""So many times slower it is than its neighbours, which think for `THINK_S`."""
SCENES = (
    ("agv:graph=grid6x6,n=24", "random"),
    ("agv:graph=grid6x6,n=20", "tswap"),
    ("agv-labelled:graph=grid6x6,n=20", "pibt"),
    ("hex:n=8", "random"),
    ("arm:n=6", "random"),
)
KEEPERS, PROCESSES = 4, 4


@dataclass(frozen=True, slots=True)
class Measured:
    """What a run came to."""

    longest: float
    """How long the slow module wanted to move and did not, at most, in its own thinking times."""
    apart: float
    """The longest time between two of its commits, likewise."""
    own: int
    """How often it moved."""
    others: float
    """Moves of the others a second."""


def measured(spec: str, rule: str, slow: int, seed: int, seconds: float) -> Measured:
    """Run for so many seconds of virtual time."""
    scene = scene_from_spec(spec)
    modules = [*range(len(scene.start))]
    others = [module for module in modules if module != slow]
    modules_of = [[slow], *(others[at::PROCESSES] for at in range(PROCESSES))]
    network = SimulatedNetwork(ListedFaults([]).at, seed)
    network.add("coordinator", lambda: Watch("run", KEEPERS))
    tiles = Tiles(scene.system, KEEPERS)
    for keeper in range(KEEPERS):
        network.add(f"keeper_{keeper}", partial(_keeper, keeper, scene, tiles, modules_of))
    for process, mine in enumerate(modules_of):
        if mine:
            make = partial(_host, process, mine, scene, slow, seed, rule=rule)
            network.add(f"process_{process}", make)
    waits = _Waits(slow)
    count = 0

    def through(_: str, put: Put) -> Put:
        nonlocal count
        message = decode_free(put.data)
        waits.said(message, network.now_us)
        count += isinstance(message, Commit) and message.module != slow
        return put

    def after() -> None:
        if network.now_us >= seconds * SECOND_US:
            network.stop()

    network.watch(through, after)
    network.run(10**9, 10**15)
    waits.ends(network.now_us)
    think_us = SLOW * THINK_S * SECOND_US
    return Measured(
        waits.longest_us / think_us, waits.apart_us / think_us, waits.moves, count / seconds
    )


class _Waits:
    """How long a module wants to move and does not: from its first choice until its commit.

    It wants to no more where its rule chooses to stay.
    """

    def __init__(self, module: int) -> None:
        self.longest_us = self.apart_us = self.moves = 0
        self._moved_us = 0
        self._module = module
        self._since_us: int | None = None

    def said(self, message: FreeMessage, now_us: int) -> None:
        match message:
            case Turns(parts=turns):
                for turn in turns:
                    if turn.module == self._module and turn.number is None:
                        self.ends(now_us)
                    elif turn.module == self._module and self._since_us is None:
                        self._since_us = now_us
            case Commit(module=self._module):
                self.moves += 1
                self.ends(now_us)
                self._moved_us = now_us
            case _:
                pass

    def ends(self, now_us: int) -> None:
        """End what it waits for."""
        self.apart_us = max(self.apart_us, now_us - self._moved_us)
        if self._since_us is not None:
            self.longest_us = max(self.longest_us, now_us - self._since_us)
        self._since_us = None


def _keeper(me: int, scene: Scene, tiles: Tiles, modules_of: list[list[int]]) -> Node:
    return KeeperNode(Keeper(me, scene, tiles, MemoryJournal()), "run", modules_of)


def _host(
    process: int, modules: list[int], scene: Scene, slow: int, seed: int, *, rule: str
) -> Node:
    orders = FreeProcessConfig(
        endpoint="",
        run="run",
        process=process,
        modules=modules,
        keepers=KEEPERS,
        incarnation=1,
        scene="",
        rule=rule,
        seed=seed,
        speeds={module: SLOW if module == slow else 1.0 for module in modules},
    )
    return FreeHostNode(orders, scene)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print for each scene median and worst."""
    parser = argparse.ArgumentParser(description="How long a slow module waits for its turn.")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--only", default=None, help="one scene")
    options = parser.parse_args(arguments)
    for spec, rule in SCENES:
        if options.only not in (None, spec):
            continue
        slow = len(scene_from_spec(spec).start) - 1
        found = [measured(spec, rule, slow, seed, options.seconds) for seed in range(options.seeds)]
        longest = sorted(each.longest for each in found)
        apart = sorted(each.apart for each in found)
        print(
            f"{spec}, {rule}: longest {median(longest):.1f}, worst {longest[-1]:.1f} thinking"
            f" times, between commits {median(apart):.1f}, worst {apart[-1]:.1f};"
            f" its moves {[each.own for each in found]};"
            f" others {median(each.others for each in found):.0f} moves a second",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
