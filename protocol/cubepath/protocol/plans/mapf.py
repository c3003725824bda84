"""Plans of multi-agent path finding on movingai maps, in the formats that planners write.

A plan says where each agent is at each timestep 0, 1, ...; the map is a second file. The
benchmark's scenario (`.scen`) may be a third; its starts are then compared with the plan's. Three
formats:

`mapf-log`, one timestep per line; of pibt2 (`pibt2/src/solver.cpp`, `makeLogSolution`) and LaCAM
(`lacam/src/post_processing.cpp`, `make_log`), both in repositories of Kei18 on GitHub::

    agents=2
    map_file=room.map
    starts=(0,0),(2,0),
    goals=(1,0),(2,1),
    solution=
    0:(0,0),(2,0),
    1:(1,0),(2,1),

`mapf-agents`, one agent per line; of EECBS (`src/CBS.cpp`, `CBS::savePaths`) and MAPF-LNS2
(`src/Instance.cpp`, `Instance::savePaths`), both in repositories of Jiaoyang-Li on GitHub::

    Agent 0: (0,0)->(1,0)->
    Agent 1: (2,0)->(2,1)->

`mapf-json`, a list with a path for each agent, or with `by=step` a list of the agents' cells for
each timestep::

    [[[0, 0], [1, 0]], [[2, 0], [2, 1]]]

A cell is (x, y), column x of row y counted from the top left, or (row, column): logs have the first
order, EECBS the second, MAPF-LNS2 the first for benchmark scenarios and the second for its own. The
key `order` says which. Without it, `mapf-agents` takes the order that the scenario, or else the
map, allows; if both orders are possible, the key is required. An agent whose path has ended stays
in place.

Planners let an agent follow another into a cell; see `cubepath.protocol.plans.vehicles`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence, Set as AbstractSet
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.input_files import InputFile, opened
from cubepath.protocol.core.parsing import read_json
from cubepath.protocol.core.sites import site_text
from cubepath.protocol.plans.imported import Cell, ImportedPath, PlanRequest, no_system
from cubepath.protocol.plans.vehicles import Vehicles, off_targets, planned_path
from cubepath.protocol.systems.benchmarks import BenchmarkTask, task_from_scen
from cubepath.protocol.systems.graphs import Graph, graph_from_map

_CELL = re.compile(r"\(\s*([0-9]{1,9})\s*,\s*([0-9]{1,9})\s*\)")
_CELLS = re.compile(r"(\([0-9]{1,9},[0-9]{1,9}\),)*(\([0-9]{1,9},[0-9]{1,9}\))?")
_PATH = re.compile(r"\s*[Aa]gent\s+([0-9]{1,9})\s*:\s*(.*?)\s*(?:->)?\s*")
_ORDERS = {"xy": "(x, y)", "rc": "(row, column)"}


@dataclass(frozen=True, slots=True)
class _Plan:
    """The path of each agent, as written, and the line of each timestep in the file.

    `lines` holds the line number of each timestep; it is empty if the file has none per timestep.
    `starts` and `goals` are those that the file tells apart from the paths.
    """

    paths: Sequence[Sequence[Cell]]
    lines: Sequence[int] = ()
    starts: Sequence[Cell] | None = None
    goals: Sequence[Cell] | None = None
    map_name: str | None = None

    @property
    def steps(self) -> int:
        """Return the planner's number of rounds, up to the end of the longest path."""
        return max((len(path) for path in self.paths), default=1) - 1

    def rounds(self) -> Iterator[Callable[[], dict[int, Cell]]]:
        """Yield, for each timestep from 1 on, where the agents go whose paths have not ended."""
        for step in range(1, self.steps + 1):
            yield partial(self._targets, step)

    def _targets(self, step: int) -> dict[int, Cell]:
        return {
            vehicle: cells[step] for vehicle, cells in enumerate(self.paths) if step < len(cells)
        }

    def turned(self) -> _Plan:
        """Return the plan with the two numbers of each cell exchanged."""
        paths = [list(map(_turned, path)) for path in self.paths]
        starts, goals = (
            None if cells is None else list(map(_turned, cells))
            for cells in (self.starts, self.goals)
        )
        return replace(self, paths=paths, starts=starts, goals=goals)


def _turned(cell: Cell) -> Cell:
    """Return a cell with its two numbers exchanged."""
    return (cell[1], cell[0])


def read_log(request: PlanRequest) -> ImportedPath:
    """Read a log of pibt2 or LaCAM; InputError as `ImportedPath` says."""
    return _imported(request, _log(request.file), "xy")


