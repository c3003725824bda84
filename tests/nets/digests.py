"""Results of the library through its three faces, for scenes of all families, by name.

    python tests/nets/digests.py take digests.gz
    python tests/nets/digests.py compare old.gz new.gz --words words.json

Some minutes on one core and 10 MB. A name begins with what it is about, and ends with a seed. Walks
and actions are drawn here, so only results of rules (`placed`, `rule`, `many`, `freely`, `proof`),
of schedulers (`free`) and of scenes with a seed can change when the library draws its random
numbers otherwise. Keys are words of this file; only what the library itself names can need a table.
What searches take from a clock is ample, so that none is stopped by it.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cache, partial
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import numpy as np
from words import compared, parser, plain, text_of, write

import cubepath.agents as agents  # noqa: PLR0402 - pyright sees no other
import cubepath.coordinator as coordinator  # noqa: PLR0402 - pyright sees no other
import cubepath.protocol as protocol  # noqa: PLR0402 - pyright sees no other
from cubepath.agents.environments.free_environment import FreeEnv
from cubepath.coordinator.normal_form.definitions import is_normal
from cubepath.coordinator.normal_form.timetable import durations_of
from cubepath.coordinator.theory.complexes.collapses import contractibility
from cubepath.coordinator.theory.complexes.links import actions_at, unfilled
from cubepath.coordinator.theory.following.optimum import fewest_rounds
from cubepath.coordinator.theory.paper.claims import all_claims, compute_claims
from cubepath.coordinator.theory.search.transitions import Transitions
from cubepath.protocol import Action, InputError, PathMove, Scene, Site
from cubepath.protocol.core.actions import why_inadmissible
from cubepath.protocol.core.sites import in_order
from cubepath.protocol.file_forms import PlanHints
from cubepath.protocol.path_files.certificates import write_certificate
from cubepath.protocol.path_files.durations import Durations
from cubepath.protocol.scenes.toml import scene_from_toml

ROOT = Path(__file__).resolve().parents[2]
SCENES = {
    "hex": "n=4 n=7 n=5,bend=60 n=5,bend=0 n=6,bend=-120,base=1",
    "hex-open": "n=4 n=6,bend=60 n=3,bend=0,shift=2",
    "hex-connected": "n=4 n=5",
    "hex-tunnel": "n=3 n=4,catalogue=1 n=3,length=7,catalogue=2",
    "sliding": "- p=1,q=1,n=3 p=3,q=1,n=4,k=2",
    "hex-shapes": "n=5,seed=1 n=6,seed=4,how=growth n=5,seed=2,catalogue=2,walk=20",
    "sliding-shapes": "n=5,seed=1 n=6,seed=3,density=0.2,how=growth n=5,k=2,walk=15",
    "agv": (
        "graph=grid4x4,n=4 graph=K5,n=2 graph=C8,n=3 graph=tree20,n=5,seed=3 "
        "graph=gnp20x0.2,n=6,seed=2 graph=regular20x3,n=4,seed=5,walk=30"
    ),
    "agv-labelled": "graph=grid3x3,n=3 graph=K5,n=3 graph=S4,n=2,seed=2 graph=P9,n=3",
    "arm": "n=5 n=6,goal=xyxxyx",
    "arm-free": "n=4 start=uurr,goal=rruu start=deadlock",
    "arms": "- n=2,m=2,d=4 n=1,m=3",
    "polygon": "n=6 n=8,goal=2",
    "triangulation": "n=7,seed=1 n=9,seed=3,start=left,goal=up n=12,seed=2,walk=25",
    "words": (
        "- presentation=raag presentation=free2 word=aabbcc,relations=ab~ba+bc~cb+ac~ca,goal=ccbbaa"
    ),
    "assembly": "- kind=wall,n=2 kind=tree,n=3,until=placed",
}
"""Keys of scenes by family, each of them one word; a dash is the default scene."""
PROVED = ("agv:graph=C5,n=2", "hex:n=4", "polygon:n=7", "arm:n=5", "words", "sliding:p=1,q=1,n=3")
RULES = ("random", "chain", "tswap", "pibt", "word")
SEEDS = (0, 1, 2)
STATES_MAX = 3_000
LATTICES = ("hex", "sliding", "arm:", "arm-")
PLANS = {
    "": "agv/cgshop2021-algae.json agv/grid8-12agents.json agv/random-32-32-10-30agents.json",
    "room.map": "imports/eecbs.txt imports/lacam.txt imports/lns2.txt imports/paths.json",
    "kite.instance.json": "imports/kite.solution.json",
    "train.instance.json": "imports/train.solution.json",
    "hex:n=3": "imports/pivots.txt",
    "sliding:p=3,q=1,n=3": "imports/slides.txt",
}
"""Files by the file that comes with them, or by their system."""

Task = tuple[str, Callable[[], Any]]


@cache
def scene_of(spec: str) -> Scene:
    return protocol.scene_from_spec(spec)


def states(found: Iterable[Iterable[Site]]) -> list[Any]:
    return [plain(in_order(state)) for state in found]


@cache
def walk(spec: str, seed: int) -> tuple[list[Action], list[frozenset[Site]]]:
    """Return a random path that turns back here and there, and its states."""
    random, scene = Random(f"{spec}/{seed}"), scene_of(spec)  # noqa: S311 - not for secrets
    path, passed = list[Action](), [frozenset(scene.start_state)]
    while len(path) < 30 and (possible := actions_at(scene, passed[-1])):
        turns = bool(path) and random.random() < 0.2
        path.append(path[-1] if turns else random.choice(possible))
        passed.append(protocol.apply(path[-1], passed[-1]))
    return path, passed


def scene_(spec: str) -> Any:
    scene = scene_of(spec)
    system = scene.system
    moves = [
        None if move is None else [move.generator, plain(move.at), plain(move.action)]
        for site in scene.start
        for move in system.moves(site)
    ]
    places = [system.place_of(site) for site in scene.start]
    return {
        "family": scene.family,
        "table": plain(system.to_table()),
        "again": scene_from_toml(protocol.scene_to_toml(scene), spec).start == scene.start,
        "start": plain(scene.start),
        "state": states([scene.start_state]),
        "goal": None if scene.goal is None else states([scene.goal]),
        "goals": plain(scene.goals),
        "text": agents.draw_text(scene, scene.start).splitlines(),
        "moves": moves,
        "around": [plain([system.sensed(place), system.reach(place)]) for place in places],
    }


def walk_(spec: str, seed: int) -> Any:
    path, passed = walk(spec, seed)
    scene = scene_of(spec)
    return {
        "states": states(passed),
        "admissible": [plain(actions_at(scene, state)) for state in passed[::3]],
        "unfilled": plain(unfilled(scene, passed[-1])),
        "commute": "".join(str(int(protocol.commute(a, b))) for a in path for b in path[:9]),
        "why": [why_inadmissible(action, passed[0]) for action in path],
    }


def shortened(found: coordinator.Shortened) -> Any:
    bound = found.bound
    return {
        "numbers": [found.moves, found.reduced_moves, found.cubes, found.max_cube_dimension],
        "rounds": found.planner_rounds,
        "bound": [bound.cubes, bound.why],
        "cubes": plain(found.cube_path),
        "names": plain(found.named),
        "document": document(found.document()),
    }


def document(found: dict[str, Any]) -> Any:
    """Return a document without what clocks and folders say."""
    left_out = ("seconds", "spent", "proof")
    return {key: plain(each) for key, each in found.items() if key not in left_out}


def lines(path: Path) -> list[Any]:
    return [msgspec.json.decode(line) for line in path.read_bytes().splitlines()]


def path_(spec: str, seed: int) -> Any:
    path, passed = walk(spec, seed)
    cubes = coordinator.normal_cube_path(path)
    proof = coordinator.certificate_of(path, start=passed[0])
    left = [action for cube in cubes for action in cube]
    durations = [Fraction(1 + number * 7 % 5, 2) for number in range(len(left))]
    changed = (*proof.cubes[1:], *proof.cubes[:1])
    with tempfile.TemporaryDirectory() as folder:
        certificate = Path(folder, "path.certificate")
        write_certificate(certificate, proof)
        written = lines(certificate)
    return {
        "cubes": plain(cubes),
        "normal": [is_normal(cubes), is_normal([[a] for a in path])],
        "end": states([coordinator.end_state(cubes, passed[0])]),
        "certificate": plain(proof),
        "file": written,
        "proved": plain(coordinator.check_proof(path, proof.cancelled, proof.cubes, proof.chain)),
        "disproved": plain(coordinator.check_proof(path, proof.cancelled, changed, proof.chain)),
        "checked": plain(coordinator.check_certificate(proof, path, passed[0])),
        "back": plain(coordinator.normal_cube_path([*path, *reversed(path[5:])])),
        "timetable": plain(coordinator.earliest(left, durations)),
    }


def of_file(moves: Sequence[PathMove], spec: str | None) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        given, cubes = Path(folder, "moves.jsonl"), Path(folder, "cubes.jsonl")
        protocol.write_moves(given, moves)
        found = coordinator.shorten(given, system=spec)
        protocol.write_cubes(cubes, found.named)
        read = protocol.read_moves(given, None if spec is None else scene_of(spec))
        durations = durations_of(moves, Durations(Fraction(3, 2), {}, {}))
        return {
            "file": lines(given),
            "read": plain([each.action for each in read]),
            "shortened": shortened(found),
            "cubes": lines(cubes),
            "timed": plain(coordinator.earliest([each.action for each in moves], durations)),
        }


def listed_(spec: str, seed: int) -> Any:
    """A walk by way of a file that needs no system."""
    path, passed = walk(spec, seed)
    moves = enumerate(zip(path, passed, strict=False))
    return of_file([PathMove(a, f"move {n}", state & a.support) for n, (a, state) in moves], None)


def placed_(spec: str, seed: int) -> Any:
    """A run by way of a file of generators and places, and without a file."""
    played = agents.play(scene_of(spec), "random", seed=seed, max_rounds=12)
    state, moves = frozenset(scene_of(spec).start_state), list[PathMove]()
    for action, name in zip(played.path, played.placed, strict=True):
        moves.append(PathMove(action, name, state & action.support))
        state = protocol.apply(action, state)
    return {"played": shortened(coordinator.shorten(played)), "file": of_file(moves, spec)}


def complex_(spec: str) -> Any:
    explored = coordinator.explore(scene_of(spec), max_states=STATES_MAX)
    if not explored.complete:
        return states(explored.state(number) for number in range(len(explored.states)))
    built = coordinator.state_complex(explored)
    found = built.complex
    groups = coordinator.homology(found)
    links, left = coordinator.check_links(found), coordinator.collapse(found)
    return {
        "states": states(explored.state(number) for number in range(len(explored.states))),
        "edges": plain([explored.starts, explored.actions, explored.targets]),
        "f-vector": [plain(coordinator.f_vector(explored)), plain(found.f_vector)],
        "euler": int(found.euler),
        "faces": plain(found.faces),
        "cubes": plain([built.bases, built.actions]),
        "homology": plain([groups.betti, groups.torsion, groups.betti_z2, groups.critical]),
        "contractible": contractibility(found, groups),
        "links": [links.checked, links.failures, links.npc, plain(links.failing)],
        "collapse": plain([left.left, left.steps]),
        "surface": coordinator.surface(found).name,
    }


def shapes_(spec: str) -> Any:
    found = coordinator.shape_complex(scene_of(spec), max_states=STATES_MAX)
    return {
        "shapes": plain(found.shapes),
        "f-vector": plain(found.complex.f_vector),
        "faces": plain(found.complex.faces),
        "cubes": plain(found.cubes),
        "betti": plain(coordinator.homology(found.complex).betti),
    }


def search_(spec: str, seed: int) -> Any:
    path, passed = walk(spec, seed)
    scene, start, end = scene_of(spec), passed[0], passed[-1]
    better = coordinator.improve(path, start, scene.system, iterations=60, seed=seed)
    steps = Transitions(scene.system)
    exact = coordinator.optimum(steps, steps.encode(start), steps.encode(end), max_states=2000)
    cubes = [[steps.actions[number] for number in cube] for cube in exact.cubes or ()]
    return {
        "improved": [plain(better.cube_path), better.steps, better.found, better.cubes],
        "bound": plain(coordinator.lower_bound(scene.system, start, end, within=len(path))),
        "optimum": [exact.at_least, exact.states, exact.cubes is None, plain(cubes)],
        "one class": coordinator.only_class(steps, start),
    }


def proof_(spec: str) -> Any:
    """What is beyond the class of a run, with the proof, which is checked."""
    found = coordinator.shorten(agents.play(scene_of(spec), "random", seed=1, max_rounds=8))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "found.proof")
        better = coordinator.beyond(
            coordinator.task_of(found), found, iterations=40, prove=600, proof=path, max_states=2000
        )
        proofs = [protocol.read_proof(path)] if path.exists() else []
    return {
        "cubes": [found.cubes, better.improved, better.lower_bound, better.agreed],
        "optimal": [better.optimal, better.only_class, better.why],
        "path": plain(better.cube_path),
        "names": plain(better.named),
        "document": document(better.document()),
        "proof": plain(map(coordinator.check_optimality, proofs)),
    }


def given_with(name: str) -> tuple[Path, str | None, PlanHints]:
    """Return a plan's file, its system and its companions."""
    path = ROOT / "tests/data" / name
    more = next(key for key, names in PLANS.items() if name in names)
    form = "cgshop2026:triangulation=1" if "kite" in name else None
    companions = (path.parent / more,) if (path.parent / more).is_file() else ()
    system = more if "=" in more else None
    return path, system, PlanHints(format=form, companions=companions)


