"""Recordings that go on from another one, tampered with: who followed which rule from when on."""

import json
from collections.abc import Callable
from dataclasses import replace as with_fields
from functools import cache
from typing import Any

from msgspec.structs import replace

from cubepath.coordinator.runs.continuing import what_if
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Go
from samples.recordings import edited, first, new_path
from tampering.tamperings import crowd, tampers


@cache
def gone_on() -> Recording:
    """Return vehicles that claim by one rule, and from round 4 on by another."""
    return what_if(crowd(), "random", from_round=4, seed=2, processes=0, log=new_path()).recording()


def told(**changes: str | None) -> Recording:
    """Return the recording with other parameters, or without those that are None."""
    parameters = {**gone_on().parameters, **changes}
    kept = {key: value for key, value in parameters.items() if value is not None}
    return with_fields(gone_on(), parameters=kept)


def staged(edit: Callable[[list[Any]], object], **changes: str) -> Recording:
    """Return the recording with other stages."""
    stages = json.loads(gone_on().parameters["stages"])
    edit(stages)
    return told(stages=json.dumps(stages), **changes)


@tampers("stages")
def the_stages_are_lost() -> Recording:
    return told(stages=None)


@tampers("stages")
def the_stages_are_none() -> Recording:
    return told(stages='[{"begins":1}]')


@tampers("stages")
def the_stages_are_of_another_rule() -> Recording:
    return told(rule="tswap")


@tampers("stages")
def the_rule_that_took_over_is_not_named() -> Recording:
    return told(what_if=None)


@tampers("stages")
def another_rule_took_over() -> Recording:
    return told(what_if="tswap")


@tampers("stages")
def it_took_over_in_another_round() -> Recording:
    return told(from_round="5")


@tampers("stages", "choices")
def the_stages_have_it_in_another_round() -> Recording:
    return staged(lambda stages: stages[1].update(begins=5), from_round="5")


@tampers("stages")
def the_coordinator_does_not_say_so() -> Recording:
    over = first(gone_on(), "go", lambda go: go.phase == "over")
    assert isinstance(over, Go)
    return edited(gone_on(), over)


@tampers("stages", "pacing")
def it_says_so_in_another_round() -> Recording:
    over = first(gone_on(), "go", lambda go: go.phase == "over")
    return edited(gone_on(), over, replace(over, round=over.round + 1))


@tampers("stages")
def the_first_stage_begins_later() -> Recording:
    return staged(lambda stages: stages[0].update(begins=2))


@tampers("stages")
def a_module_follows_two_rules() -> Recording:
    return staged(lambda stages: stages[0]["rules"].update(random="0"))


@tampers("stages")
def a_module_that_there_is_not_follows_a_rule() -> Recording:
    return staged(lambda stages: stages[1]["rules"].update(random="0-7"))


@tampers("stages")
def the_first_stage_has_another_seed() -> Recording:
    return staged(lambda stages: stages[0].update(seed=9))


@tampers("stages")
def a_stage_hesitates_too_much() -> Recording:
    return staged(lambda stages: stages[1].update(hesitate=1.5))


@tampers("choices")
def the_rule_on_record_was_another() -> Recording:
    return staged(lambda stages: stages[0].update(rules={"random": "0-6"}))


@tampers("choices")
def the_rule_that_took_over_drew_from_another_seed() -> Recording:
    return staged(lambda stages: stages[1].update(seed=3))
