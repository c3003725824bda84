"""What if other rules took over: a run that continues from any round of a recording.

Until that round each module repeats its recorded choices, so the run passes through the same
states. From then on it follows a rule, from where it stands and with no memory. It is a run like
any other, in processes, and its recording names the one it started from.
"""

from collections.abc import Collection, Iterable
from pathlib import Path

from cubepath.agents.processes.pacer import PATIENCE_S
from cubepath.agents.rules.registry import permitted_rule, rule_named
from cubepath.agents.rules.schedule import RecordedChoices
from cubepath.coordinator.runs.driver import Say
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.listeners import Watch
from cubepath.coordinator.runs.on_record import RecordedDecisions, on_record, tell_damages
from cubepath.coordinator.runs.outcome import Outcome
from cubepath.coordinator.runs.plan import MAX_ROUNDS, Branch, Plan
from cubepath.coordinator.runs.run import Run
from cubepath.coordinator.verification.parameters import RuleStage, spans, stages_text
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.options import whole_number
from cubepath.protocol.recordings.recording import Recording, recording_of


def what_if(
    recording: Recording | Source,
    rule: str,
    *,
    from_round: int,
    modules: Iterable[int] | None = None,
    seed: int | None = None,
    max_rounds: int | None = None,
    processes: int = 4,
    log: str | Path | None = None,
    patience: float = PATIENCE_S,
    rules: Collection[str] = (),
    watch: Watch | None = None,
    say: Say | None = None,
) -> Outcome:
    """Run a recording on from a round, with modules that follow another rule from there.

    >>> found = what_if(
    ...     "logs/golden/agv-6.mcap", "random", from_round=5, max_rounds=9,
    ...     processes=0, log="logs/what-if.mcap",
    ... )
    >>> found.rounds, found.recording().parameters["parent"]
    (9, 'agv-6.mcap')

    Args: recording: the parent, of a run with rounds by a rule; it may have been cut off, and may
        be the outcome of another what-if. rule: a name or ``FILE.py:NAME``. from_round: the first
        round in which modules follow the rule, from 1 (nothing is taken from the parent but its
        start) to one more than it has whole rounds. modules: who follows it; by default all. The
        others follow the rule that is recorded for them, which begins anew there as well. seed: of
        ranks and of what rules draw from there on; by default the one in the recording. max_rounds:
        how many rounds the run has at most, those in the recording among them; by default as many
        as the parent, or 1000 after them if it takes over where that had to end. processes: as for
        `run`, like all that follows. log: the recording to write; by default a new file in the
        folder ``logs``. patience: seconds. rules: the rules in files that the others may follow,
        each ``FILE.py:NAME``: a recording can name any file, so none runs that is not given here or
        as `rule`. watch: called after each round. say: told in a line what continues.

    The rules begin with empty memory: what they draw are the first draws of the module's stream
    from the seed. In their first round they hear what was noted in the one before, if that is
    recorded, and if their notes are as long.

    The outcome is that of the whole run from the start. InputError if the recording or the rule
    does not allow that; CheckError if recorded reports do not follow from the claims.
    """
    record = on_record(recording_of(recording))
    most = record.rounds + (record.gathered.failed is None or not record.rounds)
    first = whole_number("from", from_round)
    path = record.recording.path
    if not 1 <= first <= most:
        why = "" if most > record.rounds else f", in round {most} a module gave up"
        raise InputError(
            f"round {first}: {path} has {record.rounds} whole rounds{why}, expected 1 to {most}"
        )
    _check_silence(record, first)
    stage = _stage(record, rule, first, modules, seed, files=(rule, *rules))
    plan = Plan(
        system=record.recording.scene,
        rule=rule,
        seed=record.stages[0].seed if first > 1 else stage.seed,
        hesitate=stage.hesitate,
        processes=processes,
        max_rounds=_most(record, first, max_rounds),
        log=None if log is None else Path(log),
        patience=patience,
    )
    branch = _branch(record, rule, stage)
    tell_damages(record, say)

    def compared(gatherer: Gathered) -> None:
        _compare(record, gatherer, first - 1)
        if watch is not None:
            watch(gatherer)

    return Run(plan, watch=compared, say=say, branch=branch).play_from_the_start()