def plan_(name: str) -> Any:
    path, system, hints = given_with(name)
    found = coordinator.shorten(path, system=system, hints=hints)
    read = protocol.read_plan(path, hints.format, companions=hints.companions, system=system)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder, "moves.jsonl")
        converted = coordinator.convert(path, target, system=system, hints=hints)
        written = lines(target)
    return {
        "shortened": shortened(found),
        "plan": [plain(read.rounds), read.labelled_goals, plain(read.moves)],
        "converted": [converted.what, converted.count, written],
    }


def following_(name: str, rule: Any) -> Any:
    plan = coordinator.read_vehicle_plan(*given_with(name))
    found = coordinator.following_timetable(plan, rule)
    written = coordinator.timetable_file(found)
    fewest: Any = None
    if len(plan.starts) < 13:
        within = min(plan.rounds or 99, int(found.makespan))
        best = fewest_rounds(plan, rule, within=within, seconds=600)
        fewest = [
            best.rounds,
            best.lower_bound,
            best.agreed,
            best.ended,
            best.optimal,
            plain(best.timetable),
        ]
    return {
        "plan": plain([plan.starts, plan.ends, plan.moves, plan.rounds, plan.called]),
        "timetable": plain([found.cancelled, found.steps, found.starts, found.binding]),
        "numbers": plain([found.makespan, found.rotates, found.rotations, found.chain]),
        "file": plain(written),
        "checked": plain(coordinator.check_following(written, plan)),
        "fewest": fewest,
    }


