"""Plans of other programs for tests: a path of moves, written as each of the formats has it."""

import json
from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import System
from cubepath.protocol.file_forms import read_plan
from cubepath.protocol.path_files.moves import PathMove

Cell = tuple[int, int]
Steps = list[list[Cell]]
"""Where the vehicles are, timestep by timestep."""

DATA = Path(__file__).parent.parent / "data" / "imports"
_LETTERS = {(0, 1): "N", (1, 0): "E", (0, -1): "S", (-1, 0): "W"}


def moves_read(path: Path, spec: str | None = None, **others: Any) -> list[PathMove]:
    """Return the moves of a plan."""
    found = read_plan(path, spec, **others)
    assert found is not None
    return list(found.moves)


def actions_read(path: Path, spec: str | None = None, **others: Any) -> list[Action]:
    """Return the actions of a plan."""
    return [move.action for move in moves_read(path, spec, **others)]


def vehicle_moves(word: Iterable[Action], start: Iterable[Site]) -> list[tuple[Cell, Cell]]:
    """Return from where to where each move of unlabelled vehicles goes."""
    state = set(start)
    found = []
    for action in word:
        ((source,), (target,)) = sorted(action.ends, key=lambda end: not end <= state)
        found.append((source, target))
        state ^= {source, target}
    return found  # type: ignore[return-value]


def timesteps(starts: Sequence[Cell], moves: Iterable[tuple[Cell, Cell]]) -> Steps:
    """Put moves that are legal one by one into as few rounds as follow-moves allow."""
    at = {cell: who for who, cell in enumerate(starts)}
    ready = [0] * len(starts)
    left: dict[Cell, int] = {}
    rounds: list[dict[int, Cell]] = []
    for source, target in moves:
        who = at.pop(source)
        at[target] = who
        # Not before the vehicle is there, nor before the round in which the last one leaves.
        when = max(ready[who], left.get(target, 0))
        ready[who] = when + 1
        left[source] = when
        rounds += [{} for _ in range(when + 1 - len(rounds))]
        rounds[when][who] = target
    steps = [list(starts)]
    for each in rounds:
        steps.append([each.get(who, cell) for who, cell in enumerate(steps[-1])])
    return steps


def log_text(steps: Steps, **head: object) -> str:
    """Write a plan as LaCAM does."""

    def cells(step: Sequence[Cell]) -> str:
        return "".join(f"({x},{y})," for x, y in step)

    known = {
        "agents": len(steps[0]),
        "map_file": "room.map",
        "solver": "planner",
        "solved": 1,
        "starts": cells(steps[0]),
        "goals": cells(steps[-1]),
        **head,
    }
    lines = [f"{key}={value}" for key, value in known.items() if value is not None]
    lines.append("solution=")
    lines += [f"{number}:{cells(step)}" for number, step in enumerate(steps)]
    return "\n".join(lines) + "\n"


def agents_text(steps: Steps, *, order: str = "rc", gap: str = " ") -> str:
    """Write a plan as EECBS does (`gap` a space) or MAPF-LNS2 (none), each path up to its end."""
    lines = []
    for who in range(len(steps[0])):
        path = [step[who] for step in steps]
        while len(path) > 1 and path[-1] == path[-2]:
            path.pop()
        cells = "".join(f"({x},{y})->" if order == "xy" else f"({y},{x})->" for x, y in path)
        lines.append(f"Agent {who}:{gap}{cells}")
    return "\n".join(lines) + "\n"


def map_text(free: Iterable[Cell]) -> str:
    """Write a movingai map whose other cells are obstacles."""
    cells = set(free)
    wide, high = max(x for x, _ in cells) + 1, max(y for _, y in cells) + 1
    rows = ["".join(".@"[(x, y) not in cells] for x in range(wide)) for y in range(high)]
    return "\n".join(["type octile", f"height {high}", f"width {wide}", "map", *rows, ""])


def steps_2021(
    steps: Steps, obstacles: Iterable[Cell], name: str = "test"
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return instance and solution as CG:SHOP 2021 has them."""
    rounds = [
        {
            str(who): _LETTERS[there[0] - here[0], there[1] - here[1]]
            for who, (here, there) in enumerate(zip(before, after, strict=True))
            if here != there
        }
        for before, after in pairwise(steps)
    ]
    instance = {
        "meta": {"number_of_robots": len(steps[0])},
        "name": name,
        "obstacles": list(obstacles),
        "starts": steps[0],
        "targets": steps[-1],
    }
    return instance, {"instance": name, "steps": rounds}


def flips_2026(word: Sequence[Action], start: Iterable[Site]) -> list[list[Site]]:
    """Return for each flip the edge that goes, one flip a round."""
    state = set(start)
    rounds = []
    for action in word:
        ((gone,), _) = sorted(
            (end & action.trace for end in action.ends), key=lambda e: not e <= state
        )
        rounds.append([gone])
        state ^= action.trace
    return rounds


def plain_text(word: Sequence[Action], system: System, start: Iterable[Site]) -> str:
    """Write a path as a plain list, each move by its mover."""
    state = set(start)
    lines = ["# a walk"]
    for action in word:
        move = next(
            move
            for site in sorted(state - system.filled, key=repr)
            for move in system.moves(site)
            if move is not None and move.action == action and move.possible(state)
        )
        lines.append(f"{_plain(move.source)} -> {_plain(move.target)}{_about(move)}")
        state ^= action.ends[0] ^ action.ends[1]
    return "\n".join(lines) + "\n"


def _plain(site: Site) -> str:
    return json.dumps(site).replace("[", "(").replace("]", ")").replace(" ", "")


def _about(move: Move) -> str:
    on = sorted(move.action.reads & move.action.ends[0], key=repr)
    return f" about {_plain(on[0])}" if on else ""


def save(path: Path, content: object) -> Path:
    """Write text as it is and anything else as JSON."""
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path
