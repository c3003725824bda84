"""The stages of a run that goes on from a recording: who followed which rule from which round on.

Part of `cubepath verify`. A run whose modules chose at first as they did in another recording says
in its parameters which rules they follow up to there, and which from there on, each with the seed
of ranks and of what it draws. So the rules can be asked again.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from itertools import chain

import msgspec

from cubepath.coordinator.verification.parameters import hesitation_in, seed_in
from cubepath.coordinator.verification.transcript import Fail, Transcript
from cubepath.protocol.recordings.recording import Recording

CHECK = "stages"
RECORDED = "recorded"
"""The rule of modules that choose as on record, by its name in parameters."""
_SPANS = re.compile(r"\d{1,6}(-\d{1,6})?(,\d{1,6}(-\d{1,6})?)*", re.ASCII)
_MODULES_MAX = 1 << 20


class Stage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
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
    found: list[list[int]] = []
    for module in sorted(modules):
        if found and found[-1][1] == module - 1:
            found[-1][1] = module
        else:
            found.append([module, module])
    return ",".join(f"{one}-{last}" if one < last else str(one) for one, last in found)


def stages_text(stages: tuple[Stage, ...]) -> str:
    """Return stages as the parameter `stages` has them."""
    return msgspec.json.encode(stages).decode()


def stages_in(recording: Recording) -> tuple[Stage, ...]:
    """Return the stages of a run; none if there are none on record, or something is wrong."""
    stages = _told(recording.parameters)
    return stages if stages and _odd(stages, recording) is None else ()


def _told(parameters: Mapping[str, str]) -> tuple[Stage, ...]:
    return stages_of(parameters.get("stages", "[]"))


def stages_of(text: str) -> tuple[Stage, ...]:
    """Return the stages that the parameter `stages` tells; none if it is malformed."""
    try:
        return msgspec.json.decode(text, type=tuple[Stage, ...])
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        return ()


def check_stages(recording: Recording, transcript: Transcript, fail: Fail) -> None:
    """Check that there are stages where there must be, that they are some, and when they began."""
    told = recording.parameters
    stages = _told(told)
    if not stages:
        if "stages" in told or "what_if" in told or told.get("rule") == RECORDED:
            fail(CHECK, f"stages={told.get('stages')!r}: expected which rules modules follow")
        return
    why = _odd(stages, recording)
    if why is not None:
        fail(CHECK, why)
        return
    begins = stages[-1].begins
    if "what_if" not in told:
        if len(stages) > 1:
            fail(CHECK, f"a rule took over in round {begins}, and what_if does not name it")
        return
    if told["what_if"] not in stages[-1].rules:
        fail(CHECK, f"what_if={told['what_if']!r}: expected a rule that begins in round {begins}")
    if told.get("from_round") != str(begins):
        fail(CHECK, f"from_round={told.get('from_round')!r}: expected {begins}, as in the stages")
    over, last = transcript.schedule_over, transcript.complete_rounds
    if over not in (None, begins - 1) or (over is None and last >= begins):
        when = "no rule took over" if over is None else f"a rule took over after round {over}"
        fail(CHECK, f"{when}, expected after round {begins - 1}")


def _odd(stages: tuple[Stage, ...], recording: Recording) -> str | None:
    """Return in one line what is wrong with stages by themselves; None if nothing is."""
    told, modules = recording.parameters, range(len(recording.scene.start))
    if recording.schedule is not None or told.get("rule") != RECORDED:
        return f"there are stages, and rule={told.get('rule')!r}: expected {RECORDED!r}"
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
    if (first.seed, first.hesitate) != (seed_in(told), hesitation_in(told)):
        return f"seed {first.seed}, hesitate {first.hesitate} in the first stage, not as of the run"
    return None