def paper_() -> Any:
    rows = compute_claims(all_claims())
    return [document(row.document()) | {"expected": row.as_expected} for row in rows]


def drawn(random: Random, mask: Any) -> int:
    return int(random.choice(np.asarray(mask).nonzero()[0].tolist()))


def environment_(spec: str, seed: int, showing: Any) -> Any:
    random = Random(f"{spec}/{seed}/environment")  # noqa: S311 - not for secrets
    env = agents.parallel_env(spec, observation=showing, note_length=seed, max_cycles=8)
    seen, infos = env.reset(seed=seed)
    happened = [plain([seen, infos])]
    while env.agents:
        actions = {each: drawn(random, seen[each]["action_mask"]) for each in env.agents}
        seen, *rest = env.step(actions)
        happened.append(plain([actions, seen, *rest, env.state(), env.sites]))
    env.close()
    return happened


def vector_(spec: str, showing: Any) -> Any:
    random = Random(f"{spec}/vector")  # noqa: S311 - not for secrets
    env = agents.vector_env(spec, num_envs=3, observation=showing, max_cycles=6)
    seen, infos = env.reset(seed=5)
    happened = [plain([seen, infos])]
    for _ in range(9):
        masks = np.asarray(seen["action_mask"])
        actions = np.zeros(masks.shape[:2], np.int64)
        for place in np.ndindex(*actions.shape):
            actions[place] = drawn(random, masks[place])
        seen, *rest = env.step(actions)
        happened.append(plain([actions, seen, *rest, [env.sites(number) for number in range(3)]]))
    env.close()
    return happened


