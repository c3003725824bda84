"""Recordings whose certificate was tampered with."""

from itertools import pairwise
from typing import Any

from msgspec.structs import replace

from cubepath.protocol.core.actions import commute
from cubepath.protocol.core.sites import site_from_json
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Certified, decode
from samples.recordings import edited, first, recorded
from tampering.tamperings import crowd, tampers


def with_certificate(whole: Recording, **changes: Any) -> Recording:
    said: Certified = first(whole, "certificate")
    new = replace(said, certificate=replace(said.certificate, **changes))
    return edited(whole, said, new)


def back_and_forth() -> Recording:
    """Return a run with moves that cancel."""
    found = recorded("agv:graph=grid3x3,n=3", "random", rounds=12)
    assert first(found, "certificate").certificate.cancelled
    return found


@tampers("certificate")
def a_chain_that_is_too_short() -> Recording:
    chain = first(crowd(), "certificate").certificate.chain
    return with_certificate(crowd(), chain=chain[1:])


@tampers("certificate")
def a_chain_through_another_move() -> Recording:
    found = first(crowd(), "certificate").certificate
    return with_certificate(crowd(), chain=[found.chain[0], *found.chain[:-1]])


@tampers("certificate")
def cubes_of_the_certificate_swapped() -> Recording:
    one, two, *rest = first(crowd(), "certificate").certificate.cubes
    return with_certificate(crowd(), cubes=[two, one, *rest])


@tampers("certificate")
def another_schedule_that_is_as_good() -> Recording:
    """Return a certificate that holds, but of a schedule that is not the one on record."""
    whole = crowd()
    found = first(whole, "certificate").certificate
    cubes, chain = [list(cube) for cube in found.cubes], set(found.chain)
    system = whole.scene.system
    path = [
        system.action(move.generator, site_from_json(move.at))
        for record in whole.of_kind("edges")
        for move in decode(record.data).moves  # type: ignore[union-attr]
    ]
    for one, two in pairwise(cubes):
        for move in one:
            if move not in chain and all(commute(path[move - 1], path[m - 1]) for m in two):
                one.remove(move)
                two.append(move)
                return with_certificate(whole, cubes=cubes)
    raise AssertionError("every move is held up by the next cube")


@tampers("certificate")
def a_pair_that_is_none() -> Recording:
    whole = back_and_forth()
    (first_, later), *rest = first(whole, "certificate").certificate.cancelled
    return with_certificate(whole, cancelled=[(later, first_), *rest])


@tampers("certificate")
def a_certificate_of_fewer_moves() -> Recording:
    moves = first(crowd(), "certificate").certificate.moves
    return with_certificate(crowd(), moves=moves - 1)


@tampers("certificate")
def an_end_that_is_another() -> Recording:
    end = first(crowd(), "certificate").certificate.end
    return with_certificate(crowd(), end=end[1:])


@tampers("certificate")
def two_certificates() -> Recording:
    said: Certified = first(crowd(), "certificate")
    other = replace(said, certificate=replace(said.certificate, end=None))
    return edited(crowd(), said, said, other)
