"""Whether the parameters of a recording are those of a run, and fit its scene.

Part of `cubepath verify`. A missing parameter is no failure: recordings written by other programs
have fewer. An unknown one is.

A run whose modules repeat another recording at first has stages: which modules follow which rule up
to a round, and which from there on, each stage with the seed of ranks and of random choices. So the
rules can be asked again.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from math import inf

import msgspec

from cubepath.coordinator.verification.round_spans import Span, add_to_spans
from cubepath.coordinator.verification.transcript import RECOVERED, Fail, Transcript
from cubepath.protocol.recordings.cutting import FILTERED, SPLIT
from cubepath.protocol.recordings.description import ATTACHED, LEFT_OUT, PART
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.keys import Tiles

CHECK = "parameters"
RECORDED = "recorded"
"""The rule of modules that choose as in the recording, by its name in parameters."""
_SPANS = re.compile(r"\d{1,6}(-\d{1,6})?(,\d{1,6}(-\d{1,6})?)*", re.ASCII)
_MODULES_MAX = 1 << 20
_WHOLE = "whole_messages"
_OF_LOCKSTEP = frozenset(
    (
        *("repair", "from_round", "what_if", "stages", "live"),
        *("parent", "parent_path_digest", "parent_sha256", "faults", "simulated"),
    )
)
_OF_FREE = frozenset(("keepers", "on_crash", "speeds", "jitter"))
_BESIDE = {
    **dict.fromkeys(("from_round", "what_if", "live"), "stages"),
    **dict.fromkeys(("parent", "parent_path_digest", "parent_sha256"), "stages"),
    "repair": "schedule",
    PART: ATTACHED,
    FILTERED: _WHOLE,
    SPLIT: _WHOLE,
}
"""Parameters that stand beside others alone."""
KNOWN = frozenset(
    (
        *("system", "family", "rule", "seed", "hesitate", "processes", "modules", "max_rounds"),
        *("schedule", "clock", "log_time", "python", "platform", "cubepath", "eclipse-zenoh"),
        *("mcap", "pettingzoo", "numpy", RECOVERED, ATTACHED, PART, *LEFT_OUT, FILTERED, SPLIT),
        *(_WHOLE, "wait_for", *_OF_LOCKSTEP, *_OF_FREE),
    )
)
"""The names of all parameters that recordings have."""
_NUMBERS = (
    *("seed", "max_rounds", "processes", "modules", "keepers", "wait_for", "from_round"),
    *(ATTACHED, PART, _WHOLE),
)


def check_parameters(recording: Recording, fail: Fail) -> None:
    """Check each parameter that is there: its form, and what the scene says of it."""
    parameters, scene = recording.parameters, recording.scene
    modules = len(scene.start)

    def wrong(key: str, expected: str) -> None:
        fail(CHECK, f"{key}={parameters.get(key)!r}: expected {expected}")

    _check_names(recording, wrong)
    if "hesitate" in parameters and hesitation_in(parameters) is None:
        wrong("hesitate", "at least 0 and less than 1")
    if _number(parameters.get("modules", "")) not in (None, modules):
        wrong("modules", f"{modules}, which start in the scene")
    if (_number(parameters.get("processes", "")) or 0) > modules:
        wrong("processes", f"at most {modules}, one for each module")
    for key, value in (("system", scene.spec), ("family", scene.family)):
        if parameters.get(key, value) != value:
            wrong(key, f"{value!r}, as in the scene")
    _check_clock(recording, wrong)
    _check_schedule(recording, wrong)


def _check_names(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    parameters = recording.parameters
    others = _OF_LOCKSTEP if recording.clock == "free" else _OF_FREE
    for key in sorted(parameters.keys() - KNOWN):
        wrong(key, "no parameter of this name, which no run has")
    for key in sorted(parameters.keys() & others):
        wrong(key, f"none of this name in a run with clock={recording.clock}")
    for key, other in _BESIDE.items():
        if key in parameters and other not in parameters:
            wrong(key, f"none without {other}")
    if "wait_for" in parameters and "processes" in parameters:
        wrong("wait_for", "none beside processes")
    for key in _NUMBERS:
        if key in parameters and _number(parameters[key]) is None:
            wrong(key, "a whole number of at least 0")


def _check_clock(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    parameters = recording.parameters
    if parameters.get("clock", "lockstep") != recording.clock:
        wrong("clock", f"{recording.clock!r}, as {recording.format} has it")
    if recording.clock == "free":
        _check_free(recording, wrong)
    logical = "level" if recording.clock == "free" else "round"
    if parameters.get("log_time", logical) not in (logical, "wall"):
        wrong("log_time", f"'{logical}' or 'wall'")


def _check_free(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    parameters = recording.parameters
    if keepers_of(recording) is None:
        wrong("keepers", f"how many there were, 1 to {Tiles.keepers_max}")
    if parameters.get("on_crash", "stop") not in ("stop", "continue", "restart"):
        wrong("on_crash", "stop, continue or restart")
    if "jitter" in parameters and _factor(parameters["jitter"]) is None:
        wrong("jitter", "a number of at least 0")
    pairs = [each.partition("=") for each in parameters.get("speeds", "").split(",") if each]
    if any(
        (_number(module) is None or int(module) >= len(recording.scene.start))
        or not _factor(factor)
        for module, _, factor in pairs
    ):
        wrong("speeds", "MODULE=FACTOR, separated by commas")


def _check_schedule(recording: Recording, wrong: Callable[[str, str], None]) -> None:
    parameters = recording.parameters
    if recording.schedule is not None and parameters.get("rule", "schedule") != "schedule":
        wrong("rule", "'schedule', since there is one on record")
    if recording.schedule is None and parameters.get("rule") == "schedule":
        wrong("rule", "a schedule on record, which modules carried out")
    if "schedule" in parameters and hesitation_in(parameters):
        wrong("hesitate", "0, since a schedule has a round for every cube")


def _number(text: str) -> int | None:
    """Return a whole number of at least 0 as it is written, None if it is none."""
    if not (text.isascii() and text.isdigit()) or (text[0] == "0" and text != "0"):
        return None
    try:
        return int(text)
    except ValueError:  # Python reads no number of thousands of digits
        return None


def seed_in(parameters: Mapping[str, str]) -> int | None:
    """Return the seed of a run; None if it is missing or malformed."""
    return _number(parameters.get("seed", ""))


def max_rounds_in(parameters: Mapping[str, str]) -> int | None:
    """Return after how many rounds a run ends; None if it is missing or malformed."""
    return _number(parameters.get("max_rounds", ""))


def processes_of(recording: Recording) -> int | None:
    """Return the number of processes, 1 for modules in a thread; None if it is not known."""
    found = _number(recording.parameters.get("processes", ""))
    return None if found is None or found > len(recording.scene.start) else max(found, 1)


def keepers_of(recording: Recording) -> int | None:
    """Return the number of keepers; None if it is missing, malformed or more than a run has."""
    found = _number(recording.parameters.get("keepers", "")) or None
    return None if found is not None and found > Tiles.keepers_max else found


def _factor(text: str) -> float | None:
    """Return a number of at least 0, None if it is none."""
    try:
        found = float(text)
    except ValueError:
        return None
    return found if 0.0 <= found < inf else None


def hesitation_in(parameters: Mapping[str, str]) -> float | None:
    """Return the probability that a module makes no claim; None if it is missing or malformed."""
    try:
        found = float(parameters["hesitate"])
    except (KeyError, ValueError):
        return None
    return found if 0.0 <= found < 1.0 else None


class RuleStage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What modules follow from a round on: each begins there with no memory."""

    begins: int
    """The first round."""
    rules: dict[str, str]
    """By the name of a rule who follows it, as ``0-3,7``; of other modules nothing is known."""
    seed: int
    hesitate: float
    heard: bool = False
    """Whether they hear in that round what was noted in the one before."""

    def modules(self, rule: str) -> list[int]:
        """Return the modules that follow a rule, none for a malformed text or far too many."""
        text = self.rules.get(rule, "")
        if not _SPANS.fullmatch(text):
            return []
        ends = (span.partition("-") for span in text.split(","))
        found = [range(int(one), int(last or one) + 1) for one, _, last in ends]
        return [*chain.from_iterable(found)] if sum(map(len, found)) <= _MODULES_MAX else []


