"""The machine of one module: by messages alone it comes to what the world in one process does."""

import random

import pytest

from cubepath.agents.environments.world import Round, World
from cubepath.agents.local import arbitration
from cubepath.agents.local.module import ModuleCore, ProtocolError
from cubepath.agents.local.observation import STAY, Note, View, goal_sets
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType
from cubepath.agents.rules.uniform import RANDOM
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.keys import addressees
from cubepath.protocol.wire.messages import (
    Claim,
    Message,
    Note as NoteMessage,
    Presence,
    Report,
    Verdict,
)
from oracles.obvious_rounds import settled, sites_after
from samples.local_families import LOCAL_FAMILIES

SPECS = [
    "hex:n=7",
    "hex-open:n=6",
    "hex-tunnel",
    "arm:n=7",
    "arm-free:n=4",
    "arms:n=2",
    "agv:graph=grid4x4,n=9",
    "agv:graph=C7,n=4",
    "agv-labelled:graph=grid3x3,n=6",
    "sliding:p=2,q=2,n=5",
    "polygon:n=8",
    "triangulation:n=8",
    "words",
    "assembly",
    "sliding-cubes:n=4",
    "pivoting-cubes:n=4",
    "rolling-dodecahedra:n=4",
]
TAKING_ALONG = {"arm:n=7", "arm-free:n=4", "arms:n=2", "sliding:p=2,q=2,n=5", "words"}
"""Systems in which a move takes other modules along."""


def _chatty(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> Choice:
        heard = sum(number for note in view.notes.values() for number in note)
        legal = view.mask.nonzero()[0]
        action = int(legal[(int(knowledge.random.integers(1000)) + heard) % len(legal)])
        silent = knowledge.random.random() < 0.4
        return Choice(action, None if silent else (knowledge.module + 1, heard % 1000))

    return choose


CHATTY = RuleType(
    name="chatty",
    summary="any legal action, by what it heard; tells what it heard, and sometimes nothing new",
    source="a test's own",
    fits=lambda _: True,
    make=_chatty,
    note_length=lambda _: 2,
)


class Mail:
    """Delivers messages between module cores in one process, in an order of its own."""

    def __init__(self, scene: Scene, seed: int, order: random.Random, note_length: int = 0) -> None:
        self.scene = scene
        self.order = order
        self.seen: dict[int, str] = {}
        goals = goal_sets(scene)
        self.cores = [
            ModuleCore(
                scene.system,
                module=module,
                site=site,
                goals=goals[module],
                seed=seed,
                note_length=note_length,
            )
            for module, site in enumerate(scene.start)
        ]
        self.post: list[Message] = []

    def deliver(self) -> None:
        """Deliver all that is under way, and what that causes, in random order."""
        at = {core.place: core for core in self.cores}
        while self.post:
            message = self.post.pop(self.order.randrange(len(self.post)))
            for place in addressees(self.scene.system, message) or ():
                if place in at:
                    self.post += at[place].hear(message)

    def round(self, number: int, actors: dict[int, Actor]) -> list[Report]:
        """Play a round by messages; return what the modules report."""
        for core in self.cores:
            self.post += core.sense(number)
        self.deliver()
        for core in self.cores:
            seen = core.observation()
            self.seen[core.module] = repr(seen)
            choice = actors[core.module].act(seen)
            self.post += core.claim(choice.action, choice.note)
        self.deliver()
        for core in self.cores:
            self.post += core.arbitrate()
        self.deliver()
        assert all(core.finished for core in self.cores)
        return [core.report() for core in self.cores]


def step(world: World, actors: dict[int, Actor], seen: dict[int, str]) -> Round:
    """Play a round in one process, and hold it to the definitions; keep what was observed."""
    scene, actions, notes = world.scene, {}, dict[int, Note]()
    for module, actor in actors.items():
        observation = world.observe(module)
        seen[module] = repr(observation)
        choice = actor.act(observation)
        actions[module] = choice.action
        if choice.note is not None:
            notes[module] = choice.note
    claims = {
        module: move
        for module, action in actions.items()
        if action and (move := scene.system.moves(world.sites[module])[action - 1]) is not None
    }
    before = list(world.sites)
    played = world.step(actions, notes)
    assert list(played.moves) == settled(claims, world.seed, played.number)
    assert world.sites == sites_after(before, played.moves.values())
    return played


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "spec",
    [
        pytest.param(each, marks=pytest.mark.thorough if n % 3 else [])
        for n, each in enumerate(SPECS)
    ],
)
def test_modules_come_by_messages_to_what_the_world_does(spec: str) -> None:
    """In any order of delivery: what each observes, is told, claims, is granted, where it ends.

    With modules that hesitate, and notes on which choices depend.
    """
    lost = taken = heard = 0
    for seed, rule, rounds in ((0, CHATTY, 16), (1, CHATTY, 16), (2, RANDOM, 24)):
        scene = scene_from_spec(spec)
        note_length = rule.note_length(len(scene.start))
        world = World(scene, seed=seed, note_length=note_length)
        mail = Mail(scene, seed, random.Random(seed + 100), note_length)  # noqa: S311 - a test's own
        here = actors_for(scene, rule, seed=seed, hesitate=0.2)
        there = actors_for(scene, rule, seed=seed, hesitate=0.2)
        for number in range(1, rounds + 1):
            before = list(world.sites)
            seen: dict[int, str] = {}
            played = step(world, here, seen)
            reports = mail.round(number, there)
            assert mail.seen == seen
            assert [site_from_json(report.before) for report in reports] == before
            assert [site_from_json(report.site) for report in reports] == world.sites
            outcomes = {report.module: report.claim for report in reports}
            assert [m for m in outcomes if outcomes[m] == "granted"] == list(played.moves)
            assert tuple(m for m in outcomes if outcomes[m] == "lost") == played.lost
            for report in reports:
                move = played.moves.get(report.module)
                assert (report.move is None) == (move is None)
                if report.move is not None and move is not None:
                    assert (report.move.generator, report.move.at) == (move.generator, move.at)
                elif report.before != report.site:
                    taken += 1
                heard += sum(kind == "note" for kind, _ in report.deliveries())
            lost += len(played.lost)
    assert lost > 0
    assert heard > 0
    assert (taken > 0) == (spec in TAKING_ALONG)


