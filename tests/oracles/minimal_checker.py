"""A second checker of proofs of optimality, written from docs/proofs.md alone.

It shares no code with cubepath and is as plain as the page: sets of sites, one loop for each
definition, and unit propagation over lists. So it is slow, and right where the page is.
"""

import hashlib
import json
import math
import re
import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import combinations
from typing import Any, NamedTuple

import zstandard

from oracles.minimal_systems import (
    Action,
    RefusedError,
    Site,
    State,
    System,
    listed,
    need,
    sites_of,
)

Move = tuple[Action, int]
Literal = int | bool
BLOCKS = ["statement", "moves", "sites", "variables", "ladders", "groups", "schedule"]
STATEMENT = {"system", "start", "goal", "refuted", "cubes", "solver", "standing"}


class Found(NamedTuple):
    """What a proof proves: no schedule has `refuted` rounds, one has `cubes`."""

    refuted: int
    cubes: int
    variables: int
    clauses: int


def blocks_of(data: bytes) -> tuple[dict[str, bytes], bytes]:
    """Return the blocks by name, and the log."""
    first = b"cubepath proof 1\n"
    need(data.startswith(first), "another first line")
    at, names, found, log = len(first), list[str](), dict[str, bytes](), b""
    while not data.startswith(b"end ", at):
        begin = data.find(b"\n", at) + 1
        head = re.fullmatch(rb"([a-z]+) ([0-9]+) ([0-9a-f]{8})\n", data[at:begin])
        if head is None:
            raise RefusedError("no block begins here")
        end = begin + int(head[2])
        payload = data[begin:end]
        need(data[end : end + 1] == b"\n", "a block ends without a line end")
        need(zlib.crc32(head[0][: head.start(3)] + payload) == int(head[3], 16), "another CRC")
        try:
            content = zstandard.ZstdDecompressor().decompress(payload)
        except zstandard.ZstdError as error:
            raise RefusedError(str(error)) from None
        name, at = head[1].decode(), end + 1
        names.append(name)
        if name == "log":
            log += content
        else:
            found[name] = content
    digest = hashlib.sha256(data[:at]).hexdigest()
    need(data[at:] == f"end {len(names)} {digest}\n".encode(), "another last line")
    logs = ["log"] * names.count("log")
    need(names == [*BLOCKS[:-1], *logs, BLOCKS[-1]], "other blocks")
    return found, log


def before(move: Move, site: Site) -> bool:
    return site in move[0].ends[move[1]]


def after(move: Move, site: Site) -> bool:
    return site in move[0].ends[1 - move[1]]


def toggled(move: Move) -> State:
    return move[0].ends[0] ^ move[0].ends[1]