def spans(modules: Iterable[int]) -> str:
    """Return the numbers of modules as text, as in ``0-3,7``.

    >>> spans([0, 1, 2, 3, 7])
    '0-3,7'
    """
    found: list[Span] = []
    for module in sorted(modules):
        add_to_spans(found, module)
    return ",".join(f"{one}-{last}" if one < last else str(one) for one, last in found)


def stages_text(stages: tuple[RuleStage, ...]) -> str:
    """Return stages as the parameter `stages` has them."""
    return msgspec.json.encode(stages).decode()


def stages_in(recording: Recording) -> tuple[RuleStage, ...]:
    """Return the stages of a run; none if there are none on record, or something is wrong."""
    stages = _stages_named(recording.parameters)
    return stages if stages and _odd(stages, recording) is None else ()


def _stages_named(parameters: Mapping[str, str]) -> tuple[RuleStage, ...]:
    return stages_of(parameters.get("stages", "[]"))


def stages_of(text: str) -> tuple[RuleStage, ...]:
    """Return the stages that the parameter `stages` tells; none if it is malformed."""
    try:
        return msgspec.json.decode(text, type=tuple[RuleStage, ...])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ()


def check_stages(recording: Recording, transcript: Transcript, fail: Fail) -> None:
    """Check that there are stages where there must be, that they are some, and when they began."""
    parameters = recording.parameters
    stages = _stages_named(parameters)
    if not stages:
        if "stages" in parameters or "what_if" in parameters or parameters.get("rule") == RECORDED:
            fail(
                "stages",
                f"stages={parameters.get('stages')!r}: expected which rules modules follow",
            )
        return
    why = _odd(stages, recording)
    if why is not None:
        fail("stages", why)
        return
    begins = stages[-1].begins
    if "what_if" not in parameters:
        if len(stages) > 1:
            fail("stages", f"a rule took over in round {begins}, and what_if does not name it")
        return
    if parameters["what_if"] not in stages[-1].rules:
        fail(
            "stages",
            f"what_if={parameters['what_if']!r}: expected a rule that begins in round {begins}",
        )
    if parameters.get("from_round") != str(begins):
        fail(
            "stages",
            f"from_round={parameters.get('from_round')!r}: expected {begins}, as in the stages",
        )
    over, last = transcript.schedule_over, transcript.complete_rounds
    if over not in (None, begins - 1) or (over is None and last >= begins):
        when = "no rule took over" if over is None else f"a rule took over after round {over}"
        fail("stages", f"{when}, expected after round {begins - 1}")