def read_agents(request: PlanRequest) -> ImportedPath:
    """Read paths as EECBS and MAPF-LNS2 write them; InputError as `ImportedPath` says."""
    return _imported(request, _agents(request.file), "")


def read_lists(request: PlanRequest) -> ImportedPath:
    """Read lists of lists of cells; InputError as `ImportedPath` says."""
    path = request.path
    found = read_json(request.file, list[list[Cell]])
    by = request.values["by"]
    if by not in ("agent", "step"):
        raise InputError(f"by={by}: expected agent or step")
    if by == "step":
        for number, cells in enumerate(found):
            if len(cells) != len(found[0]):
                raise InputError(
                    f"{path}: timestep {number} has {len(cells)} cells, expected one for each of"
                    f" {len(found[0])} agents"
                )
        found = [list(each) for each in zip(*found, strict=True)]
    for number, each in enumerate(found):
        if not each:
            raise InputError(f"{path}: agent {number} has no cell, expected at least its start")
    return _imported(request, _Plan(found), "xy")


def _log(file: InputFile) -> _Plan:
    path, lines = file.path, _lines(file)
    head: dict[str, str] = {}
    for number, line in lines:
        key, equals, value = line.partition("=")
        if not equals:
            raise InputError(f"{path}:{number}: found {_short(line)}, expected KEY=VALUE")
        head[key] = value
        if key == "solution":
            break
    else:
        raise InputError(f"{path}: no line 'solution=' found, expected a log with the solution")
    steps, numbers = _timesteps(path, lines)
    if "agents" in head and head["agents"] != str(len(steps[0])):
        raise InputError(f"{path}: agents={head['agents']}, but {len(steps[0])} in the solution")
    starts = _cells(head["starts"], f"{path}: starts") if "starts" in head else None
    goals = _cells(head["goals"], f"{path}: goals") if "goals" in head else None
    if goals is not None and len(goals) != len(steps[0]):
        raise InputError(f"{path}: {len(goals)} goals, expected one for each agent")
    paths = list(zip(*steps, strict=True))
    return _Plan(paths, numbers, starts, goals, head.get("map_file"))


def _timesteps(path: Path, lines: Iterable[tuple[int, str]]) -> tuple[list[list[Cell]], list[int]]:
    """Return where the agents are at each timestep, and the line number of each timestep."""
    steps: list[list[Cell]] = []
    numbers: list[int] = []
    for number, line in lines:
        step, colon, rest = line.partition(":")
        if not (colon and step == str(len(steps))):
            raise InputError(
                f"{path}:{number}: found {_short(line)}, expected timestep {len(steps)} as"
                f" '{len(steps)}:(x,y),(x,y),'"
            )
        steps.append(_cells(rest, f"{path}:{number}"))
        numbers.append(number)
        if len(steps[-1]) != len(steps[0]):
            raise InputError(
                f"{path}:{number}: {len(steps[-1])} cells, expected one for each of"
                f" {len(steps[0])} agents"
            )
    if not steps:
        raise InputError(f"{path}: a log without a solution, expected timesteps after 'solution='")
    return steps, numbers


def _agents(file: InputFile) -> _Plan:
    path = file.path
    paths: list[list[Cell]] = []
    for number, line in _lines(file):
        found = _PATH.fullmatch(line)
        if found is None or int(found[1]) != len(paths):
            raise InputError(
                f"{path}:{number}: found {_short(line)}, expected"
                f" 'Agent {len(paths)}: (a,b)->(a,b)->'"
            )
        cells = [_CELL.fullmatch(cell) for cell in re.split(r"\s*->\s*", found[2])]
        paths.append([])
        for place, cell in enumerate(cells):
            if cell is None:
                raise InputError(
                    f"{path}:{number}: agent {found[1]}, timestep {place}: expected a cell"
                    " '(a,b)' of two whole numbers"
                )
            paths[-1].append((int(cell[1]), int(cell[2])))
    if not paths:
        raise InputError(f"{path}: no agent found, expected lines 'Agent 0: (a,b)->(a,b)->'")
    return _Plan(paths)


def _lines(file: InputFile) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(file.text().splitlines(), 1):
        if line.strip():
            yield number, line.strip()


def _cells(words: str, where: str) -> list[Cell]:
    if not _CELLS.fullmatch(words):
        raise InputError(f"{where}: found {_short(words)}, expected cells '(x,y),(x,y),'")
    numbers = np.fromstring(words.replace("(", "").replace(")", ""), dtype=np.int64, sep=",")
    return list(zip(numbers[::2].tolist(), numbers[1::2].tolist(), strict=True))


def _short(words: str) -> str:
    return repr(words if len(words) <= 40 else f"{words[:40]}...")