def _check_silence(record: RecordedDecisions, first: int) -> None:
    """Refuse what cannot be repeated: a round in which modules fell silent between two rules."""
    for stage in record.stages[1:]:
        if record.note_length and not stage.heard and stage.begins < first:
            raise InputError(
                f"round {first}: in round {stage.begins} of {record.recording.path} other rules"
                f" took over, and nothing was noted; expected 1 to {stage.begins}"
            )


def _stage(
    record: RecordedDecisions,
    rule: str,
    first: int,
    modules: Iterable[int] | None,
    seed: int | None,
    *,
    files: Collection[str],
) -> RuleStage:
    """Return who follows which rule from the round on."""
    scene, path = record.recording.scene, record.recording.path
    everyone = range(len(scene.start))
    named = list(everyone) if modules is None else sorted(set(modules))
    strange = [module for module in named if module not in everyone]
    if strange or not named:
        problem = f"modules={strange[0]}: no such module" if strange else "modules: none named"
        raise InputError(f"{problem}, {path} has 0-{len(scene.start) - 1}")
    rules: dict[str, list[int]] = {rule: named}
    now = record.stage(first)
    for name in now.rules:
        others = [module for module in now.modules(name) if module not in set(named)]
        if others:
            rules.setdefault(permitted_rule(name, files), []).extend(others)
    unknown = set(everyone) - {module for those in rules.values() for module in those}
    if unknown:
        raise InputError(
            f"{path}: module_{min(unknown)} followed a rule of its process's own, expected it to be"
            " among those that follow the rule"
        )
    lengths = {
        name: rule_named(name, scene.system).length(len(scene.start)) for name in sorted(rules)
    }
    if len(set(lengths.values())) > 1:
        found = ", ".join(f"{name} {length}" for name, length in lengths.items())
        raise InputError(
            f"rule={rule}: rules that are followed side by side note as many numbers, found {found}"
        )
    return RuleStage(
        begins=first,
        rules={name: spans(those) for name, those in rules.items()},
        seed=now.seed if seed is None else whole_number("seed", seed, 0),
        hesitate=now.hesitate,
        heard=(
            1 < first <= record.rounds
            and lengths[rule] == record.note_length
            and (now.begins < first or now.heard)
        ),
    )


def _most(record: RecordedDecisions, first: int, asked: int | None) -> int:
    """Return how many rounds the run has at most."""
    if asked is not None:
        if whole_number("max-rounds", asked) < first:
            raise InputError(f"max-rounds={asked}: expected {first} or more, where the rule begins")
        return asked
    before = record.max_rounds
    return before if before is not None and before >= first else first - 1 + MAX_ROUNDS


def _branch(record: RecordedDecisions, rule: str, stage: RuleStage) -> Branch:
    first = stage.begins
    before = tuple(each for each in record.stages if each.begins < first)
    recorded = RecordedChoices(
        choices={module: chosen[: first - 1] for module, chosen in record.choices.items()},
        note_length=record.note_length,
        seeds=[(each.begins, each.seed) for each in (*before[1:], stage)],
        rules={
            module: name for name in stage.rules if name != rule for module in stage.modules(name)
        },
        heard=stage.heard,
    )
    parameters = {
        **parent_parameters(record),
        "from_round": str(first),
        "what_if": rule,
        "stages": stages_text((*before, stage)),
    }
    return Branch(recorded, first - 1, parameters)


def parent_parameters(record: RecordedDecisions) -> dict[str, str]:
    """Return by what the recording of a run names the one that it comes from."""
    checksum = record.recording.sha256()
    return {
        "parent": record.recording.path.name,
        "parent_path_digest": record.gathered.digest,
        **({} if checksum is None else {"parent_sha256": checksum}),
    }


def _compare(record: RecordedDecisions, gatherer: Gathered, last: int) -> None:
    """Check that a round which was repeated has the moves that are recorded."""
    number = gatherer.rounds
    if number <= last:
        made, recorded = (each.steps[number - 1].executed for each in (gatherer, record.gathered))
        if made != recorded:
            raise CheckError(
                f"{record.recording.path}: round {number}: its claims lead to other moves than"
                " are reported"
            )