def _odd(stages: tuple[RuleStage, ...], recording: Recording) -> str | None:
    """Return in one line what is wrong with stages by themselves; None if nothing is."""
    parameters, modules = recording.parameters, range(len(recording.scene.start))
    if recording.schedule is not None or parameters.get("rule") != RECORDED:
        return f"there are stages, and rule={parameters.get('rule')!r}: expected {RECORDED!r}"
    begun = [stage.begins for stage in stages]
    if begun[0] != 1 or sorted(set(begun)) != begun:
        return f"stages begin in rounds {begun}, expected 1 and then later ones"
    for stage in stages:
        listed = {rule: stage.modules(rule) for rule in stage.rules}
        named = [module for each in listed.values() for module in each]
        if (
            len(set(named)) != len(named)
            or not set(named) <= set(modules)
            or any(spans(each) != stage.rules[rule] for rule, each in listed.items())
        ):
            return f"from round {stage.begins} on: expected modules as 0-3,7, each once at most"
        if stage.seed < 0 or not 0.0 <= stage.hesitate < 1.0:
            return f"from round {stage.begins} on: seed {stage.seed}, hesitate {stage.hesitate}"
    first = stages[0]
    if (first.seed, first.hesitate) != (seed_in(parameters), hesitation_in(parameters)):
        return f"seed {first.seed}, hesitate {first.hesitate} in the first stage, not as of the run"
    return None