def test_every_local_family_is_among_them() -> None:
    """What holds of the machine is tried on every system that has an environment."""
    assert {spec.partition(":")[0] for spec in SPECS} == set(LOCAL_FAMILIES)


def test_one_rule_decides_in_the_world_and_on_the_wire(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the function of verdicts is another, both worlds do other than before, and the same."""
    scene = scene_from_spec("polygon:n=12")

    def outcomes() -> tuple[list[list[int]], list[list[int]]]:
        world = World(scene, seed=3)
        mail = Mail(scene, 3, random.Random(3))  # noqa: S311 - a test's own order
        here = actors_for(scene, RANDOM, seed=3, hesitate=0.0)
        there = actors_for(scene, RANDOM, seed=3, hesitate=0.0)
        one, other = [], []
        for number in range(1, 12):
            actions = {m: actor.act(world.observe(m)).action for m, actor in here.items()}
            one.append(list(world.step(actions).moves))
            reports = mail.round(number, there)
            other.append([report.module for report in reports if report.claim == "granted"])
        return one, other

    def timid(outranking: frozenset[int], verdicts: dict[int, bool]) -> bool | None:
        return None if outranking - verdicts.keys() else not outranking

    before = outcomes()
    # Its code, not its name: whoever imported it by name has the same function.
    monkeypatch.setattr(arbitration.verdict, "__code__", timid.__code__)
    after = outcomes()
    assert before[0] == before[1]
    assert after[0] == after[1]
    assert before != after


def core_of(spec: str) -> ModuleCore:
    """Return module 0 of a scene, before its first round."""
    scene = scene_from_spec(spec)
    return ModuleCore(scene.system, module=0, site=scene.start[0], goals=(), seed=0, note_length=0)


def test_a_late_message_is_never_taken_silently() -> None:
    """A message for a phase that is over means that barriers broke: the module says so."""
    core = core_of("hex:n=3")
    core.sense(1)
    core.observation()
    with pytest.raises(ProtocolError, match="came late"):
        core.hear(Presence(1, 1, (1, 0)))
    with pytest.raises(ProtocolError, match="came late"):
        core.hear(Claim(0, 1, (1, 0), "pivot-0-left", (1, 0)))
    with pytest.raises(ProtocolError, match="no move from there"):
        core.hear(Claim(1, 1, (1, 0), "pivot-0-left", (5, 5)))


def test_an_early_message_is_never_taken_silently() -> None:
    """Whoever gives a module its messages keeps those of later rounds until then."""
    core = core_of("hex:n=3")
    core.sense(1)
    early = "presence of module_1 for round 2 came early, in phase sense of round 1"
    with pytest.raises(ProtocolError, match=early):
        core.hear(Presence(2, 1, (1, 0)))


LAST_PHASES = {"presence": "sense", "note": "sense", "claim": "claim", "verdict": "settle"}
"""The last phase of a round in which a kind of message still counts."""


@pytest.mark.parametrize("phase", ["sense", "claim", "settle", "report"])
@pytest.mark.parametrize("kind", LAST_PHASES)
def test_each_kind_of_message_has_its_last_phase(kind: str, phase: str) -> None:
    """It is heard up to that phase of its round and late in every further one."""
    core = core_of("agv:graph=P3,n=1")
    core.sense(1)
    if phase != "sense":
        core.observation()
        core.claim(STAY, None)
    if phase in {"settle", "report"}:
        core.arbitrate()
    if phase == "report":
        core.report()
    messages: dict[str, Message] = {
        "presence": Presence(1, 1, 2),
        "note": NoteMessage(1, 1, 2, [7]),
        "claim": Claim(1, 1, 2, "edge", (1, 2)),
        "verdict": Verdict(1, 1, 2, granted=True, to=[0]),
    }
    message = messages[kind]
    phases = ["sense", "claim", "settle", "report"]
    if phases.index(phase) <= phases.index(LAST_PHASES[kind]):
        assert core.hear(message) == []
    else:
        late = f"module_0: {kind} of module_1 for round 1 came late, in phase {phase} of round 1"
        with pytest.raises(ProtocolError, match=late):
            core.hear(message)


def test_a_report_tells_what_was_heard_in_an_order_of_its_own() -> None:
    """By kind, then by module, whatever the order of arrival."""
    said: list[Message] = [
        *(Presence(1, module, module) for module in (1, 2, 10)),
        *(Claim(1, module, module, "edge", (0, module)) for module in (1, 2, 10)),
    ]
    expected = [
        ("claim", 1),
        ("claim", 2),
        ("claim", 10),
        ("presence", 1),
        ("presence", 2),
        ("presence", 10),
    ]
    for order in (said, said[::-1]):
        core = core_of("agv:graph=K11,n=1")
        core.sense(1)
        for message in order:
            core.hear(message)
        core.observation()
        core.claim(STAY, None)
        core.arbitrate()
        assert [*core.report().deliveries()] == expected


@pytest.mark.parametrize("action", [-1, 1, 99])
def test_an_action_that_is_not_in_the_mask_is_refused(action: int) -> None:
    """A module claims nothing that it has not found admissible itself."""
    core = core_of("agv:graph=P3,n=1")
    core.sense(1)
    core.hear(Presence(1, 1, 1))
    core.observation()
    with pytest.raises(ProtocolError, match=f"module_0: action {action} is not in its mask"):
        core.claim(action, None)


def test_a_verdict_goes_to_those_who_wait_and_is_said_once() -> None:
    """The claim that outranks the other is granted at once, and only the other is told."""
    scene = scene_from_spec("agv:graph=P3,n=2")
    verdicts: list[Verdict] = []
    cores = [
        ModuleCore(scene.system, module=m, site=site, goals=(), seed=0, note_length=0)
        for m, site in enumerate((0, 2))
    ]
    for core in cores:
        core.sense(1)
        core.observation()
    claims = [core.claim(1, None) for core in cores]
    for core, said in zip(cores, reversed(claims), strict=True):
        for message in said:
            core.hear(message)
    said_by = [core.arbitrate() for core in cores]
    first = 0 if arbitration.priority(0, 1, 0) > arbitration.priority(0, 1, 1) else 1
    verdicts = [message for said in said_by for message in said if isinstance(message, Verdict)]
    assert verdicts == [Verdict(1, first, 2 * first, granted=True, to=[2 - 2 * first])]
    assert [core.finished for core in cores] == [first == 0, first == 1]
    assert cores[1 - first].hear(verdicts[0]) == []
    assert {core.module: core.report().claim for core in cores} == {
        first: "granted",
        1 - first: "lost",
    }
