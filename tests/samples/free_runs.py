"""Runs without rounds on keepers alone: messages delivered late, doubled and in any order.

Modules are driven here as plainly as possible, with the rule of `free_rules`; keepers are the real
ones. What comes out are the messages as a recorder would write them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from random import Random

from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.local.observation import observe
from cubepath.agents.local.random_streams import RULE, stream
from cubepath.agents.rules.actor import Actor, attempt_of
from cubepath.agents.rules.rule import InitialKnowledge, RuleType
from cubepath.agents.rules.uniform import RANDOM
from cubepath.coordinator.auditing.rule_audit import audit
from cubepath.coordinator.normal_form.certificate import certificate_of
from cubepath.coordinator.runs.free_gatherer import FreeGatherer
from cubepath.coordinator.verification.findings import Verification
from cubepath.protocol.core.sites import Site, site_from_json, to_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.recordings.recording import Recording, read_recording
from cubepath.protocol.recordings.writing import RecordingWriter
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Entered,
    EnterRequest,
    Forwards,
    FreeMessage,
    Halted,
    PlaceState,
    Replies,
    Requests,
    TileQuery,
    TileUpdate,
    Turn,
    Turns,
    free_topic,
    level_of,
)
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import Certified, Cube, Edges, Summary, encode
from samples.free_numbers import Numbering, numbered
from samples.free_rules import GOSSIP
from samples.recordings import new_path

RULE_NAME = f"{Path(__file__).parent / 'free_rules.py'}:GOSSIP"
NOTHING = PlaceState(None, 0)


def asked(recording: Recording) -> Verification:
    """Verify a recording, and ask its rule again, which is in a file of the tests."""
    return audit(recording, rules=(RULE_NAME,))


@dataclass
class _Module:
    """A module: its fence, where it stands, and the attempt that is under way."""

    number: int
    site: Site
    incarnation: int = 1
    epoch: int | None = None
    attempts: int = 0
    turns: int = 0
    version: int = 0
    note: list[int] = field(default_factory=list)
    actor: Actor | None = None
    asked: Attempt | None = None


class FreeRun:
    """One run: keepers, modules in processes, and a wire that is a bag of messages."""

    def __init__(
        self,
        spec: str,
        *,
        keepers: int = 3,
        processes: int = 2,
        seed: int = 0,
        rule: RuleType = GOSSIP,
        record: Callable[[FreeMessage], object] | None = None,
    ) -> None:
        """Begin at the start of the scene; messages are recorded, or passed on to be."""
        self.scene: Scene = scene_from_spec(spec)
        self.system = self.scene.system
        self.seed, self.random = seed, Random(seed)  # noqa: S311 - a seeded one
        self.tiles = Tiles(self.system, keepers)
        self.keepers = [
            Keeper(number, self.scene, self.tiles, MemoryJournal()) for number in range(keepers)
        ]
        self.processes = processes
        self.modules = [_Module(number, site) for number, site in enumerate(self.scene.start)]
        self.shown: list[dict[Site, PlaceState]] = [{} for _ in range(processes)]
        self.seen: set[str] = set()
        """The tiles that were shown whole, to all processes."""
        self.wire: list[FreeMessage] = []
        self.record: list[FreeMessage] = []
        self.put_on_record = self.record.append if record is None else record
        self.moves = 0
        self.rule = rule
        self.note_length = rule.length(len(self.modules), "free")

    def play(self, moves: int, *, restarts: int = 0) -> list[FreeMessage]:
        """Play until so many moves were made and all is quiet; return the messages on record."""
        for module in self.modules:
            self._enter(module)
        while self.moves < moves:
            if restarts and self.moves > moves // 2:
                restarts -= 1
                self._restart(self.random.choice(self.modules))
            self._step(acting=True)
        while self.wire or any(each.asked or each.epoch is None for each in self.modules):
            self._step(acting=False)
        for _ in range(200):  # leases and reminders run out
            self._all(Keeper.tick)
        self._all(lambda keeper: keeper.fetch(0, 0))
        return self.record

    def _all(self, do: Callable[[Keeper], None]) -> None:
        for keeper in self.keepers:
            do(keeper)
        self._hear_keepers()
        while self.wire:
            self._step(acting=False)

    def _put(self, message: FreeMessage) -> None:
        self.wire.append(message)
        if self.random.random() < 0.1:
            self.wire.append(message)
        self.put_on_record(message)

    def _step(self, *, acting: bool) -> None:
        if self.wire and self.random.random() < 0.7:
            place = self.random.randrange(len(self.wire))
            self.wire[place], self.wire[-1] = self.wire[-1], self.wire[place]
            self._deliver(self.wire.pop())
            return
        module = self.random.choice(self.modules)
        if self.random.random() < 0.1:
            self.random.choice(self.keepers).tick()
            self._hear_keepers()
        elif module.epoch is None:
            if self.random.random() < 0.1:
                self._enter(module)
        elif module.asked is not None:
            if self.random.random() < 0.1:
                self._ask(module, module.asked)
        elif acting:
            self._turn(module)

    def _hear_keepers(self) -> None:
        for keeper in self.keepers:
            for message in keeper.outgoing():
                self.moves += isinstance(message, Commit) and message.generator is not None
                if isinstance(message, Commit | CommitLog):
                    self.put_on_record(message)
                else:
                    self._put(message)

    def _deliver(self, message: FreeMessage) -> None:
        match message:
            case Requests():
                for asked in message.parts:
                    self.keepers[message.keeper].ask(message.process, asked)
            case Forwards():
                for said in message.parts:
                    self.keepers[message.to].hear(message.keeper, said)
            case Replies():
                for told in message.parts:
                    self._told(told)
            case TileUpdate():
                self._shown(message)
            case _:
                pass
        self._hear_keepers()

    def _shown(self, message: TileUpdate) -> None:
        if message.whole:
            self.seen.add(message.tile)
        for shown in self.shown:
            for each in message.parts:
                self._see(shown, each)

    def _see(self, shown: dict[Site, PlaceState], each: PlaceState) -> None:
        place = site_from_json(each.place)
        known = shown.get(place, NOTHING)
        if (each.version, each.module_version) >= (known.version, known.module_version):
            shown[place] = each
        if each.module is not None:
            module = self.modules[each.module]
            if each.module_version > module.version and module.asked is None:
                module.version, module.note = each.module_version, each.note
                module.site = site_from_json(each.site)

    # Modules.

    def _process(self, module: _Module) -> int:
        return module.number % self.processes

    def _enter(self, module: _Module) -> None:
        for keeper in range(len(self.keepers)):
            self._put(
                Requests(
                    self._process(module), keeper, [EnterRequest(module.number, module.incarnation)]
                )
            )

    def _restart(self, module: _Module) -> None:
        module.incarnation += 1
        module.epoch, module.asked, module.actor = None, None, None
        self._enter(module)

    def _told(self, part: Decision | Entered) -> None:
        if isinstance(part, Entered):
            module = self.modules[part.occupant.module]
            if module.epoch is not None or part.incarnation != module.incarnation:
                return
            module.site, module.epoch = site_from_json(part.site), part.occupant.epoch
            module.version, module.note = part.occupant.version, part.occupant.note
            module.attempts = module.turns = 0
            knowledge = InitialKnowledge(
                self.system,
                module.number,
                len(self.modules),
                module.site,
                self.scene.goals[module.number] if self.scene.goals else (),
                stream(self.seed, module.number, RULE),
            )
            module.actor = Actor(self.rule, knowledge, clock="free")
            return
        module = self.modules[part.module]
        asked = module.asked
        if asked is None or (asked.epoch, asked.number) != (part.epoch, part.number):
            return
        module.asked = None
        for site, occupant in part.occupants:
            if occupant.module == module.number and occupant.version > module.version:
                module.site, module.version = site_from_json(site), occupant.version
                module.note = occupant.note

    def _turn(self, module: _Module) -> None:
        shown, system = self.shown[self._process(module)], self.system
        place = system.place_of(module.site)
        near = {*system.sensed(place), *system.reach(place)} - {None}
        tiles = {self.tiles.tile_of(each) for each in near if system.has_place(each)}
        if not tiles <= self.seen:
            tile = min(tiles - self.seen)
            self._put(
                Requests(
                    self._process(module), self.tiles.keeper_of_tile(tile), [TileQuery(tile, -1)]
                )
            )
            return
        sensed = [
            None if near is None else shown.get(near, NOTHING) for near in system.sensed(place)
        ]
        within = system.reach(place) if self.note_length else ()
        reach = [shown.get(near, NOTHING) for near in within]
        notes = {
            near: tuple(there.note) for near, there in zip(within, reach, strict=True) if there.note
        }
        occupants = {
            near: site_from_json(there.site)
            for near, there in zip(system.sensed(place), sensed, strict=True)
            if near is not None and there is not None and there.site is not None
        }
        goals = self.scene.goals[module.number] if self.scene.goals else ()
        seen = observe(
            system,
            module.site,
            occupants,
            goals=frozenset(goals),
            notes=notes,
            note_length=self.note_length,
            register=tuple(module.note),
        )
        assert module.actor is not None
        assert module.epoch is not None
        choice = module.actor.act(seen)
        module.turns += 1
        attempt = attempt_of(
            system,
            self.tiles,
            module=module.number,
            epoch=module.epoch,
            number=module.attempts + 1,
            turn=module.turns,
            site=module.site,
            occupants={**occupants, place: module.site},
            notes=notes,
            register=tuple(module.note),
            choice=choice,
        )
        if attempt is not None:
            module.attempts += 1
        turn = Turn(
            module.number,
            module.epoch,
            module.turns,
            to_json(module.site),
            module.version,
            [-1 if there is None else there.version for there in sensed],
            choice.action,
            [(there.version, there.module_version) for there in reach],
            None if choice.note is None else list(choice.note),
            [to_json(each) for each in choice.guards],
            [to_json(each) for each in choice.heeds],
            [(to_json(at), list(note)) for at, note in choice.exchanges.items()],
            None if attempt is None else attempt.number,
        )
        self.put_on_record(Turns(self._process(module), [turn]))
        if attempt is not None:
            self._ask(module, attempt)

    def _ask(self, module: _Module, attempt: Attempt) -> None:
        module.asked = attempt
        units = [site_from_json(unit) for unit, _ in attempt.sensed]
        if self.system.labels is None:
            units = [self.system.place_of(unit) for unit in units]
        places = [*units, *(site_from_json(at) for at, _, _ in attempt.notes)]
        first = min(self.tiles.keeper_of(place) for place in places)
        self._put(Requests(self._process(module), first, [attempt]))


def free_run(
    spec: str, *, keepers: int = 3, seed: int = 0, moves: int = 40, restarts: int = 0
) -> tuple[Scene, list[FreeMessage]]:
    """Return the scene of a run, and its messages in the order of a recorder, without results."""
    run = FreeRun(spec, keepers=keepers, seed=seed)
    return run.scene, run.play(moves, restarts=restarts)


def results(scene: Scene, messages: Sequence[FreeMessage], keepers: int) -> list[FreeMessage]:
    """Return what a coordinator says of a run at its end."""
    found = FreeGatherer(scene, keepers)
    for message in messages:
        match message:
            case Commit():
                found.receive(message)
            case CommitLog():
                found.tail(message)
            case _:
                pass
    return results_of(found)


def results_of(found: FreeGatherer) -> list[FreeMessage]:
    """Return what a coordinator says at the end of what it gathered."""
    last, heap = found.rounds, found.heap
    start = found.scene.start_state
    proof = certificate_of(found.numbered, start=start, found=heap.normal_form(), as_text=True)
    return [
        *(Edges(step.round, list(step.executed)) for step in found.steps),
        *(Cube(last, number, list(cube)) for number, cube in enumerate(found.cubes(), 1)),
        Certified(last, proof),
        Summary(
            round=last,
            ended="goal" if found.reached else "max-rounds",
            error=None,
            rounds=last,
            moves=heap.moves,
            reduced_moves=heap.reduced_moves,
            cubes=heap.cubes,
            max_cube_dimension=heap.max_cube_dimension,
            goal_reached=found.reached,
            path_digest=found.digest,
        ),
    ]


def write(
    path: Path,
    scene: Scene,
    messages: Sequence[FreeMessage],
    *,
    keepers: int = 3,
    seed: int = 0,
    wall: bool = False,
) -> Path:
    """Write a recording of a run with these messages."""
    parameters = _parameters(scene, keepers, seed)
    if wall:
        parameters["log_time"] = "wall"
    with RecordingWriter(path, scene, parameters) as writer:
        put = _recorder(writer, wall=wall)
        for message in messages:
            put(message)
    return path


def _parameters(scene: Scene, keepers: int, seed: int) -> dict[str, str]:
    return {
        "system": scene.spec,
        "family": scene.family,
        "rule": RULE_NAME,
        "seed": str(seed),
        "hesitate": "0.0",
        "processes": "2",
        "modules": str(len(scene.start)),
        "clock": "free",
        "keepers": str(keepers),
        "log_time": "level",
    }


def _recorder(writer: RecordingWriter, *, wall: bool = False) -> Callable[[FreeMessage], None]:
    """Return what to call with each message, in order."""
    level = 0

    def put(message: FreeMessage) -> None:
        nonlocal level
        level = max(level, level_of(message))
        wall_ns = 1_700_000_000_000_000_000 + writer.messages * 1_000_000
        writer.write(
            free_topic(message),
            encode(message),
            round_number=wall_ns if wall else level,
            wall_ns=wall_ns,
        )

    return put


def write_long(path: Path, spec: str, moves: int, *, keepers: int = 3) -> int:
    """Write the recording of a whole run of random moves, of any length; return its messages."""
    numbering = Numbering()
    scene = scene_from_spec(spec)
    gatherer = FreeGatherer(scene, keepers)
    parameters = _parameters(scene, keepers, 0) | {"rule": RANDOM.name}
    with RecordingWriter(path, scene, parameters) as writer:
        put = _recorder(writer)

        def record(message: FreeMessage) -> None:
            put(numbering.numbered(message))
            if isinstance(message, Commit | CommitLog):
                gatherer.take(message)

        run = FreeRun(spec, keepers=keepers, rule=RANDOM, record=record)
        run.play(moves)
        for message in (*map(Halted, range(run.processes)), *results_of(gatherer)):
            put(numbering.numbered(message))
        return writer.messages


@cache
def free_recorded(
    spec: str, *, keepers: int = 3, seed: int = 0, moves: int = 40, restarts: int = 0
) -> Recording:
    """Return the recording of a whole run, with its results."""
    scene, messages = free_run(spec, keepers=keepers, seed=seed, moves=moves, restarts=restarts)
    whole = [*numbered(messages), *results(scene, messages, keepers)]
    return read_recording(write(new_path(), scene, whole, keepers=keepers, seed=seed))
