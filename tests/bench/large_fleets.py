"""Vehicles that wander on a large grid: the paths that the benchmarks of reading are about.

`wandering` is the whole recipe: in each round the vehicles are asked in a fresh random order, each
names one of its four neighbours at random, and goes there if nobody is there and nobody has been
there in this round. The random numbers are those of `random.Random` with the given seed, so every
machine makes the same fleet. Nobody enters a cell in the round in which it was left, so that the
rounds are cubes, and every order of the moves of a round is admissible.
"""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

Cell = tuple[int, int]
SEED = 20261122
SIDE, VEHICLES = 300, 9_000
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))


def wandering(
    moves: int, *, side: int = SIDE, vehicles: int = VEHICLES, seed: int = SEED
) -> tuple[list[Cell], list[list[tuple[int, Cell]]]]:
    """Return the starts, and for each round who goes where; `moves` in all."""
    random = Random(seed)
    cells = [(x, y) for y in range(side) for x in range(side)]
    at = random.sample(cells, vehicles)
    starts = list(at)
    order = list(range(vehicles))
    taken = set(at)
    rounds: list[list[tuple[int, Cell]]] = []
    left = moves
    while left:
        random.shuffle(order)
        entered: list[tuple[int, Cell]] = []
        gone: list[Cell] = []
        for who in order:
            x, y = at[who]
            dx, dy = random.choice(_STEPS)
            there = (x + dx, y + dy)
            if there in taken or not (0 <= there[0] < side and 0 <= there[1] < side):
                continue
            # What is left in this round stays taken until the round is over.
            taken.add(there)
            gone.append((x, y))
            at[who] = there
            entered.append((who, there))
            left -= 1
            if not left:
                break
        taken.difference_update(gone)
        rounds.append(entered)
    return starts, rounds


def steps(starts: list[Cell], rounds: list[list[tuple[int, Cell]]]) -> Iterator[tuple[Cell, Cell]]:
    """Yield each move as the cell that is left and the cell that is entered."""
    at = list(starts)
    for moved in rounds:
        for who, there in moved:
            yield at[who], there
            at[who] = there


def write_lines(
    target: Path, moves: Iterator[tuple[Cell, Cell]], text: Callable[[Cell], str]
) -> None:
    """Write self-contained moves, each with an id of its own; `text` is the JSON of a cell."""
    with target.open("w") as stream:
        for number, (source, there) in enumerate(moves):
            one, other = text(source), text(there)
            both = f"[{one},{other}]" if source < there else f"[{other},{one}]"
            stream.write(
                f'{{"id":{number},"support":{both},"trace":{both}'
                f',"before":[{one}],"after":[{other}]}}\n'
            )


def write_log(target: Path, starts: list[Cell], rounds: list[list[tuple[int, Cell]]]) -> None:
    """Write the plan as a log, a timestep a line."""
    at = list(starts)
    with target.open("w") as stream:
        stream.write(f"agents={len(at)}\nsolution=\n")
        for number, moved in enumerate([[], *rounds]):
            for who, there in moved:
                at[who] = there
            stream.write(f"{number}:" + "".join(f"({x},{y})," for x, y in at) + "\n")


def write_map(target: Path, side: int = SIDE) -> None:
    """Write an empty map in the form of movingai.com."""
    rows = "\n".join("." * side for _ in range(side))
    target.write_text(f"type octile\nheight {side}\nwidth {side}\nmap\n{rows}\n")


def write_scenario(
    target: Path, starts: list[Cell], rounds: list[list[tuple[int, Cell]]], side: int = SIDE
) -> None:
    """Write a scenario whose goals are where the vehicles are in the end, each its own."""
    goals = list(starts)
    for moved in rounds:
        for who, there in moved:
            goals[who] = there
    moves = [*steps(starts, rounds)]
    target.write_text(
        json.dumps({"grid": [side, side], "starts": starts, "goals": goals, "moves": moves})
    )