class Claim:
    """The claim that no schedule of `rounds` rounds leads from a start to a goal by some moves."""

    def __init__(self, actions: Iterable[Action], start: State, goal: State, rounds: int) -> None:
        self.start, self.goal, self.rounds = start, goal, rounds
        moves = {(action, end) for action in actions for end in (0, 1)}
        while True:
            self.ahead, first = self._earliest(start, moves)
            self.behind, back = self._earliest(goal, {(each, 1 - end) for each, end in moves})
            self.window = {
                (each, end): range(int(first[each, end]), rounds + 2 - int(back[each, 1 - end]))
                for each, end in moves
                if (each, end) in first and (each, 1 - end) in back
            }
            self.window = {move: window for move, window in self.window.items() if window}
            if len(self.window) == len(moves):
                break
            moves = set(self.window)
        self.sites = start | goal | {site for action, _ in moves for site in action.support}
        self.refuted = not all(
            self.can(site, time, True) or self.can(site, time, False)
            for site in self.sites
            for time in range(rounds + 1)
        )
        self.made: dict[int, list[Move]] = {time: [] for time in range(1, rounds + 1)}
        for move, window in self.window.items():
            for time in window:
                self.made[time].append(move)

    def _earliest(
        self, state: State, moves: set[Move]
    ) -> tuple[dict[tuple[Site, bool], int], dict[Move, int]]:
        """Return the earliest times of values that are not so at first, and first rounds."""
        times: dict[tuple[Site, bool], int] = {}
        first: dict[Move, int] = {}

        def reached(site: Site, value: bool, time: int) -> bool:
            return value == (site in state) or times.get((site, value), time + 1) <= time

        left = set(moves)
        for time in range(self.rounds):
            ready = {
                move
                for move in left
                if all(
                    reached(site, before(move, site), time)
                    for site in move[0].support - move[0].free
                )
                and all(
                    reached(p, False, time) or reached(q, True, time) for p, q in move[0].guards
                )
            }
            for move in ready:
                first[move] = time + 1
                for site in toggled(move):
                    times.setdefault((site, after(move, site)), time + 1)
            left -= ready
        return times, first

    def can(self, site: Site, time: int, value: bool) -> bool:
        ahead = 0 if value == (site in self.start) else self.ahead.get((site, value), math.inf)
        behind = 0 if value == (site in self.goal) else self.behind.get((site, value), math.inf)
        return ahead <= time <= self.rounds - behind

    def take_variables(self, rows: list[tuple[Any, ...]], ladders: list[Any]) -> None:
        """Take the variables of a file by their meanings, which are those that there must be."""
        self.number = {row: number for number, row in enumerate(rows, 1)}
        need(len(self.number) == len(rows), "a variable twice")
        wanted: set[tuple[Any, ...]] = {
            (0, site, time)
            for site in self.sites
            for time in range(self.rounds + 1)
            if self.can(site, time, True) and self.can(site, time, False)
        }
        wanted |= {(1, move, time) for move, window in self.window.items() for time in window}
        for place, (_, _, kind, members) in enumerate(ladders):
            last = len(members) if kind == "stay" else len(members) - 1
            wanted |= {(2, place, step) for step in range(1, last + 1)}
        need(wanted == set(rows), "other variables")

    def is_(self, site: Site, time: int, value: bool) -> Literal:
        if self.can(site, time, not value) and self.can(site, time, value):
            return self.number[0, site, time] * (1 if value else -1)
        return self.can(site, time, value)

    def clauses(self, ladders: list[Any], groups: list[Any]) -> Iterator[list[int]]:
        for said in (self._moves(), self._sites(ladders), self._groups(groups)):
            for clause in said:
                if not any(literal is True for literal in clause):
                    yield [literal for literal in clause if literal is not False]

    def _moves(self) -> Iterator[list[Literal]]:
        for time, made in self.made.items():
            for move in made:
                no, action = -self.number[1, move, time], move[0]
                for site in action.support - action.free:
                    yield [no, self.is_(site, time - 1, before(move, site))]
                    yield [no, self.is_(site, time, after(move, site))]
                for site in action.free:
                    for value in (True, False):
                        yield [no, self.is_(site, time - 1, not value), self.is_(site, time, value)]
                for p, q in action.guards:
                    yield [no, self.is_(p, time - 1, False), self.is_(q, time - 1, True)]

    def _sites(self, ladders: list[Any]) -> Iterator[list[Literal]]:
        given = {(site, time, kind): n for n, (site, time, kind, _) in enumerate(ladders)}
        need(len(given) == len(ladders), "a ladder twice")
        for time, made in self.made.items():
            roles: dict[tuple[Site, str], list[int]] = defaultdict(list)
            for move in made:
                number, action = self.number[1, move, time], move[0]
                for site in toggled(move):
                    roles[site, "on" if after(move, site) else "off"].append(number)
                for site in action.trace - toggled(move):
                    roles[site, "stay"].append(number)
                for site in action.support - action.trace:
                    roles[site, "read"].append(number)
            for site in self.sites:
                for value, kind in ((True, "on"), (False, "off")):
                    togglers = roles[site, kind]
                    same = self.is_(site, time, not value), self.is_(site, time - 1, value)
                    yield [*same, *togglers]
            for (site, kind), members in roles.items():
                if kind != "read":
                    readers = roles.get((site, "read"), []) if kind == "stay" else []
                    number = given.pop((site, time, kind), -1)
                    yield from self._at_most_one(kind, members, readers, ladders, number)
        need(not given, "a ladder that nothing needs")

    def _at_most_one(
        self, kind: str, members: list[int], readers: list[int], ladders: list[Any], n: int
    ) -> Iterator[list[Literal]]:
        m = len(members)
        if m * (m + len(readers)) <= 36 if kind == "stay" else m <= 6:
            need(n < 0, "a ladder of few")
            yield from ([-one, -other] for one, other in combinations(members, 2))
            yield from ([-one, -reader] for one in members for reader in readers)
            return
        need(n >= 0, "a ladder is missing")
        order = ladders[n][3]
        need(sorted(order) == sorted(members), "a ladder of other moves")
        first = [self.number.get((2, n, step)) for step in range(m + 1)]
        for step, move in enumerate(order, 1):
            one, fewer = first[step], first[step - 1]
            if one is not None:
                yield [-move, one]
            if one is not None and fewer is not None:
                yield [-fewer, one]
            if fewer is not None:
                yield [-fewer, -move]
        yield from ([-reader, -(first[m] or 0)] for reader in readers)

    def _groups(self, groups: list[Any]) -> Iterator[list[Literal]]:
        for kind, sites in groups:
            exactly = kind == "exactly one"
            on = len(sites & self.start)
            need(on == 1 or (on == 0 and not exactly), "a group that the start has not")
            for move in self.window:
                if toggled(move) & sites:
                    g, h = (
                        len(sites & move[0].ends[move[1]]),
                        len(sites & move[0].ends[1 - move[1]]),
                    )
                    fewer = not exactly and (h < g or sites <= move[0].support)
                    need(not sites & move[0].free and h < 2 and (h == g or fewer), "a group broken")
            for time in range(self.rounds + 1):
                some = [self.is_(site, time, True) for site in sites if self.can(site, time, True)]
                if len(some) <= 64:
                    for pair in combinations(some, 2):
                        yield [False if each is True else -each for each in pair]
                if exactly:
                    yield list(some)


