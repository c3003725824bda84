"""The fleet: it starts, paces and ends module processes, and decides nothing for them.

A fleet starts a private router and the processes, and carries out the effects of its pacing node.
Alternatively its router is open to others, and some processes join from elsewhere. If you pass a
sink, it receives every message as it was on the wire.
"""

import contextlib
import math
import time
import uuid
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from typing import Self, TypeAlias, TypedDict, Unpack

from msgspec.structs import replace

from cubepath.agents.processes.child_processes import ChildProcesses
from cubepath.agents.processes.config import OUTSIDE, ProcessConfig
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.membership import Membership, offer
from cubepath.agents.processes.network import PRIVATE, NetworkConfig, Way, straight
from cubepath.agents.processes.pacer import PATIENCE_S, Check, Pacer, ProcessDied
from cubepath.agents.processes.remote_processes import RemoteProcesses
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.schedule import RecordedChoices
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.system import Scene
from cubepath.protocol.path_files.durations import OwnMoves
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials, number_in, process_name
from cubepath.protocol.wire.keys import key_of, topic_key
from cubepath.protocol.wire.messages import ChosenAction, Go, Message, encode
from cubepath.protocol.wire.nodes import Effect, Keep, Put
from cubepath.protocol.wire.router import Router, without_tls
from cubepath.protocol.wire.shell import Shell

Sink: TypeAlias = Callable[[Keep[Message], int], None]
"""Receives each message with its bytes on the wire, and the wall time in nanoseconds."""

LEFT = "it has left the network"
_MODULE = "cubepath.agents.processes.host"
_POLL_S = 0.05
_LOOK_S = 0.5
_END_S_MAX = 5.0
_HURRY_S_MAX = 0.5
_STILL_S = 0.2
_REST_S = 0.02
_RESTARTS_MAX = 10


class FleetOptions(TypedDict, total=False):
    """What fleets of both clocks take by name."""

    seed: int
    hesitate: float
    processes: int
    """How many local processes have the modules that no remote one has."""
    patience_s: float
    """Each remote process joins within this time of the last."""
    network: NetworkConfig
    check: Callable[[], None] | None
    """Called while waiting; it may raise to end the run between two messages."""
    say: Callable[[str], None] | None
    """Gets a line with the address where others can join, and with whom the run waits for."""
    way: Way
    """How local processes find the router."""
    opened: Callable[[], None] | None
    """Called when the router is there, before anyone joins."""


