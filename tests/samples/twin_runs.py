"""Runs to be compared: played without zenoh, and with a rule that deviates at one known place."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from cubepath.agents.local.observation import View
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.rule import Choice, InitialKnowledge, Rule, RuleType, as_choice
from cubepath.protocol.core.sites import Site, site_from_json
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.messages import Edges, Executed, Report, decode, parts_of
from samples.batched import batches
from samples.long_runs import said
from samples.recordings import record_of


class Deviation(NamedTuple):
    """Who does in which round what its rule would not."""

    module: int
    round: int


@cache
def twin(
    spec: str,
    rule: str = "random",
    *,
    seed: int = 0,
    hesitate: float = 0.0,
    rounds: int = 6,
    deviation: Deviation | None = None,
    named: str | None = None,
) -> Recording:
    """Return a run as it would be on record, its rule `named` so; its end is not."""
    scene = scene_from_spec(spec)
    found = rule_named(rule, scene.system)
    if deviation is not None:
        found = deviating(found, deviation)
    records: list[Record] = []
    for number, parts in enumerate(said(scene, found, seed, hesitate), 1):
        moves = [
            Executed(part.module, part.move.generator, part.move.at)
            for part in parts
            if isinstance(part, Report) and part.move is not None
        ]
        told = [*batches(scene.system, parts), Edges(number, moves)]
        records += [record_of(message) for message in told]
        if number == rounds:
            break
    told_of = named or rule
    parameters = {"system": spec, "rule": told_of, "seed": str(seed), "hesitate": str(hesitate)}
    numbered = tuple(replace(record, sequence=at) for at, record in enumerate(records))
    path = Path(f"{spec}-{rule}-{seed}.mcap")
    return Recording(path, parameters, scene, numbered, ())


def deviating(rule: RuleType, deviation: Deviation) -> RuleType:
    """Return a rule that draws and notes as another, and once does something else."""

    def make(knowledge: InitialKnowledge) -> Rule:
        inner, calls = rule.make(knowledge), 0

        def choose(view: View) -> Choice:
            nonlocal calls
            calls += 1
            choice = as_choice(inner(view))
            if (knowledge.module, calls) != deviation:
                return choice
            legal = [int(each) for each in view.mask.nonzero()[0]]
            return replace(choice, action=next((n for n in legal if n != choice.action), 0))

        return choose

    return replace(rule, make=make, vectorised=None)


# The obvious way: everything decoded, sorted and compared.

PHASES = {"presence": 0, "note": 1, "claim": 2, "verdict": 3, "report": 4, "edges": 5}
Place = tuple[int, int, int]
"""A round, the place of a kind in it, and a module."""


def everything(recording: Recording) -> dict[Place, Any]:
    """Return all that was said, each thing once, by its place in the run."""
    found: dict[Place, Any] = {}
    for record in recording.records:
        for part in parts_of(decode(record.data)):
            fields: dict[str, Any] = msgspec.to_builtins(part)
            if fields["kind"] not in PHASES:
                continue
            found[fields["round"], PHASES[fields["kind"]], fields.get("module", -1)] = fields
    return found


def first_other(a: Recording, b: Recording) -> Place | None:
    """Return the first place at which something else was said."""
    one, two = everything(a), everything(b)
    return next((at for at in sorted({*one, *two}) if one.get(at) != two.get(at)), None)


def first_choices(a: Recording, b: Recording) -> tuple[int, list[int]] | None:
    """Return the first round in which claims differ or, one later, notes do, and whose."""
    one, two = everything(a), everything(b)
    found: set[tuple[int, int]] = set()
    for number, phase, module in {*one, *two}:
        mine, theirs = (_chosen(each.get((number, phase, module))) for each in (one, two))
        if phase == PHASES["claim"] and mine != theirs:
            found.add((number, module))
        if phase == PHASES["note"] and number > 1 and mine != theirs:
            found.add((number - 1, module))
    if not found:
        return None
    first = min(number for number, _ in found)
    return first, sorted(module for number, module in found if number == first)


def _chosen(fields: Any) -> object:
    if fields is None:
        return None
    return fields.get("note"), fields.get("generator"), fields.get("at")


def standing(recording: Recording, number: int) -> dict[Site, int]:
    """Return who stands where in a round, by what modules say in it."""
    found = everything(recording)
    here: Mapping[Place, Any] = {at: each for at, each in found.items() if at[0] == number}
    return {
        site_from_json(fields["before"]): module
        for (_, phase, module), fields in here.items()
        if phase == PHASES["report"]
    }


def shuffled(recording: Recording, order: list[float]) -> Recording:
    """Return the recording with the messages of each round in another order of arrival."""
    keys = [(r.round, order[n % len(order)], n) for n, r in enumerate(recording.records)]
    records = [recording.records[key[2]] for key in sorted(keys)]
    return replace(
        recording, records=tuple(replace(each, sequence=n) for n, each in enumerate(records))
    )


def kind_at(place: Place) -> str:
    """Return the kind of message that stands at a place."""
    return next(kind for kind, phase in PHASES.items() if phase == place[1])