class Propagation:
    """Clauses, each with two watched literals, and what they say by unit propagation."""

    def __init__(self) -> None:
        self.watching: dict[int, list[list[int]]] = defaultdict(list)
        self.true: dict[int, bool] = {}
        self.refuted = False

    def add(self, clause: Iterable[int]) -> None:
        found = sorted(set(clause), key=lambda literal: self.true.get(literal) is False)
        open_ = [literal for literal in found if self.true.get(literal) is not False]
        for literal in found[:2] if len(found) > 1 else ():
            self.watching[literal].append(found)
        if not open_:
            self.refuted = True
        elif len(open_) == 1 and open_[0] not in self.true:
            self.refuted |= self.follow(open_)[0]

    def follow(self, literals: Iterable[int]) -> tuple[bool, list[int]]:
        """Make literals true, and all that follows: whether that contradicts itself, and what."""
        trail: list[int] = []

        def says(literal: int) -> bool:
            if literal not in self.true:
                self.true[literal], self.true[-literal] = True, False
                trail.append(literal)
            return self.true[literal]

        if not all(says(literal) for literal in literals):
            return True, trail
        for literal in trail:
            watching = self.watching[-literal]
            self.watching[-literal] = kept = list[list[int]]()
            for at, clause in enumerate(watching):
                if clause[0] == -literal:
                    clause[0], clause[1] = clause[1], clause[0]
                for place in range(2, len(clause)):
                    if self.true.get(clause[place]) is not False:
                        clause[1], clause[place] = clause[place], clause[1]
                        self.watching[clause[1]].append(clause)
                        break
                else:
                    kept.append(clause)
                    if not says(clause[0]):
                        kept += watching[at + 1 :]
                        return True, trail
        return False, trail

    def lemma(self, clause: list[int]) -> None:
        conflict, trail = self.follow([-literal for literal in clause])
        need(conflict, "a lemma that does not follow")
        for literal in trail:
            del self.true[literal], self.true[-literal]
        self.add(clause)

    def check(self, log: bytes, variables: int) -> None:
        """Follow a log until it refutes the clauses."""
        at = 0
        while not self.refuted:
            need(at < len(log), "the log ends")
            kind, at = log[at : at + 1], at + 1
            need(kind in (b"a", b"d"), "neither a lemma nor a deletion")
            clause: list[int] = []
            while True:
                literal = shift = 0
                while True:
                    need(at < len(log), "the log ends within a lemma")
                    literal |= (log[at] & 127) << shift
                    shift, at = shift + 7, at + 1
                    if log[at - 1] < 128:
                        break
                if not literal:
                    break
                need(2 <= literal < 2 * variables + 2, "a literal of no variable")
                clause.append(-(literal >> 1) if literal & 1 else literal >> 1)
            if kind == b"a":
                self.lemma(clause)