class ProcessFleet(ABC):
    """The processes of one run, as a context manager that leaves nothing running.

    On exit it releases every process, session and port, whatever happened.
    """

    def __init__(
        self, scene: Scene, rule: str, *, keepers: int = 0, **options: Unpack[FleetOptions]
    ) -> None:
        """Start nothing yet; InputError if the network of the options is none for this scene."""
        processes, network = options.get("processes", 2), options.get("network", PRIVATE)
        self.scene = scene
        self.run = uuid.uuid4().hex[:12]
        """The name of the run in keys."""
        self.endpoint = ""
        """Where the router listens; other sessions can join there."""
        self.processes = min(processes, len(scene.start))
        self.keepers = keepers
        network.check(len(scene.start), self.processes, keepers)
        self._rule = rule
        self._seed = options.get("seed", 0)
        self._hesitate = options.get("hesitate", 0.0)
        self._patience_s = options.get("patience_s", PATIENCE_S)
        self._network = network
        self._check = options.get("check")
        self._say = options.get("say")
        self._way = options.get("way", straight)
        self._opened = options.get("opened")
        self._router: Router | None = None
        self._joiners: RemoteProcesses | None = None
        self._children = ChildProcesses()
        self._resources = contextlib.ExitStack()
        self._joined = 0
        """How many processes of modules have joined; they have the first numbers."""
        self.modules_of: list[list[int]] = []
        """The modules of each process; remote ones come first."""

    def _deal(self, joined: list[list[int]]) -> None:
        """Deal the modules that no remote process has to local ones."""
        taken = {module for modules in joined for module in modules}
        left = [module for module in range(len(self.scene.start)) if module not in taken]
        self._joined = len(joined)
        self.modules_of = [*joined, *dealt(self.scene, max(1, self.processes), left)]

    def __enter__(self) -> Self:
        """Start everything."""
        try:
            self._start()
        except BaseException:
            self._end()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes, kill those that do not end, and close all sessions."""
        self._end()

    def _start(self) -> None:
        """Open or find the router, wait for those who join, and start the processes."""
        self._open_network()
        if self._opened is not None:
            self._opened()
        if self._network != PRIVATE:
            self._deal(self._wait_for_joiners())
        self._start_processes()

    @abstractmethod
    def _start_processes(self) -> None:
        """Start the local processes, and send the others their orders."""

    def _end(self) -> None:
        try:
            self._children.end(self._end_s)
            if self._joiners is not None:
                self._joiners.wait(self._end_s)
        finally:
            self._resources.close()
            self._router = None

    @property
    @abstractmethod
    def _end_s(self) -> float:
        """Return how long processes may take to end before they are killed."""

    def _open_network(self) -> None:
        network = self._network
        if network.elsewhere is not None:
            self.endpoint = network.elsewhere
        else:
            own = max(1, self.processes)
            router = Router(
                network.listen,
                processes=own,
                keepers=self.keepers,
                secure=network.secure,
                links=network.links,
            )
            self._router = router
            self._resources.callback(router.close)
            self.endpoint = router.endpoint
        if self._say is None:
            return
        where = self.endpoint if self._router is None else self._router.listening
        if network.is_open:
            self._say(without_tls(where))
        if network.listen is not None and not (network.wait_for or self.keepers):
            self._say(
                "others can listen, but not join: expected --wait-for N to wait for N processes"
            )
        self._say(f"endpoint {where}, run {self.run}")

    def _wait_for_joiners(self) -> list[list[int]]:
        """Show that the run is there, and wait for remote processes; return the modules of each."""
        expected = Membership(len(self.scene.start), self._network.wait_for, self.keepers)
        joiners = self._joiners = RemoteProcesses(
            self.endpoint, self.run, expected, self.credentials()
        )
        self._resources.callback(joiners.close)

        def check() -> None:
            if self._check is not None:
                self._check()
            self._look_after_the_router()

        return joiners.gather(check, self._say or (lambda _: None), self._patience_s)

    def _look_after_the_router(self) -> bool:
        """Start it again if it died, unless it does so time and again; return whether it died."""
        router = self._router
        if router is None or not router.look_after():
            return False
        if router.restarts > _RESTARTS_MAX:
            raise ProcessDied(f"the router died {router.restarts} times")
        return True

    def credentials(self, name: str = COORDINATOR) -> Credentials:
        """Return the credentials with which the process of this name authenticates."""
        if self._router is not None:
            return self._router.credentials(name)
        if self._network.elsewhere is None:
            raise _ended()
        folder = self._network.secure
        return Credentials(name, "", "" if folder is None else str(folder))

    def _access(self, name: str) -> tuple[str, Credentials]:
        """Return where the process of this name finds the router, and its credentials."""
        return self._way(name, self.endpoint, self.credentials(name))

    def start_again(self, name: str) -> None:
        """Start a process again that has died; InputError for one that lives, or is unknown."""
        raise InputError(f"{name}: started again only in runs without rounds (clock=free)")

    @property
    def pids(self) -> dict[str, int]:
        """Return the process ids by name; that of the router may change if it dies."""
        found = {name: child.pid for name, child in self._children.by_name.items()}
        if self._router is not None:
            found["router"] = self._router.pid
        return found


def _ended() -> CubepathError:
    return CubepathError("the fleet has ended: start another")


class LockstepFleet(ProcessFleet):
    """The processes of a run with rounds, which are paced phase by phase."""

    def __init__(
        self,
        scene: Scene,
        rule: str,
        *,
        note_length: int = 0,
        schedule: Mapping[int, OwnMoves] | None = None,
        recorded: RecordedChoices | None = None,
        sink: Sink | None = None,
        plausible: Check | None = None,
        **options: Unpack[FleetOptions],
    ) -> None:
        """Plan the fleet; `processes` 0 keeps the modules in a thread here, still on a session.

        With a `schedule`, each module makes its own moves in their rounds, and follows the rule
        after `end_schedule`. With what was `recorded`, modules that it has choices of choose them
        again, and follow the rule after `end_schedule`, the others from the first round on.

        A phase in which nothing arrives for `patience_s` ends the run.

        With `sink` None the fleet listens only to the answers of processes. `plausible` may refuse
        what modules say or report.
        """
        if options.get("processes", 0) < 0:
            raise InputError(f"processes={options.get('processes')}: expected 0 or more")
        super().__init__(scene, rule, **options)
        self._note_length = note_length
        self._schedule = schedule
        self._recorded = recorded
        self._sink = sink
        self._plausible = plausible
        self._begun = False
        self._looked = time.monotonic()
        self._paced = math.inf
        """When all processes were last known to be there."""
        self._shell: Shell | None = None
        self._deal([])

    def _deal(self, joined: list[list[int]]) -> None:
        super()._deal(joined)
        self._judge = Judge(self.run, self.modules_of, self.scene.system)
        self._judge.note_length = self._first_note_length()
        self._pacer = Pacer(
            self.run,
            self.modules_of,
            judge=self._judge,
            check=self._plausible,
            patience_s=self._patience_s,
            hears_all=self._sink is not None,
        )

    def _start_processes(self) -> None:
        credentials = self.credentials()
        shell = Shell(self._pacer, self.endpoint, self._sink, credentials=credentials)
        self._resources.callback(shell.close)
        self._shell = shell
        shell.start()
        scene = scene_to_toml(self.scene)
        if self._joiners is not None:
            for process in range(self._joined):
                self._joiners.send(process_name(process), offer(self._config(process, scene)))
        for process in range(self._joined, len(self.modules_of)):
            if self._check is not None:
                self._check()
            name = process_name(process)
            endpoint, credentials = self._access(name)
            config = replace(
                self._config(process, scene), endpoint=endpoint, credentials=credentials
            )
            if self.processes:
                self._children.spawn(name, _MODULE, config)
            else:
                self._children.serve_here(name, _MODULE, config)
        self._wait()
        self._begun = True

    def _config(self, process: int, scene: str) -> ProcessConfig:
        """Return the configuration of a process, apart from how it finds the router."""
        modules = self.modules_of[process]
        return ProcessConfig(
            endpoint="",
            run=self.run,
            process=process,
            modules=modules,
            processes=self.modules_of,
            scene=scene,
            rule=self._rule,
            seed=self._seed,
            hesitate=self._hesitate,
            note_length=self._note_length,
            schedule=self._own(modules),
            recorded=None if self._recorded is None else self._recorded.of(modules),
        )

    def _first_note_length(self) -> int:
        if self._recorded is not None:
            return self._recorded.note_length
        return 0 if self._schedule is not None else self._rule_note_length()

    def _rule_note_length(self) -> int:
        if self._rule == OUTSIDE:
            return self._note_length
        return rule_named(self._rule, self.scene.system).length(len(self.scene.start))

    def _own(self, modules: list[int]) -> dict[int, dict[int, GeneratorPlacement]] | None:
        if self._schedule is None:
            return None
        return {module: dict(self._schedule.get(module, {})) for module in modules}

    @property
    def round(self) -> int:
        """Return the number of the round on the wire; it continues counting after `reset`."""
        return self._pacer.round

    def reset(self, seed: int) -> None:
        """Put every module back at its start, with another seed."""
        self._do(self._pacer.reset(seed))

    def rounds(self, most: int) -> Iterator[int]:
        """Play up to `most` rounds; yield the number of each once all its messages have arrived."""
        for _ in range(most):
            yield self.play_round()

    def play_round(self) -> int:
        """Play a round; return its number once all its messages have arrived."""
        self._do(self._pacer.begin_round())
        return self.round

    def rest(self, left: Callable[[], float]) -> None:
        """Wait between two rounds until `left`, the seconds to wait yet, returns 0.

        Nobody's patience runs out meanwhile: processes from elsewhere, which end when they hear
        nothing for long, receive a phase that is over, which they do not answer.
        """
        reported = looked = time.monotonic()
        while (wait_s := left()) > 0.0:
            if self._shell is None:
                raise _ended()
            if self._check is not None:
                self._check()
            # Not in `step`: a queue that waits may wait on for ever when a signal comes (CPython
            # 3.11), and here nobody says anything that would end that.
            if not self._shell.step(0.0):
                time.sleep(min(wait_s, _REST_S))
            now = time.monotonic()
            if now - looked > _LOOK_S:
                looked = now
                self._look_for_the_dead()
            if now - reported > _STILL_S:
                reported = now
                data = encode(Go(self.round, "sense"))
                keys = (
                    topic_key(self.run, "go", process_name(process))
                    for process in range(self._network.wait_for)
                )
                self._shell.carry_out([Put(key, data) for key in keys])

    def end_schedule(self) -> None:
        """Let all modules follow their rule from the next round on; call it between two rounds."""
        self._judge.note_length = self._rule_note_length()
        self._do(self._pacer.end_schedule())

    def observe(self) -> None:
        """Begin the next round; modules driven from outside send their observations."""
        self._do(self._pacer.begin_round(driven=True))

    def act(self, acts: list[ChosenAction]) -> None:
        """Send the actions of modules driven from outside, and finish the round."""
        self._do(self._pacer.act(acts))

    def tell(self, message: Message) -> None:
        """Publish a message of the coordinator."""
        if self._shell is not None:
            self._shell.carry_out([Put(key_of(self.run, message), encode(message))])

    def _do(self, effects: list[Effect]) -> None:
        """Carry out what the pacing node asks for, and wait until it is idle."""
        if self._shell is None:
            raise _ended()
        self._shell.carry_out(effects)
        self._wait()

    def _wait(self) -> None:
        shell = self._shell
        if shell is None:
            raise _ended()
        while not self._pacer.idle:
            if self._check is not None:
                self._check()
            try:
                came = shell.step(_POLL_S)
            except ProcessDied as error:
                if self._router is None and not shell.connected:
                    raise ProcessDied(
                        f"no zenoh router at {self.endpoint} any more: {error}"
                    ) from None
                raise
            # Also while somebody talks, however short the phases: a message is no sign that all
            # are alive, and others may ask to join.
            if not came or time.monotonic() - self._looked > _LOOK_S:
                self._looked = time.monotonic()
                self._look_for_the_dead()
        self._paced = time.monotonic()

    def _look_for_the_dead(self) -> None:
        if self._check is not None:
            self._check()  # an interrupt takes precedence over its consequences
        for ended in self._children.ended():
            if ended.error is not None:
                raise ProcessDied(ended.error)
            raise self._pacer.died(number_in(ended.name), ended.how)
        if self._joiners is not None:
            self._joiners.look()
            for name in self._joiners.gone(heard=self._paced):
                raise self._pacer.died(number_in(name), LEFT)
        self._look_after_the_router()

    @property
    def _end_s(self) -> float:
        return _END_S_MAX if self._begun else _HURRY_S_MAX

    def _end(self) -> None:
        if self._shell is not None:
            with contextlib.suppress(Exception):  # the rest must still end
                self._shell.carry_out(self._pacer.stop())
            self._shell = None
        super()._end()