def _imported(request: PlanRequest, plan: _Plan, order: str) -> ImportedPath:
    """Check a plan's cells against its companion files, and turn it into moves."""
    path = request.path
    no_system(request, "a plan on a map")
    graph, starts, goals = _beside(request, plan)
    free = cast("frozenset[Cell]", frozenset(graph.vertices))  # vertices of a map are cells
    plan = _in_order(request, plan, order, free, starts)
    first = [planned[0] for planned in plan.paths]
    with errors_at(str(path)):
        _check_starts(first, plan.starts, starts or ())
        try:
            vehicles = Vehicles(first, free.__contains__, called="agent")
        except InputError as error:
            if request.values.get("by") != "agent":
                raise
            by_step = "a list for each timestep is --format mapf-json:by=step"
            raise InputError(f"{error}; {by_step}") from None
    known = plan.goals if goals is None else goals[: len(first)]
    return planned_path(
        path,
        vehicles,
        (
            (f"{path}{f':{plan.lines[step]}' if plan.lines else ''}: timestep {step}", targets)
            for step, targets in enumerate(plan.rounds(), 1)
        ),
        count=plan.steps,
        graph=lambda: graph,
        goals=known,
        unsolved=lambda: None if known is None else off_targets(vehicles.at, known, "agent"),
    )


def _check_starts(
    first: Sequence[Cell], own: Sequence[Cell] | None, starts: Sequence[Cell]
) -> None:
    if own is not None and first != own:
        raise InputError("timestep 0 differs from starts=, expected the same cells")
    for number, (found, start) in enumerate(zip(first, starts, strict=False)):
        if found != start:
            raise InputError(
                f"agent {number} starts at {site_text(found)}, in the scenario at"
                f" {site_text(start)}"
            )


def _beside(
    request: PlanRequest, plan: _Plan
) -> tuple[Graph, Sequence[Cell] | None, Sequence[Cell] | None]:
    """Return the map, and the starts and goals of the scenario if there is one."""
    graph: Graph | None = None
    scenario: BenchmarkTask | None = None
    for companion in request.companions:
        with opened(companion) as file:
            is_scenario = re.match(r"\s*version\b", file.text()) is not None
            if (scenario if is_scenario else graph) is not None:
                what = "scenario" if is_scenario else "map"
                raise InputError(f"{companion}: a second {what}, expected one")
            if is_scenario:
                scenario = task_from_scen(file)
            else:
                graph = graph_from_map(file)
    if graph is None and (map_file := _named_map(request.path, plan)) is not None:
        with opened(map_file) as file:
            graph = graph_from_map(file)
    if graph is None:
        named = "" if plan.map_name is None else f" {plan.map_name}"
        raise InputError(f"{request.path}: a plan on a map: expected the map{named}, --with FILE")
    if scenario is None:
        return graph, None, None
    if len(scenario.starts) < len(plan.paths):
        raise InputError(
            f"{request.path}: {len(plan.paths)} agents, in the scenario {len(scenario.starts)}"
        )
    return graph, scenario.starts, scenario.goals


def _named_map(path: Path, plan: _Plan) -> Path | None:
    """Return the map that a log names, if it lies in the folder of the log; no other is opened."""
    name = Path(plan.map_name or "").name
    if not name or not path.is_file():  # as standard input
        return None
    beside = path.with_name(name)
    return beside if os.path.isfile(beside) else None  # noqa: PTH113 - never raises


def _in_order(
    request: PlanRequest,
    plan: _Plan,
    order: str,
    free: AbstractSet[Cell],
    starts: Sequence[Cell] | None,
) -> _Plan:
    """Return the plan with its cells as (x, y); InputError if nothing decides their order.

    If neither order fits, (x, y) is taken, and refused by a later check.
    """
    order = request.values["order"] or order
    if order not in (*_ORDERS, ""):
        raise InputError(f"order={order}: expected xy or rc, for {' or '.join(_ORDERS.values())}")
    if order:
        return plan if order == "xy" else plan.turned()
    readings = [plan, plan.turned()]
    if starts is not None:
        firsts = [[planned[0] for planned in each.paths] for each in readings]
        fits = [first == list(starts[: len(first)]) for first in firsts]
        if sum(fits) == 1:
            return readings[fits.index(True)]
    fits = [all(cell in free for planned in each.paths for cell in planned) for each in readings]
    if all(fits):
        if readings[0].paths == readings[1].paths:
            return plan
        raise InputError(
            f"{request.path}: its cells fit the map as (x, y) and as (row, column): expected"
            " --format mapf-agents:order=xy or order=rc, or the scenario, --with FILE"
        )
    return readings[1] if fits[1] else plan
