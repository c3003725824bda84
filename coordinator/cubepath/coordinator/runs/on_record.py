"""What the modules of a recording sent and chose, round by round, so that a run can repeat it.

The run that repeats it derives everything again, so nothing in the recording is trusted. This
module checks only that reports and claims fit together.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from cubepath.agents.processes.config import OUTSIDE
from cubepath.agents.rules.schedule import RECORDED, SCHEDULE, RecordedChoice
from cubepath.coordinator.runs.edge_path import Gathered
from cubepath.coordinator.runs.gathering import gathered_in_full
from cubepath.coordinator.verification.parameters import (
    RuleStage,
    hesitation_in,
    max_rounds_in,
    seed_in,
    spans,
    stages_in,
)
from cubepath.coordinator.verification.partial import hole_in
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.credentials import process_name

Words: TypeAlias = dict[tuple[str, int], wire.Part | wire.Report]
"""What modules sent and reported in a round, by kind and module."""
_KINDS = ("note", "claim", "verdict", "report")


@dataclass(frozen=True, slots=True)
class RecordedDecisions:
    """The whole rounds of a recording, from the first on."""

    recording: Recording
    gathered: Gathered
    words: Sequence[Words]
    """Of each whole round its notes, claims, verdicts and reports."""
    choices: dict[int, list[RecordedChoice]]
    """By module what it chose in each of them."""
    note_length: int
    stages: tuple[RuleStage, ...]
    """Which rules the modules follow from which rounds on."""
    max_rounds: int | None

    @property
    def rounds(self) -> int:
        """Return the number of whole rounds."""
        return len(self.words)

    def stage(self, round_number: int) -> RuleStage:
        """Return the stage to which a round belongs."""
        return [each for each in self.stages if each.begins <= max(round_number, 1)][-1]


def on_record(recording: Recording) -> RecordedDecisions:
    """Read what modules sent and chose in the whole rounds of a recording.

    InputError in one line if they did not choose by rules in rounds, or if what is recorded does
    not fit together; CheckError as for `gathered`.
    """
    _check_kind(recording)
    found = gathered_in_full(recording)
    words: list[Words] = [{} for _ in range(found.rounds + 1)]
    own: set[str] = set()
    own_modules: set[int] = set()
    for logged in recording.messages((*_KINDS, "ready", "actions")):
        match logged.message:
            case wire.Note() | wire.Claim() | wire.Verdict() | wire.Report() as part:
                if 1 <= part.round <= len(words):
                    words[part.round - 1][wire.kind_of(part), part.module] = part
                if isinstance(part, wire.Report) and logged.topic.rpartition("/")[2] in own:
                    own_modules.add(part.module)
            case wire.Ready(phase="join", process=process, rule=str()):
                own.add(process_name(process))
            case wire.ChosenActions():
                raise InputError(
                    f"{recording.path}: its modules were driven from outside, expected a rule"
                )
            case _:
                pass
    whole = _whole(words[: found.rounds])
    choices = {
        module: [
            _choice(recording, words[place], words[place + 1], module) for place in range(whole)
        ]
        for module in range(len(recording.scene.start))
    }
    return RecordedDecisions(
        recording,
        found,
        words[:whole],
        choices,
        _note_length(words),
        _stages(recording, own_modules),
        max_rounds_in(recording.parameters),
    )


def tell_damages(record: RecordedDecisions, say: Callable[[str], object] | None) -> None:
    """Say in lines what of a recording is damaged, or was, and up to where it is used."""
    recording = record.recording
    hole = hole_in(recording)
    if say is None:
        return
    for each in recording.problems or (() if hole is None else (str(hole),)):
        say(f"{recording.path}: {each}; it is used up to round {record.rounds}")


def _check_kind(recording: Recording) -> None:
    """Refuse recordings of modules that chose in another way than by a rule, in rounds."""
    path, parameters = recording.path, recording.parameters
    if recording.clock == "free" and recording.scene:  # messages on any keys have none: refused
        raise InputError(
            f"{path}: a run without rounds, whose modules act when they are ready:"
            " expected a recording of a run with rounds"
        )
    if (
        recording.schedule is not None
        or "schedule" in parameters
        or parameters.get("rule") == SCHEDULE
    ):
        raise InputError(
            f"{path}: its modules carry out a schedule, each its own part, and follow no rule:"
            " expected a recording of a run by a rule ('cubepath run --schedule' carries it out)"
        )
    if parameters.get("rule") == OUTSIDE:
        raise InputError(f"{path}: its modules were driven from outside, expected a rule")


def _whole(words: Sequence[Words]) -> int:
    """Return up to which round nothing is missing that is known to have been sent."""
    for place, messages in enumerate(words):
        for report in (each for each in messages.values() if isinstance(each, wire.Report)):
            heard = {(kind, sender) for kind, sender in report.deliveries() if kind in _KINDS}
            lost = report.claim == "lost" and ("claim", report.module) not in messages
            if lost or not heard <= messages.keys():
                return place
    return len(words)


def _choice(recording: Recording, messages: Words, after: Words, module: int) -> RecordedChoice:
    """Return what a module chose in a round; of the next one only its note counts."""
    report, claim = messages["report", module], messages.get(("claim", module))
    note = after.get(("note", module))
    assert isinstance(report, wire.Report)  # noqa: S101 - rounds are whole
    move = report.move
    if isinstance(claim, wire.Claim):
        placed = GeneratorPlacement(claim.generator, claim.at)
        if report.claim == "none" or (report.claim == "granted" and move != placed):
            raise InputError(
                f"{recording.path}: round {report.round}, module_{module}: it claims"
                f" {move_text(placed)}, and reports {report.claim}, {move_text(move)}"
            )
        move = placed
    return RecordedChoice(move, note.note if isinstance(note, wire.Note) else None, report.failed)


def _note_length(words: Iterable[Words]) -> int:
    for messages in words:
        for part in messages.values():
            if isinstance(part, wire.Note):
                return len(part.note)
    return 0


def _stages(recording: Recording, own: set[int]) -> tuple[RuleStage, ...]:
    """Return which rules modules follow, except those whose process named its own rule."""
    parameters, path = recording.parameters, recording.path
    rule, seed, hesitate = parameters.get("rule"), seed_in(parameters), hesitation_in(parameters)
    stages = stages_in(recording)
    for key, value in (("rule", rule), ("seed", seed), ("hesitate", hesitate)):
        if value is None or (key == "rule" and value == RECORDED and not stages):
            raise InputError(f"{path}: names no {key}, expected who chose how")
    if stages:
        return stages
    modules = [n for n in range(len(recording.scene.start)) if n not in own]
    return (RuleStage(1, {str(rule): spans(modules)}, int(seed or 0), float(hesitate or 0.0)),)


def move_text(move: GeneratorPlacement | None) -> str:
    """Return a move as text for people."""
    if move is None:
        return "no move"
    return f"{move.generator} at {site_text(move.at)}"
