"""Recordings and certificates derived again, by code that shares nothing with the run.

Room: coordinator. From the coordinator it imports only `normal_form.definitions`, and from the
agents nothing. This holds for indirect imports too, so a bug in the run cannot hide here. From the
core's actions it takes `Action` and `commute`; it defines admissible itself. `runs` and
`shortening` check their results with it, and `auditing` asks the rules of a recording with it.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.verification.certificate import (
        check_certificate,
        check_numbered,
        compare_cubes,
    )
    from cubepath.coordinator.verification.choices import Arrays, Moment, Observing
    from cubepath.coordinator.verification.equality import difference
    from cubepath.coordinator.verification.findings import Check, Progress, Verification
    from cubepath.coordinator.verification.following import check_following
    from cubepath.coordinator.verification.following_proof import (
        FollowingRefutation,
        ProvedFewest,
        check_fewest_rounds,
    )
    from cubepath.coordinator.verification.free_history import History
    from cubepath.coordinator.verification.free_transcript import turn_text
    from cubepath.coordinator.verification.free_turns import Seen
    from cubepath.coordinator.verification.free_units import NO_SITE, changed_by, held_by
    from cubepath.coordinator.verification.holes import hole_in, lacks
    from cubepath.coordinator.verification.optimality import (
        ProvedOptimal,
        Refutation,
        check_optimality,
    )
    from cubepath.coordinator.verification.parameters import hesitation_in, max_rounds_in, seed_in
    from cubepath.coordinator.verification.partial import moves_in, whole_rounds, why_partial
    from cubepath.coordinator.verification.proof import check_proof
    from cubepath.coordinator.verification.recording import Recovered, recover, verify
    from cubepath.coordinator.verification.round_spans import (
        Span,
        add_to_spans,
        gaps_between,
        rounds_text,
        spans_text,
    )
    from cubepath.coordinator.verification.rounds import rank
    from cubepath.coordinator.verification.stages import (
        RECORDED,
        Stage,
        spans,
        stages_in,
        stages_of,
        stages_text,
    )
    from cubepath.coordinator.verification.told_scene import with_told_scene
    from cubepath.coordinator.verification.transcript import (
        RECOVERED,
        OutOfOrder,
        Round,
        Sorting,
        Transcript,
        is_cut_off,
        site_in,
    )
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "certificate": "check_certificate check_numbered compare_cubes",
            "choices": "Arrays Moment Observing",
            "equality": "difference",
            "findings": "Check Progress Verification",
            "following": "check_following",
            "following_proof": "FollowingRefutation ProvedFewest check_fewest_rounds",
            "free_history": "History",
            "free_transcript": "turn_text",
            "free_turns": "Seen",
            "free_units": "NO_SITE changed_by held_by",
            "holes": "hole_in lacks",
            "optimality": "ProvedOptimal Refutation check_optimality",
            "parameters": "hesitation_in max_rounds_in seed_in",
            "partial": "moves_in whole_rounds why_partial",
            "proof": "check_proof",
            "recording": "Recovered recover verify",
            "round_spans": "Span add_to_spans gaps_between rounds_text spans_text",
            "rounds": "rank",
            "stages": "RECORDED Stage spans stages_in stages_of stages_text",
            "told_scene": "with_told_scene",
            "transcript": "OutOfOrder RECOVERED Round Sorting Transcript is_cut_off site_in",
        },
    )

__all__ = [
    "NO_SITE",
    "RECORDED",
    "RECOVERED",
    "Arrays",
    "Check",
    "FollowingRefutation",
    "History",
    "Moment",
    "Observing",
    "OutOfOrder",
    "Progress",
    "ProvedFewest",
    "ProvedOptimal",
    "Recovered",
    "Refutation",
    "Round",
    "Seen",
    "Sorting",
    "Span",
    "Stage",
    "Transcript",
    "Verification",
    "add_to_spans",
    "changed_by",
    "check_certificate",
    "check_fewest_rounds",
    "check_following",
    "check_numbered",
    "check_optimality",
    "check_proof",
    "compare_cubes",
    "difference",
    "gaps_between",
    "held_by",
    "hesitation_in",
    "hole_in",
    "is_cut_off",
    "lacks",
    "max_rounds_in",
    "moves_in",
    "rank",
    "recover",
    "rounds_text",
    "seed_in",
    "site_in",
    "spans",
    "spans_text",
    "stages_in",
    "stages_of",
    "stages_text",
    "turn_text",
    "verify",
    "whole_rounds",
    "why_partial",
    "with_told_scene",
]
