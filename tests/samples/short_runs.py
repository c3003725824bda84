"""Short runs of three modules, for the explorer; and what comes of them in one process."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from cubepath.agents.environments.world import World
from cubepath.agents.processes.config import ProcessConfig
from cubepath.agents.processes.dealing import dealt
from cubepath.agents.processes.judge import Judge
from cubepath.agents.processes.node import HostNode
from cubepath.agents.processes.pacer import Pacer
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_to_toml
from cubepath.protocol.wire.messages import Message, Refused, Report, Retransmit, Waiting
from cubepath.protocol.wire.nodes import Effect, End, Keep, Node
from oracles.obvious_rounds import rank

RUN = "run"


class Coordinator:
    """Paces some rounds, keeps what belongs on record, and ends the run."""

    def __init__(self, pacer: Pacer, rounds: int) -> None:
        self.pacer = pacer
        self.kept: dict[bytes, Message] = {}
        """What was kept, in order; without what asks again or is refused, which may come twice."""
        self._rounds = rounds

    def start(self) -> list[Effect]:
        return self._go_on(self.pacer.start())

    def receive(self, key: str, data: bytes) -> list[Effect]:
        return self._go_on(self.pacer.receive(key, data))

    def tick(self) -> list[Effect]:
        return self._go_on(self.pacer.tick())

    def _go_on(self, effects: list[Effect]) -> list[Effect]:
        """Begin the next round if one is over, or end the run."""
        found: list[Effect] = []
        while True:
            for effect in effects:
                if isinstance(effect, Keep):
                    self._keep(effect)
                else:
                    found.append(effect)
            if not self.pacer.idle:
                return found
            if self.pacer.round == self._rounds:
                return [*found, *(e for e in self.pacer.stop() if not isinstance(e, Keep)), End()]
            effects = self.pacer.begin_round()

    def _keep(self, kept: Keep[Message]) -> None:
        if isinstance(kept.message, Retransmit | Waiting | Refused):
            return
        assert kept.data not in self.kept, "it is kept twice"
        self.kept[kept.data] = kept.message


@dataclass(frozen=True, slots=True)
class ShortRun:
    """A scene with what its modules do in a few rounds, and the processes that they are in."""

    scene: Scene
    rule: str
    seed: int
    processes: int
    rounds: int = 2
    hesitate: float = 0.0

    def nodes(self, kind: type[HostNode] = HostNode) -> list[Node]:
        """Return the coordinator and the module processes, whose nodes may have a bug."""
        modules_of = dealt(self.scene, self.processes)
        text = scene_to_toml(self.scene)
        hosts = [
            kind(
                ProcessConfig(
                    endpoint="",
                    run=RUN,
                    process=process,
                    modules=modules,
                    processes=modules_of,
                    scene=text,
                    rule=self.rule,
                    seed=self.seed,
                    hesitate=self.hesitate,
                    note_length=0,
                )
            )
            for process, modules in enumerate(modules_of)
        ]
        judge = Judge(RUN, modules_of, self.scene.system)
        return [Coordinator(Pacer(RUN, modules_of, judge=judge), self.rounds), *hosts]

    def reports(self) -> list[Report]:
        """Return what the modules must report, from the environment in one process.

        What each has heard is what the definition says: who stood where it senses, who said or
        claimed something within its reach, whose verdict it waited for.
        """
        rule = rule_named(self.rule, self.scene.system)
        note_length = rule.note_length(len(self.scene.start))
        world = World(self.scene, seed=self.seed, note_length=note_length)
        actors = actors_for(self.scene, rule, seed=self.seed, hesitate=self.hesitate)
        return [
            report
            for number in range(1, self.rounds + 1)
            for report in _round(world, actors, number, notes=bool(note_length) and number > 1)
        ]


def _round(world: World, actors: dict[int, Actor], number: int, *, notes: bool) -> list[Report]:
    system, before = world.scene.system, list(world.sites)
    choices = {module: actor.act(world.observe(module)) for module, actor in actors.items()}
    claims: dict[int, Move] = {}
    for module, choice in choices.items():
        move = system.moves(before[module])[choice.action - 1] if choice.action else None
        if move is not None:
            claims[module] = move
    played = world.step(
        {module: choice.action for module, choice in choices.items()},
        {module: choice.note for module, choice in choices.items() if choice.note is not None},
    )
    told_by = {module: _waiting(module, claims, before, world.seed, number) for module in claims}
    found: list[Report] = []
    for module, site in enumerate(before):
        place = system.place_of(site)
        others = {other: system.place_of(before[other]) for other in actors if other != module}
        within = [other for other, there in others.items() if there in system.reach(place)]
        heard = {
            "claim": [other for other in within if other in claims],
            "presence": [other for other, there in others.items() if there in system.sensed(place)],
            "note": within if notes else [],
            "verdict": [other for other, told in told_by.items() if module in told],
        }
        made = played.moves.get(module)
        outcome: Literal["none", "granted", "lost"] = "lost" if module in played.lost else "none"
        report = Report(
            round=number,
            module=module,
            before=site,
            site=world.sites[module],
            claim=outcome if made is None else "granted",
            move=None if made is None else GeneratorPlacement(made.generator, made.at),
            received={kind: senders for kind, senders in heard.items() if senders},
            failed=choices[module].failed,
        )
        found.append(report)
    return found


def _waiting(
    module: int, claims: Mapping[int, Move], sites: list[Site], seed: int, number: int
) -> set[int]:
    """Return who waits for a verdict: rivals that it outranks, and those that are taken along."""
    mine = claims[module]
    rivals = {
        other
        for other, move in claims.items()
        if rank(seed, number, other) < rank(seed, number, module)
        and not commute(mine.action, move.action)
    }
    return rivals | {sites.index(source) for source, _ in mine.motion[1:]}
