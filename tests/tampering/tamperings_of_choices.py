"""Recordings in which modules did other than their rule says, and all else agrees with it.

Most are real runs of modules that follow a rule that lies: what they do fits together, so only
asking the true rule again shows it.
"""

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace as with_fields
from functools import cache
from typing import Any

from msgspec.structs import replace

from cubepath.agents.local.observation import View
from cubepath.agents.rules.registry import BUILT_IN
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, as_choice
from cubepath.coordinator.runs.plan import Plan
from cubepath.coordinator.runs.run import run
from cubepath.protocol.recordings.recording import Recording, read_recording
from samples.recordings import edited, first, new_path, parts, recorded
from tampering.tamperings import crowd, tampers

Lie = Callable[[View, Choice], Choice]
LIAR, LIE_IN = 2, 4
"""The module that lies, and the round."""


@contextmanager
def lying(name: str, lie: Lie) -> Generator[None]:
    """Install a rule under the name of another, which one module breaks in one round."""
    honest = BUILT_IN[name]

    def make(knowledge: InitialKnowledge) -> Rule:
        true, rounds = honest.make(knowledge), 0

        def choose(view: View) -> Choice:
            nonlocal rounds
            rounds += 1
            choice = as_choice(true(view))
            return lie(view, choice) if (knowledge.module, rounds) == (LIAR, LIE_IN) else choice

        return choose

    BUILT_IN[name] = with_fields(honest, make=make)
    try:
        yield
    finally:
        BUILT_IN[name] = honest


def lied(spec: str, rule: str, lie: Lie, *, seed: int = 0, rounds: int = 8) -> Recording:
    """Return the recording of a real run in which a module breaks its rule."""
    path = new_path()
    with lying(rule, lie):
        run(Plan(spec, rule, seed=seed, processes=0, max_rounds=rounds, log=path))
    return read_recording(path)


def another_action(view: View, choice: Choice) -> Choice:
    """Choose the first legal action that is another."""
    for action, _ in view.legal():
        if action != choice.action:
            return with_fields(choice, action=action)
    raise AssertionError("there is no other action")


@tampers("choices")
@cache
def a_claim_that_the_rule_did_not_make() -> Recording:
    return lied("agv:graph=grid4x4,n=7", "tswap", another_action)


@tampers("choices")
@cache
def a_claim_that_was_kept_back() -> Recording:
    for seed in range(20):
        honest = recorded("hex-open:n=5", "random", seed=seed)
        if any((each.round, each.module) == (LIE_IN, LIAR) for each in parts(honest, "claim")):
            return lied("hex-open:n=5", "random", lambda *_: Choice(), seed=seed)
    raise AssertionError("it would stay anyway")


@tampers("choices")
@cache
def a_note_of_another_mind() -> Recording:
    def other(_: View, choice: Choice) -> Choice:
        assert choice.note
        return with_fields(choice, note=tuple(7 for _ in choice.note))

    return lied("agv:graph=grid4x4,n=7", "tswap", other)


@tampers("choices")
@cache
def a_module_that_gave_up_for_nothing() -> Recording:
    return lied(
        "agv:graph=grid4x4,n=7",
        "tswap",
        lambda _, choice: with_fields(choice, failed="I was tired"),
    )


@tampers("choices")
def a_note_that_was_forged() -> Recording:
    note = first(crowd(), "note")
    return edited(crowd(), note, replace(note, note=[number + 1 for number in note.note]))


@tampers("choices")
def a_note_that_nobody_remembers() -> Recording:
    """Return a run without the note of a module in a round, which nobody says to have heard."""
    whole = crowd()
    note = first(whole, "note", lambda each: each.round == 4)

    def forget(report: Any) -> Any:
        heard = {
            kind: [n for n in who if (kind, n) != ("note", note.module)]
            for kind, who in report.received.items()
        }
        return replace(report, received={kind: who for kind, who in heard.items() if who})

    found = edited(whole, note)
    for report in parts(whole, "report"):
        if report.round == note.round and forget(report) != report:
            found = edited(found, report, forget(report))
    return found


@tampers("choices")
def hesitation_of_another_run() -> Recording:
    whole = recorded("agv:graph=grid4x4,n=7", "tswap", hesitate=0.3)
    return with_fields(whole, parameters={**whole.parameters, "hesitate": "0.0"})


@tampers("choices")
def a_rule_of_another_run() -> Recording:
    whole = recorded("arm:n=6", "word", rounds=20)
    return with_fields(whole, parameters={**whole.parameters, "rule": "random"})


@tampers("choices")
def a_rule_for_another_system() -> Recording:
    return with_fields(crowd(), parameters={**crowd().parameters, "rule": "chain"})