def free_(spec: str, scheduler: str) -> Any:
    random = Random(f"{spec}/free")  # noqa: S311 - not for secrets
    env = FreeEnv(spec, scheduler=scheduler, max_cycles=10, note_length=1, lag=3)
    env.reset(seed=2)
    happened = list[Any]()
    while not any([*env.truncations.values(), *env.terminations.values()]) and len(happened) < 60:
        who = env.agent_selection
        seen = env.observe(who)
        action = drawn(random, seen["action_mask"])
        env.act(agents.Choice(action, (len(happened),)))
        happened.append(
            plain([who, action, seen, env.rewards, env.infos[who], env.sites, env.time])
        )
    return happened


def rounds_of(found: Sequence[Any]) -> list[Any]:
    return [
        [
            each.number,
            [
                [who, move.generator, plain(move.at), plain(move.target)]
                for who, move in each.moves.items()
            ],
            plain(each.lost),
        ]
        for each in found
    ]


def rule_(spec: str, rule: str, seed: int) -> Any:
    most = 25 if rule == "random" else 150
    found = agents.play(scene_of(spec), rule, seed=seed, hesitate=seed / 10, max_rounds=most)
    return [rounds_of(found.rounds), plain(found.sites), found.reached, plain(found.failed)]


def many_(spec: str, rule: str) -> Any:
    most = 25 if rule == "random" else 150
    found = agents.play_many(
        scene_of(spec), rule, range(6), hesitate=0.1, max_rounds=most, keep_rounds=True
    )
    arrays = [found.rounds, found.reached, found.moves, found.lost, found.failed, found.sites]
    return [plain(arrays), [rounds_of(each) for each in found.played or ()]]