def check(data: bytes) -> Found:
    """Return what a proof file proves; RefusedError for what does not hold."""
    blocks, log = blocks_of(data)
    rows = blocks.pop("variables")
    try:
        read = {name: json.loads(content) for name, content in blocks.items()}
        said = read["statement"]
        need(said.keys() == STATEMENT, "another statement")
        need(said["standing"] == "proved", "another standing")
        system = None if said["system"] is None else System(said["system"])
        start, goal = sites_of(said["start"]), sites_of(said["goal"])
        actions = [system.action(*each) if system else listed(each) for each in read["moves"]]
        sites = sites_of(read["sites"])
        rounds, cubes = said["refuted"], said["cubes"]
        for each in (start, goal, sites, actions):
            need(len(set(each)) == len(each), "the same twice")
        numbers = [n for cube in read["schedule"] for n in cube]
        numbers += [n for _, group in read["groups"] for n in group]
        numbers += [n for site, time, _, members in read["ladders"] for n in (site, time, *members)]
        need(all(type(n) is int and n >= 0 for n in (rounds, cubes, *numbers)), "no number")
        ladders = [(sites[site], time, kind, each) for site, time, kind, each in read["ladders"]]
        groups = [(kind, frozenset(sites[n] for n in each)) for kind, each in read["groups"]]
        need(all(len(set(each)) == len(each) for _, each in read["groups"]), "a site twice")
        need(all(kind in ("at most one", "exactly one") for kind, _ in groups), "a kind of group")
        schedule = [[actions[n] for n in cube] for cube in read["schedule"]]
        directed = [(action, end) for action in actions for end in (0, 1)]
        told = list(struct.iter_unpack("<3I", rows))
        things = sites, directed, range(len(ladders))
        meant = [(kind, things[kind][index], time) for kind, index, time in told]
    except (ValueError, TypeError, LookupError, AttributeError, struct.error) as error:
        raise RefusedError(f"malformed: {error!r}") from None
    ends = frozenset(start), frozenset(goal)
    check_schedule(schedule, *ends)
    need(len(schedule) == cubes > rounds, "another number of cubes")
    if system is not None:
        system.check_obstacles(*ends)
        actions = list(system.moves_near(*ends, rounds))
    claim = Claim(actions, *ends, rounds)
    if claim.refuted:
        need(not (rows or ladders or groups or log), "what nothing needs")
        return Found(rounds, cubes, 0, 0)
    claim.take_variables(meant, ladders)
    clauses = list(claim.clauses(ladders, groups))
    propagation = Propagation()
    for clause in clauses:
        propagation.add(clause)
    propagation.check(log, len(told))
    return Found(rounds, cubes, len(told), len(clauses))


def check_schedule(schedule: list[list[Action]], state: State, goal: State) -> None:
    for cube in schedule:
        pairs = combinations(cube, 2)
        need(not any(a.trace & b.support or b.trace & a.support for a, b in pairs), "no cube")
        for action in cube:
            shown = (state & action.support) - action.free
            need(shown in action.ends, "a move that is not admissible")
            need(all(p not in state or q in state for p, q in action.guards), "a guard")
            state ^= action.ends[0] ^ action.ends[1]
    need(state == goal, "the schedule ends elsewhere")
