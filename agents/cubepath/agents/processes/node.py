"""The node of a module process: some modules of a run, as a pure machine.

It receives messages and ticks and returns effects; `host` carries them out on zenoh. It sends the
messages of its modules, one per region, and passes each module what is addressed to its place once
everything of a phase has arrived. Late, duplicate or reordered messages make no difference; the
node asks again for missing ones. A refused message (`judge`) has no effect.
"""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Literal

from cubepath.agents.local.module import ModuleCore
from cubepath.agents.local.observation import STAY, Observation, goal_sets
from cubepath.agents.processes import judge
from cubepath.agents.processes.config import OUTSIDE, ProcessConfig
from cubepath.agents.processes.mailbox import Inbox, Outbox
from cubepath.agents.rules.actor import Actor, actors_for
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import RuleType
from cubepath.agents.rules.schedule import as_recorded, scheduled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.keys import addressees, key_of, to_region, topic_key
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Listen, Put, Timer

_REPEATS_MAX = 1000
"""How often a process retransmits for another in a round; a flood ends there."""


class HostNode:
    """The modules of one process."""

    def __init__(self, config: ProcessConfig, scene: Scene | None = None) -> None:
        """Read the scene and the rule; InputError if there is no such rule for it.

        A `scene` that is built already is taken instead of the text of the configuration.
        """
        self._config = config
        self._scene = scene_from_toml(config.scene, "the configuration") if scene is None else scene
        self._system = self._scene.system
        self._judge = judge.Judge(config.run, config.processes, self._system)
        self._rule: RuleType | None = None
        if config.rule != OUTSIDE:
            self._rule = rule_named(config.rule, self._system)
        self._begin(config.seed, 0)

    def _begin(self, seed: int, round_number: int) -> None:
        """Put the modules at their start, with no memory."""
        config, scene = self._config, self._scene
        self._seed = seed
        self._actors: dict[int, Actor] = {}
        self._at = (round_number, judge.ORDER["join"])
        self._phase: str = "join"
        self._round = round_number
        self._pending: wire.Go | None = None
        self._given: dict[int, wire.ChosenActions] = {}
        self._inbox = Inbox()
        self._outbox = Outbox(scene.system, config.run, config.process, round_number)
        self._answers: list[Put] = []
        self._delivered = False
        self._repeats: dict[int, int] = {}
        self._wait_s: float | None = None
        note_length = config.note_length
        if self._rule is not None:
            self._actors, note_length = _at_incarnation(config, scene, self._rule, seed)
        self._judge.note_length = note_length
        later_seeds = () if config.recorded is None else config.recorded.seeds
        goals = goal_sets(scene)
        self._cores = {
            module: ModuleCore(
                scene.system,
                module=module,
                site=scene.start[module],
                goals=goals[module],
                seed=seed,
                note_length=self._actors[module].note_length if self._actors else note_length,
                rounds_before=round_number,
                later_seeds=later_seeds,
            )
            for module in config.modules
        }
        self._look_around()

    def _look_around(self) -> None:
        """Note where the modules are now."""
        self._there: dict[Site, ModuleCore] = {}
        self._within: dict[str, dict[Site, ModuleCore]] = {}
        for core in self._cores.values():
            place = core.place
            self._there[place] = core
            self._within.setdefault(self._system.region(place), {})[place] = core

    @property
    def state(self) -> str:
        """Return its phase, or ``waiting`` if the next one lacks messages of others."""
        return self._phase if self._pending is None else "waiting"

    def start(self) -> list[Effect]:
        """Listen, and announce the process until it is told to begin."""
        config = self._config
        keys = [
            topic_key(config.run, "go", "coordinator"),
            topic_key(config.run, "go", f"process_{config.process}"),
            topic_key(config.run, "retransmit"),
            topic_key(config.run, "reset", "coordinator"),
            topic_key(config.run, "reset", f"process_{config.process}"),
        ]
        if self._rule is None:
            keys.append(topic_key(config.run, "actions", f"process_{config.process}"))
        return [Listen((*keys, *self._keys_of(self._within))), *self._join()]

    def _join(self) -> list[Effect]:
        return [*self._answer(wire.Ready(self._round, self._config.process, "join")), *self._wait()]

    def _keys_of(self, regions: Iterable[str]) -> tuple[str, ...]:
        return tuple(to_region(self._config.run, region) for region in sorted(regions))

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message; what is refused, or not for a process, has no effect."""
        try:
            return self._receive(self._judge.read(key, data))
        except judge.RefusedError:
            return []  # the coordinator hears it too, and puts it on record

    def _receive(self, message: wire.Message) -> list[Effect]:
        match message:
            case wire.Bundle():
                return self._hear(message)
            case wire.Go():
                return self._go(message)
            case wire.Retransmit():
                return list(self._repeated(message))
            case wire.ChosenActions():
                return self._take_acts(message)
            case wire.Reset():
                return self._reset(message)
            case _:
                return []  # a stranger put it there

    def tick(self) -> list[Effect]:
        """Ask again for what is missing, or say again that the process is there."""
        if self._phase == "join" and self._pending is None:
            return [*self._answers, *self._wait()]
        found: list[Effect] = []
        if self._pending is not None:
            before = judge.BEFORE.get(self._pending.phase)
            if before is not None:
                found += [self._ask(before, region) for region in self._missing(self._pending)]
        elif self._phase == "settle" and not self._answers:
            late = {
                self._system.region(core.place)
                for core in self._cores.values()
                if not core.finished
            }
            found += [self._ask("settle", region) for region in sorted(late)]
        return [*found, *self._wait()]

    def _wait(self) -> list[Effect]:
        """Set the timer, each time for longer until `_go_on`."""
        wait_s = self._wait_s
        self._wait_s = judge.ASK_S_MIN if wait_s is None else min(2 * wait_s, judge.ASK_S_MAX)
        return [Timer(self._wait_s)]

    def _go_on(self) -> list[Effect]:
        """Stop the timer, if it runs."""
        if self._wait_s is None:
            return []
        self._wait_s = None
        return [Timer(None)]

    def _ask(self, phase: judge.Spoken, region: str) -> Put:
        message = wire.Retransmit(self._round, self._config.process, phase, region)
        return Put(key_of(self._config.run, message), wire.encode(message))

    def _repeated(self, again: wire.Retransmit) -> Iterable[Put]:
        repeats = self._repeats.get(again.process, 0)
        if again.round != self._round or repeats >= _REPEATS_MAX:
            return ()
        self._repeats[again.process] = repeats + 1
        return self._outbox.sent_to(again.phase, again.region)

    def _answer(self, *messages: wire.Message) -> list[Put]:
        """Answer the coordinator; the answer is repeated if it asks again."""
        puts = [Put(key_of(self._config.run, each), wire.encode(each)) for each in messages]
        self._answers += puts
        return puts

    def _ready(self, phase: Literal["sense", "observe", "claim", "settle", "over"]) -> wire.Ready:
        counts = self._outbox.counts(phase)
        return wire.Ready(self._round, self._config.process, phase, counts)

    # Incoming messages.

    def _hear(self, bundle: wire.Bundle) -> list[Effect]:
        """Keep a bundle for the end of its phase; verdicts are given immediately."""
        if not self._awaits(bundle) or self._inbox.knows(bundle):
            return []
        self._judge.check(bundle)
        self._inbox.keep(bundle)
        if bundle.phase == self._phase == "settle":
            return self._conclude(self._tell_own(self._give(bundle)))
        return self._try_to_begin()

    def _awaits(self, bundle: wire.Bundle) -> bool:
        """Return whether a bundle's phase is still to come or under way; else it is a double."""
        if bundle.process == self._config.process or bundle.region not in self._within:
            return False
        if bundle.phase == "sense":
            return bundle.round == self._round + 1 or (
                bundle.round == self._round and not self._delivered
            )
        if bundle.round != self._round:
            return False
        if bundle.phase == "claim":
            return self._phase in ("sense", "observe", "claim")
        return self._phase == "claim" or (self._phase == "settle" and not self._answers)

    def _give(self, bundle: wire.Bundle) -> list[wire.Part]:
        """Give modules what is addressed to their places; return what they say to it."""
        there = self._within.get(bundle.region)
        found: list[wire.Part] = []
        if there:
            system = self._system
            for part in bundle.parts:
                for place in filter(there.__contains__, addressees(system, part)):
                    found += there[place].hear(part)
        return found

    def _missing(self, go: wire.Go) -> list[str]:
        """Return the regions of the modules to which more was sent than has arrived."""
        before = judge.BEFORE.get(go.phase)
        if before is None:
            return []
        heard, said = self._inbox.counts(go.round, before), self._outbox.counts(before)
        return [
            region
            for region in sorted(self._within)
            if heard.get(region, 0) + said.get(region, 0) < go.sent.get(region, 0)
        ]

    def _deliver(self, round_number: int, phase: judge.Spoken) -> None:
        """Give modules everything that modules of other processes sent in a phase."""
        for bundle in self._inbox.take(round_number, phase):
            self._give(bundle)

    # Outgoing messages.

    def _tell_own(self, parts: Iterable[wire.Part]) -> list[wire.Part]:
        """Give what own modules say to own modules; return all messages, answers included."""
        others: list[wire.Part] = []
        there, queue = self._there, deque(parts)
        while queue:
            part = queue.popleft()
            others.append(part)
            for place in filter(there.__contains__, addressees(self._system, part)):
                queue.extend(there[place].hear(part))
        return others

    # The phases.

    def _go(self, go: wire.Go) -> list[Effect]:
        if go.phase == "stop":
            return [End()]
        at = (go.round, judge.ORDER[go.phase])
        if at == self._at:
            return self._repeat()
        if at < self._at or not self._follows(go):
            return []
        asked_again = self._pending is not None
        self._pending = go
        found = self._try_to_begin()
        if asked_again and self._at != at:
            found.append(self._waiting(go.round, go.phase))
        return found

    def _follows(self, go: wire.Go) -> bool:
        """Return whether the phase is the next one.

        A process that came back without its memory is asked for a later one. It does not take part:
        it says that it is there, as at its incarnation, until the coordinator's patience ends.
        """
        first = go.phase in ("sense", "over")
        if go.phase == "observe" and self._rule is not None:
            return False
        if first:
            due = bool(self._answers) and self._phase in ("settle", "join", "over")
        else:
            due = self._phase in (("claim",) if go.phase == "settle" else ("sense", "observe"))
        return due and go.round == self._round + (go.phase == "sense")

    def _waiting(self, round_number: int, phase: str) -> Put:
        """Say that the process is there, but cannot do the phase without others."""
        message = wire.Waiting(round_number, self._config.process, phase)
        return Put(key_of(self._config.run, message), wire.encode(message))

    def _repeat(self) -> list[Effect]:
        """Repeat all messages of this phase."""
        answers = self._answers or [self._waiting(self._round, self._phase)]
        return [*self._outbox.sent(self._phase), *answers]

    def _try_to_begin(self) -> list[Effect]:
        """Begin the phase that was asked for, if nothing is missing."""
        go = self._pending
        if go is None:
            return []
        if self._missing(go) or (
            go.phase == "claim" and self._rule is None and go.round not in self._given
        ):
            return self._wait() if self._wait_s is None else []
        self._pending = None
        self._at = (go.round, judge.ORDER[go.phase])
        self._phase = go.phase
        self._answers = []
        before = self._go_on()
        return [*before, *self._work(go)]

    def _work(self, go: wire.Go) -> list[Effect]:
        """Do what is to be done in a phase."""
        match go.phase:
            case "sense":
                return self._sense(go.round)
            case "observe":
                return self._observe()
            case "claim":
                return self._claim()
            case "settle":
                return self._arbitrate()
            case _:
                return self._end_schedule()

    def _sense(self, round_number: int) -> list[Effect]:
        self._round = round_number
        self._repeats.clear()
        self._outbox.begin(round_number)
        self._inbox.forget_before(round_number)
        self._delivered = False
        self._given = {key: acts for key, acts in self._given.items() if key >= round_number}
        parts = [part for core in self._cores.values() for part in core.sense(round_number)]
        effects = self._outbox.say("sense", self._tell_own(parts))
        return [*effects, *self._answer(self._ready("sense"))]

    def _observe(self) -> list[Effect]:
        """Send the observations of modules that are driven from outside."""
        self._hear_senses()
        observed = [
            _observed(self._round, module, core.observation())
            for module, core in self._cores.items()
        ]
        sent = wire.Observations(self._round, self._config.process, observed)
        return [*self._answer(sent, self._ready("observe"))]

    def _hear_senses(self) -> None:
        if not self._delivered:
            self._delivered = True
            self._deliver(self._round, "sense")

    def _claim(self) -> list[Effect]:
        self._hear_senses()
        claims: list[wire.Part] = []
        if self._rule is None:
            for act in self._given.pop(self._round).parts:
                core = self._cores[act.module]
                # As in the environment: what is not in the mask counts as to stay.
                action = act.action if core.may(act.action) else STAY
                claims += core.claim(action, tuple(act.note))
        else:
            for module, core in self._cores.items():
                choice = self._actors[module].act(core.observation(), self._round)
                claims += core.claim(choice.action, choice.note, choice.failed)
        effects = self._outbox.say("claim", self._tell_own(claims))
        return [*effects, *self._answer(self._ready("claim"))]

    def _arbitrate(self) -> list[Effect]:
        self._deliver(self._round, "claim")
        parts = [part for core in self._cores.values() for part in core.arbitrate()]
        results = self._tell_own(parts)
        for verdicts in self._inbox.kept(self._round, "settle"):
            results += self._tell_own(self._give(verdicts))
        return self._conclude(results)

    def _conclude(self, parts: list[wire.Part]) -> list[Effect]:
        """Say the verdicts; report if all modules are through with the round."""
        found: list[Effect] = [*self._outbox.say("settle", parts)]
        if not all(core.finished for core in self._cores.values()):
            return [*found, *self._wait()] if self._wait_s is None else found
        reports = wire.Reports(
            self._round, self._config.process, [core.report() for core in self._cores.values()]
        )
        # Listen at the new places before reporting that the round is done: messages of the next
        # round must find the listener there.
        before = set(self._within)
        self._look_around()
        after = set(self._within)
        if after - before:
            found.append(Listen(self._keys_of(after - before)))
        if before - after:
            found.append(Ignore(self._keys_of(before - after)))
        return [*self._go_on(), *found, *self._answer(reports, self._ready("settle"))]

    def _end_schedule(self) -> list[Effect]:
        """Let every module follow its rule from where it stands, with no memory."""
        config = self._config
        if self._rule is not None and (config.schedule, config.recorded) != (None, None):
            sites = {module: core.site for module, core in self._cores.items()}
            self._actors, note_length = _afterwards(
                config, self._scene, self._rule, self._seed, sites
            )
            self._judge.note_length = note_length
            heard = config.recorded is not None and config.recorded.heard
            for core in self._cores.values():
                core.follow(note_length, heard=heard)
        return [*self._answer(self._ready("over"))]

    # Driven from outside.

    def _take_acts(self, acts: wire.ChosenActions) -> list[Effect]:
        if not self._round <= acts.round <= self._round + 1:
            return []
        if acts.process != self._config.process:
            return []
        self._judge.check_whole(acts)
        self._given.setdefault(acts.round, acts)
        return self._try_to_begin()

    def _reset(self, reset: wire.Reset) -> list[Effect]:
        at = (reset.round, judge.ORDER["join"])
        if at == self._at:
            return [*self._answers]
        if at < self._at:
            return []
        before = set(self._within)
        self._begin(reset.seed, reset.round)
        after = set(self._within)
        found: list[Effect] = [Timer(None)]
        if after - before:
            found.append(Listen(self._keys_of(after - before)))
        if before - after:
            found.append(Ignore(self._keys_of(before - after)))
        return [*found, *self._join()]