def freely_(spec: str, rule: str, seed: int) -> Any:
    chosen = agents.rule_named(rule, scene_of(spec).system, "free")
    found = agents.play_free(
        scene_of(spec), chosen, seed=seed, hesitate=seed / 10, lag=2 * seed, max_cycles=60
    )
    ends = [found.turns, found.refused, found.sites, found.reached, found.failed, found.time]
    return [plain(found.commits), plain(ends)]


def recording_(path: Path) -> Any:
    recording = protocol.read_recording(path)
    return {
        "verify": document(coordinator.verify(recording).document()),
        "audit": document(coordinator.audit(recording).document()),
        "messages": [
            [each.topic, plain(each.data), each.round, each.sequence] for each in recording.records
        ],
        "shortened": shortened(coordinator.shorten(path)),
        "problems": plain(recording.problems),
    }


def rules_of(spec: str, clock: str) -> Iterator[str]:
    for rule in RULES:
        try:
            agents.rule_named(rule, scene_of(spec).system, clock)
        except InputError:
            continue
        yield rule


def of_scene(spec: str) -> Iterator[Task]:
    yield f"scene {spec}", partial(scene_, spec)
    yield f"complex {spec}", partial(complex_, spec)
    if spec.startswith(LATTICES):
        yield f"shapes {spec}", partial(shapes_, spec)
    for seed in SEEDS:
        for kind, of_seed in (
            ("walk", walk_),
            ("path", path_),
            ("listed", listed_),
            ("placed", placed_),
            ("search", search_),
        ):
            yield f"{kind} {spec} {seed}", partial(of_seed, spec, seed)
    for seed, showing in enumerate(("absolute", "relative")):
        yield f"environment {spec} {showing}", partial(environment_, spec, seed, showing)
        yield f"vector {spec} {showing}", partial(vector_, spec, showing)
    for scheduler in ("random", "unfair", "turns"):
        yield f"free {spec} {scheduler}", partial(free_, spec, scheduler)


def of_rules(spec: str) -> Iterator[Task]:
    for rule in rules_of(spec, "lockstep"):
        yield f"many {spec} {rule}", partial(many_, spec, rule)
        for seed in SEEDS:
            yield f"rule {spec} {rule} {seed}", partial(rule_, spec, rule, seed)
    for rule in rules_of(spec, "free"):
        for seed in SEEDS:
            yield f"freely {spec} {rule} {seed}", partial(freely_, spec, rule, seed)


def tasks() -> Iterator[Task]:
    """Yield what is taken, by its name; each is independent of what came before."""
    for family, keys in SCENES.items():
        for each in keys.split():
            spec = family if each == "-" else f"{family}:{each}"
            yield from of_scene(spec)
            yield from of_rules(spec)
    for spec in PROVED:
        yield f"proof {spec}", partial(proof_, spec)
    for name in " ".join(PLANS.values()).split():
        yield f"plan {name}", partial(plan_, name)
        for rule in ("mapf", "cgshop"):
            yield f"following {name} {rule}", partial(following_, name, rule)
    yield "paper", paper_
    for path in sorted((ROOT / "logs/golden").glob("*.mcap")):
        yield f"recording {path.stem}", partial(recording_, path)


def taken(began: float, only: Sequence[str]) -> Iterator[tuple[str, bytes]]:
    """Yield each name with its canonical text; a refusal is a result as well."""
    spent: dict[str, float] = {}
    for name, task in tasks():
        if only and name.partition(" ")[0] not in only:
            continue
        start = time.monotonic()
        try:
            found = task()
        except protocol.CubepathError as error:
            found = {
                "refused": isinstance(error, InputError),
                "text": str(error).replace(str(ROOT), ""),
            }
        yield name, text_of(found)
        kind = name.partition(" ")[0]
        spent[kind] = spent.get(kind, 0) + time.monotonic() - start
    shown = ", ".join(f"{kind} {seconds:.1f}" for kind, seconds in spent.items())
    print(f"{time.monotonic() - began:.0f} s: {shown}")


def main() -> int:
    """Take digests, or compare them."""
    found, take = parser(__doc__)
    take.add_argument("--only", nargs="+", default=(), metavar="KIND", help="such as walk or rule")
    asked = found.parse_args()
    if asked.command == "compare":
        return compared(asked)
    count = write(asked.file, taken(time.monotonic(), asked.only))
    print(f"{count} results, {asked.file.stat().st_size / 1e6:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
