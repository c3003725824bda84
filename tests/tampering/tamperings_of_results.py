"""Recordings whose results were tampered with: edges, cubes, and the summary."""

from dataclasses import replace as with_fields
from typing import Any

from msgspec.structs import replace

from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.recordings.recording import Recording
from cubepath.protocol.wire.messages import Cube, Executed, decode
from samples.recordings import all_edited, edited, first, recorded
from tampering.tamperings import crowd, tampers


@tampers("edges")
def edges_with_a_move_less() -> Recording:
    edges = first(crowd(), "edges", lambda message: message.moves)
    return edited(crowd(), edges, replace(edges, moves=edges.moves[1:]))


@tampers("edges")
def edges_of_another_mover() -> Recording:
    edges = first(crowd(), "edges", lambda message: message.moves)
    move: Executed = edges.moves[0]
    other = replace(move, module=move.module + 1)
    return edited(crowd(), edges, replace(edges, moves=[other, *edges.moves[1:]]))


@tampers("edges")
def no_edges_of_a_round() -> Recording:
    return edited(crowd(), first(crowd(), "edges", lambda message: message.round == 4))


@tampers("edges")
def edges_of_no_round() -> Recording:
    edges = first(crowd(), "edges")
    return edited(crowd(), edges, edges, replace(edges, round=99))


@tampers("edges")
def edges_twice() -> Recording:
    edges = first(crowd(), "edges", lambda message: message.moves)
    return edited(crowd(), edges, edges, replace(edges, moves=[]))


@tampers("ends", "class")
def two_cubes_swapped() -> Recording:
    def swap(cube: Cube) -> Cube:
        return replace(cube, index={1: 2, 2: 1}.get(cube.index, cube.index))

    return all_edited(crowd(), "cube", swap)


@tampers("normal", "class")
def a_cube_taken_apart() -> Recording:
    wide = first(crowd(), "cube", lambda message: len(message.moves) > 1)

    def apart(cube: Cube) -> Cube:
        if cube.index == wide.index:
            return replace(cube, moves=cube.moves[1:])
        return replace(cube, index=cube.index + (cube.index > wide.index))

    found = all_edited(crowd(), "cube", apart)
    rest = replace(wide, moves=wide.moves[:1], index=wide.index + 1)
    summary = first(found, "summary")
    more = replace(summary, cubes=summary.cubes + 1)
    return edited(found, summary, rest, more)


@tampers("normal")
def a_cube_that_does_not_commute() -> Recording:
    one = first(crowd(), "cube", lambda message: message.index == 1)
    two = first(crowd(), "cube", lambda message: message.index == 2)
    return edited(crowd(), one, replace(one, moves=[*one.moves, *two.moves]))


@tampers("dependencies", "class")
def a_move_of_the_last_cube_in_the_first() -> Recording:
    whole = crowd()
    count = first(whole, "summary").cubes
    last: Cube = first(whole, "cube", lambda message: message.index == count)

    def early(cube: Cube) -> Cube:
        if cube.index == 1:
            return replace(cube, moves=[*cube.moves, last.moves[0]])
        return replace(cube, moves=cube.moves[1:]) if cube.index == count else cube

    return all_edited(whole, "cube", early)


@tampers("normal")
def a_cube_of_no_moves() -> Recording:
    cube = first(crowd(), "cube")
    return edited(crowd(), cube, replace(cube, moves=[]))


@tampers("normal")
def a_cube_of_no_action() -> Recording:
    cube = first(crowd(), "cube")
    return edited(crowd(), cube, replace(cube, moves=[GeneratorPlacement("edge", (0, 0))]))


@tampers("ends", "class")
def a_move_of_a_cube_is_missing() -> Recording:
    cube = first(crowd(), "cube", lambda message: len(message.moves) > 1)
    return edited(crowd(), cube, replace(cube, moves=cube.moves[1:]))


@tampers("class")
def the_other_way_round() -> Recording:
    """Return cubes that are normal and end where the moves end, but go round the other side."""
    whole, taken = two_steps_round_a_circle()
    system: Any = whole.scene.system
    left = [edge for edge in system.edges if edge not in taken]
    left.sort(key=lambda edge: whole.scene.start[0] not in edge)

    def turn(cube: Cube) -> Cube:
        return replace(cube, moves=[GeneratorPlacement("edge", left[cube.index - 1])])

    return all_edited(whole, "cube", turn)


def two_steps_round_a_circle() -> tuple[Recording, list[Any]]:
    """Return a vehicle on a circle of four that ends opposite, and the edges it took."""
    for seed in range(40):
        found = recorded("agv:graph=C4,n=1", "random", seed=seed, rounds=2)
        cubes = [decode(record.data) for record in found.of_kind("cube")]
        taken = [move.at for cube in cubes if isinstance(cube, Cube) for move in cube.moves]
        if len(taken) == 2:
            return found, taken
    raise AssertionError("it never goes two steps")


@tampers("summary")
def a_digest_of_another_path() -> Recording:
    summary = first(crowd(), "summary")
    return edited(crowd(), summary, replace(summary, path_digest="0" * 64))


@tampers("ended")
def a_goal_that_was_not_reached() -> Recording:
    whole = recorded("agv:graph=grid4x4,n=7", "random", rounds=3)
    summary = first(whole, "summary")
    return edited(whole, summary, replace(summary, ended="goal"))


@tampers("ended")
def an_end_before_its_time() -> Recording:
    whole = recorded("agv:graph=grid4x4,n=7", "random", rounds=3)
    return with_fields(whole, parameters={**whole.parameters, "max_rounds": "9"})