def _observed(round_number: int, module: int, seen: Observation) -> wire.ModuleObservation:
    return wire.ModuleObservation(
        round=round_number,
        module=module,
        observation=seen["observation"].tolist(),
        action_mask=seen["action_mask"].tolist(),
        notes=seen["notes"].tolist() if "notes" in seen else [],
    )


def _at_incarnation(
    config: ProcessConfig, scene: Scene, rule: RuleType, seed: int
) -> tuple[dict[int, Actor], int]:
    """Return an actor for each module, by number, and the length of the notes."""
    modules, recorded, doubt = config.modules, config.recorded, config.hesitate
    if recorded is None:
        first = rule if config.schedule is None else scheduled(config.schedule)
        actors = actors_for(scene, first, seed=seed, hesitate=doubt, modules=modules)
        return actors, first.length(len(scene.start))
    bound = [module for module in modules if module in recorded.choices]
    free = [module for module in modules if module not in recorded.choices]
    actors = actors_for(scene, as_recorded(recorded), seed=seed, hesitate=0.0, modules=bound)
    actors |= actors_for(scene, rule, seed=seed, hesitate=doubt, modules=free)
    return actors, recorded.note_length


def _afterwards(
    config: ProcessConfig, scene: Scene, rule: RuleType, seed: int, sites: Mapping[int, Site]
) -> tuple[dict[int, Actor], int]:
    """Return the same for when the schedule or the record is over, and modules are at `sites`."""
    recorded = config.recorded
    others = {} if recorded is None else recorded.rules
    if recorded is not None and recorded.seeds:
        seed = recorded.seeds[-1][1]
    actors: dict[int, Actor] = {}
    for name in sorted({others.get(module, "") for module in config.modules}):
        actors |= actors_for(
            scene,
            rule_named(name, scene.system) if name else rule,
            seed=seed,
            hesitate=config.hesitate,
            modules=[module for module in config.modules if others.get(module, "") == name],
            sites=sites,
        )
    return actors, rule.length(len(scene.start))
