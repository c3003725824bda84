"""Some modules live and the others from a recording, up to the first divergence, which is named.

The modules of a recording are played again in a run of real processes: the live ones follow their
rule, the others repeat their recorded choices. As long as the live ones do as before, every message
equals the recorded one; so the first difference comes from a live module.
"""

import re
from collections.abc import Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from msgspec.structs import replace

from cubepath.agents.processes.pacer import PATIENCE_S
from cubepath.agents.rules.registry import (
    find_rule,
    is_in_file,
    own_rule,
    permitted_rule,
    rule_named,
)
from cubepath.agents.rules.schedule import RecordedChoices
from cubepath.coordinator.runs.continuing import parent_parameters
from cubepath.coordinator.runs.driver import Say
from cubepath.coordinator.runs.listeners import TappedMessage, Watch
from cubepath.coordinator.runs.on_record import (
    RecordedDecisions,
    Words,
    move_text,
    on_record,
    tell_damages,
)
from cubepath.coordinator.runs.plan import Branch, Plan
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.verification.parameters import RuleStage, spans, stages_text
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.sites import Site, in_order, site_text
from cubepath.protocol.recordings.recording import Recording, recording_of
from cubepath.protocol.wire.messages import Claim, Note, Part, Report, Verdict

_ORDER = ("note", "claim", "verdict", "report")
_MODULE = re.compile(r"\bmodule_(\d+)\b")


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first thing that a live module does, or a process says, other than in the recording.

    >>> found = replay_live("logs/golden/agv-6.mcap", [0], rule="random", processes=0).divergence
    >>> found.round, found.module, found.kind, found.recorded
    (2, 0, 'note', 'notes of 11 numbers')
    """

    round: int
    module: int | None
    """None if the run ended there for another reason than a module."""
    kind: str
    """"note", "claim", "verdict" or "report"; "failed" if the run ended there."""
    recorded: str
    """What is recorded."""
    live: str
    """What came instead."""
    site: str | None
    """Where the module stood when it chose, as JSON."""
    sensed: tuple[str, ...]
    """What it sensed and heard there."""

    def __str__(self) -> str:
        """Return it in a line, and in a second one what the module had sensed."""
        module = "" if self.module is None else f", module_{self.module}"
        lines = [f"round {self.round}{module}: {self.live}; on record {self.recorded}"]
        if self.site is not None:
            lines.append(
                "; ".join([f"it stood at {self.site}", *(self.sensed or ["saw no module"])])
            )
        return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class LiveReplay:
    """The outcome of a replay with live modules."""

    log: str
    """The recording that was replayed."""
    live: tuple[int, ...]
    """The modules that were live."""
    rounds: int
    """How many rounds were the same, from the first on."""
    recorded_rounds: int
    """How many whole rounds are recorded."""
    divergence: Divergence | None
    recording: str | None = None
    """Where the run with the live modules is recorded, if it was to be."""

    @property
    def same(self) -> bool:
        """Whether all rounds in the recording were the same."""
        return self.divergence is None

    def document(self) -> dict[str, Any]:
        """Return the keys of ``cubepath replay --modules --json``."""
        found = self.divergence
        divergence = None
        if found is not None:
            divergence = {key: getattr(found, key) for key in found.__slots__}
            divergence["sensed"] = list(found.sensed)
        return {
            "log": self.log,
            "live": list(self.live),
            "rounds": self.rounds,
            "recorded_rounds": self.recorded_rounds,
            "same": self.same,
            "divergence": divergence,
            "recording": self.recording,
        }


def replay_live(
    recording: Recording | Source,
    modules: Iterable[int] | None = None,
    *,
    rule: str | None = None,
    processes: int = 4,
    log: str | Path | None = None,
    patience: float = PATIENCE_S,
    listen: str | None = None,
    connect: str | None = None,
    secure: str | Path | None = None,
    wait_for: int = 0,
    watch: Watch | None = None,
    say: Say | None = None,
) -> LiveReplay:
    """Replay a recording with some modules live, up to the first divergence.

    >>> found = replay_live("logs/golden/agv-6.mcap", [0, 1], processes=0)
    >>> found.same, found.rounds
    (True, 16)
    >>> print(replay_live("logs/golden/agv-3.mcap", [2], rule="tswap", processes=0).divergence)
    round 2, module_2: notes of 9 numbers; on record no notes
    it stood at 2; sensed module_1 at 1

    Args: recording: of a run with rounds by one rule; of one that was cut off, its whole rounds.
        modules: those that are live, by default all. The others choose as in the recording. rule:
        what the live ones follow, a name or ``FILE.py:NAME``; by default the recorded rule.
        processes: as for `run`, like all that follows. log: where the run with the live modules is
        recorded; by default nothing is kept of it. patience: seconds. listen: where processes of
        others may join, with modules that are live. connect: instead, where a router listens
        already. secure: the folder of certificates. wait_for: how many processes join; what live
        modules they leave follow the rule here. watch: called after each round. say: told in a line
        what continues.

    InputError if the recording or the rule does not allow that.
    """
    record = on_record(recording_of(recording))
    stage = _stage_of(record)
    everyone = range(len(record.recording.scene.start))
    live = tuple(everyone if modules is None else sorted(set(modules)))
    _check(record, live)
    name = _rule_of(record, stage, live, joined=bool(wait_for)) if rule is None else rule
    own, recorded = _note_lengths(record, name)
    kept = None if log is None else str(log)
    tell_damages(record, say)
    with ExitStack() as resources:
        if log is None:
            folder = resources.enter_context(TemporaryDirectory(prefix="cubepath-live-"))
            log = Path(folder) / "live.mcap"
        plan = Plan(
            system=record.recording.scene,
            rule=name,
            seed=stage.seed,
            hesitate=stage.hesitate,
            processes=processes,
            # In round 2 notes are heard, and none is taken for one of another length.
            max_rounds=record.rounds if own == recorded else 1,
            log=Path(log),
            patience=patience,
            listen=listen,
            connect=connect,
            secure=None if secure is None else Path(secure),
            wait_for=wait_for,
        )
        branch = _branch(record, stage, name, live, recorded)
        running = Run(plan, watch=watch, say=say, branch=branch)
        other = None if own == recorded else (_notes(recorded), _notes(own))
        return _played(record, live, running, other, kept)


def _notes(length: int) -> str:
    return f"notes of {length} numbers" if length else "no notes"


def _check(record: RecordedDecisions, live: tuple[int, ...]) -> None:
    path, modules = record.recording.path, len(record.recording.scene.start)
    strange = [module for module in live if not 0 <= module < modules]
    if strange or not live:
        problem = f"modules={strange[0]}: no such module" if strange else "modules: none is live"
        raise InputError(f"{problem}, {path} has 0-{modules - 1}")
    if not record.rounds:
        raise InputError(f"{path}: no whole round is on record, expected some to compare with")


def _stage_of(record: RecordedDecisions) -> RuleStage:
    first, *others = record.stages
    if others:
        raise InputError(
            f"{record.recording.path}: other rules took over in round {others[0].begins},"
            " expected a recording of a run by the same rules throughout"
        )
    return first


def _rule_of(
    record: RecordedDecisions, stage: RuleStage, live: tuple[int, ...], *, joined: bool
) -> str:
    """Return the one rule that modules follow in the recording.

    For those of processes that have `joined`, whose rule may be their own, that of the family.
    """
    names = [name for name in stage.rules if not set(live).isdisjoint(stage.modules(name))]
    named = {module for name in names for module in stage.modules(name)}
    if joined and not named >= set(live):
        return own_rule(record.recording.scene)
    if len(names) != 1 or not named >= set(live):
        raise InputError(
            f"{record.recording.path}: its modules followed rules of their own, expected a rule"
        )
    return permitted_rule(names[0])


def _note_lengths(record: RecordedDecisions, name: str) -> tuple[int, int]:
    """Return how many numbers the notes of the rule have, and those in the recording."""
    scene = record.recording.scene
    modules = len(scene.start)
    own, recorded = rule_named(name, scene.system).length(modules), record.note_length
    if recorded == 0 and record.rounds > 1:  # all are silent, or nobody is near
        # A file that the recording names does not run, so its rule is taken for a silent one.
        rules = [None if is_in_file(each) else find_rule(each) for each in record.stages[0].rules]
        speak = all(each is not None and each.length(modules) > 0 for each in rules)
        return own, own if speak else 0
    return own, recorded if record.rounds > 1 else own


def _branch(
    record: RecordedDecisions, stage: RuleStage, name: str, live: tuple[int, ...], length: int
) -> Branch:
    left = {
        each: [module for module in stage.modules(each) if module not in set(live)]
        for each in stage.rules
    }
    left[name] = [*left.get(name, ()), *live]
    rules = {each: spans(those) for each, those in left.items() if those}
    recorded = RecordedChoices(
        choices={n: chosen for n, chosen in record.choices.items() if n not in set(live)},
        note_length=length,
    )
    parameters = {
        **parent_parameters(record),
        "live": spans(live),
        "stages": stages_text((replace(stage, rules=rules),)),
    }
    return Branch(recorded, None, parameters)


class _Subscriber:
    """What was sent in the rounds under way, and the first message that was refused."""

    def __init__(self) -> None:
        self.words: dict[int, Words] = {}
        self.refused: str | None = None

    def hear(self, overheard: TappedMessage) -> None:
        message = overheard.message
        if isinstance(message, Note | Claim | Verdict | Report):
            self.words.setdefault(message.round, {})[overheard.kind, message.module] = message
        elif overheard.kind == "refused":
            self.refused = self.refused or f"{message.sender}: {message.detail}"


def _played(
    record: RecordedDecisions,
    live: tuple[int, ...],
    running: Run,
    other: tuple[str, str] | None,
    kept: str | None,
) -> LiveReplay:
    """Play round by round until something differs, or all are over.

    In the second round that is known, if notes in the recording and those of the rule are `other`
    ones.
    """
    rounds = record.rounds if other is None else 1
    ear = _Subscriber()
    running.listen(ear.hear)
    comparing = _Comparing(record)
    same, found = 0, None
    with running as run:
        while found is None and same < rounds and run.goes_on:
            run.step()
            if run.gathered.rounds == same:
                break  # the round was not completed
            found = comparing.first(same + 1, ear.words.pop(same + 1, {}), whole=True)
            if found is None:
                same += 1
                comparing.sites.append(tuple(run.gathered.sites))
        outcome = run.stop()
    if found is None and same < rounds:
        heard = ear.words.get(same + 1, {})
        why = ear.refused or outcome.error or f"the run ended: {outcome.ended}"
        found = comparing.first(same + 1, heard, whole=False) or comparing.end(same + 1, why)
    if found is None and other is not None:
        found = comparing.divergence(2, live[0], "note", *other)
    return LiveReplay(str(record.recording.path), live, same, record.rounds, found, kept)


class _Comparing:
    """Compares what modules say, live, with what is recorded."""

    def __init__(self, record: RecordedDecisions) -> None:
        self._record = record
        self._system = record.recording.scene.system
        self.sites: list[tuple[Site, ...]] = [tuple(record.recording.scene.start)]
        """Where modules stand before each round that was begun."""

    def first(self, number: int, heard: Words, *, whole: bool) -> Divergence | None:
        """Return the first difference in a round; if it is not whole, in what was heard of it."""
        recorded = self._record.words[number - 1]
        for kind in _ORDER:
            keys = heard.keys() if not whole else heard.keys() | recorded.keys()
            for module in sorted(module for each, module in keys if each == kind):
                was, now = recorded.get((kind, module)), heard.get((kind, module))
                if _content(was) != _content(now):
                    texts = (_text(each, kind) for each in (was, now))
                    return self.divergence(number, module, kind, *texts)
        return None

    def end(self, number: int, why: str) -> Divergence:
        """Return why a round in the recording was not completed."""
        named = _MODULE.search(why)
        module = None if named is None else int(named[1])
        if module is None or module >= len(self.sites[0]):
            return Divergence(number, None, "failed", "is a whole round", why, None, ())
        claim = self._record.words[number - 1].get(("claim", module))
        return self.divergence(number, module, "failed", _text(claim, "claim"), why)

    def divergence(self, number: int, module: int, kind: str, was: str, now: str) -> Divergence:
        """Return a difference, with what the module had sensed when it chose."""
        # A note of one round is sent in the next.
        chosen = max(number - (kind == "note"), 1)
        where = self.sites[chosen - 1]
        system = self._system
        place = system.place_of(where[module])
        there = {system.place_of(site): other for other, site in enumerate(where)}
        sensed = [
            f"sensed module_{there[near]} at {site_text(where[there[near]])}"
            for near in in_order(set(system.sensed(place)) & there.keys())
        ]
        reach = {there[near] for near in set(system.reach(place)) & there.keys()}
        words = self._record.words[chosen - 1]
        heard = ("note",) if kind in ("note", "claim", "failed") else ("claim", "verdict")
        sensed += [
            f"heard that module_{other} {_text(words[each, other], each)}"
            for each in heard
            for other in sorted(reach)
            if (each, other) in words
        ]
        return Divergence(number, module, kind, was, now, site_text(where[module]), tuple(sensed))


def _content(message: Part | Report | None) -> object:
    """Return what counts of a module's message, whatever the format of the recording."""
    match message:
        case Note():
            return tuple(message.note)
        case Claim():
            return message.generator, message.at
        case Verdict():
            return message.granted, frozenset(message.to)
        case Report():
            move = None if message.move is None else (message.move.generator, message.move.at)
            at = None if move is None else move[1]
            sites = message.before, message.site
            return message.claim, move and move[0], at, sites, message.failed
        case _:
            return None


def _text(message: Part | Report | None, kind: str) -> str:
    """Return a module's message as the end of a sentence about it."""
    match message:
        case Note():
            return f"notes {message.note}"
        case Claim():
            return f"claims {move_text(GeneratorPlacement(message.generator, message.at))}"
        case Verdict():
            how = "granted" if message.granted else "lost"
            to = ", ".join(map(site_text, in_order(message.to)))
            return f"says that its claim is {how}, to {to}"
        case Report():
            gave_up = "" if message.failed is None else f", gives up: {message.failed}"
            return (
                f"reports {message.claim}, {move_text(message.move)}, and stands at"
                f" {site_text(message.site)}{gave_up}"
            )
        case _:
            return {"note": "notes nothing", "claim": "claims nothing"}.get(kind, f"no {kind}")
