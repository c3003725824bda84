"""Many environments of one scene as arrays: reset, observe, step.

A batch holds what changes in each environment, including its seed; what never changes, `Tables`, is
shared. Relative observations equal those of `RelativeObserver` bit for bit.

Loading the compiled code takes about a second, and compiling it a quarter of a minute, once per
installation. Small work runs without it. Large work waits for the compiler, which runs in a
separate process while the plain world steps in.
"""

import atexit
import os
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cubepath.agents.arrays import lattice_tables, rounds
from cubepath.agents.arrays.lattice_tables import LatticeTables
from cubepath.agents.arrays.observing import SILENT, BatchState, ObservationArrays
from cubepath.agents.arrays.rounds import STAYED, Scratch, play_round
from cubepath.agents.arrays.tables import GrowingArray, Ints, Tables
from cubepath.agents.local.arbitration import RANK
from cubepath.agents.local.observation import Note, observation_length
from cubepath.agents.local.random_streams import seed_key
from cubepath.agents.local.relative import relative_layout, relative_observer
from cubepath.protocol.compiled import Compiled, allowance
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import FIRST_LABEL, MODULE, Scene

PLACES_MAX = 1 << 16
"""This many places may have numbers before those that were left behind are forgotten..."""
PLACES_GROWTH = 8
"""...or this many times as many as when numbers were last given."""


def tables_of(scene: Scene, *, notes: bool) -> Tables:
    """Return the tables of a scene; `UntabledError` if its system does not fit into tables."""
    make = Tables if scene.system.catalogue is None else LatticeTables
    return make(scene, notes=notes)


class Batch:
    """Environments of one scene that are stepped together; each has its own seed and round.

    `observed` are the arrays that `observe` and `step` write, the same objects each time: what the
    `ObservationArrays` documents. They are for reading: nothing is read back from them.
    """

    def __init__(self, scene: Scene, environments: int = 1, *, note_length: int = 0) -> None:
        """Make the arrays; `reset` has to follow. `UntabledError` if the system does not fit."""
        system, modules = scene.system, len(scene.start)
        self.scene = scene
        self.environments, self.modules = environments, modules
        self.note_length = note_length
        self._tables = tables_of(scene, notes=note_length > 0)
        shape = environments, modules
        self.forgotten = 0
        """How often places got new numbers; those that were asked for before hold no more."""
        self._start = self._stand_at(scene.start)
        self._place, self._code = np.zeros((2, *shape), np.int32)
        self._bits = np.zeros((*shape, self._tables.words), np.uint64)
        self._at_goal, self.round = np.zeros((2, environments), np.int64)
        self.notes = np.zeros((*shape, note_length), np.int32)
        self._shown = np.zeros((environments, 0), np.int32)
        self._module = np.zeros((environments, 0), np.int32)
        self._key = np.zeros(environments, np.uint64)
        self._everyone = np.ones(environments, np.uint8)
        self._idle = np.zeros(shape, np.int64)
        self.outcomes = np.full(shape, STAYED, np.int8)
        reach = system.reach_slots if note_length else 1
        self.observed = ObservationArrays(
            np.zeros((*shape, observation_length(system)), np.int32),
            np.zeros((*shape, system.move_slots + 1), np.int8),
            np.full((*shape, reach, note_length), SILENT, np.int32),
        )
        self._items = 0
        self._known = 0
        self._needed = self._tables.count
        self._scratch: Scratch | None = None
        self._follow()

    def _follow(self) -> None:
        """Make the arrays as large as the tables have become."""
        tables = self._tables
        room = len(tables.places.background)
        if self._shown.shape[1] < room:
            known = self._shown.shape[1]
            shown, module = np.zeros((2, self.environments, room), np.int32)
            shown[:, :known] = self._shown
            module[:, :known] = self._module
            module[:, known:] = -1
            self._shown, self._module = shown, module
        if self._known < tables.count:
            background = tables.places.background[self._known : tables.count]
            self._shown[:, self._known : tables.count] = background
            self._known = tables.count
        if self._bits.shape[2] != tables.words:
            self._bits = np.zeros((*self._bits.shape[:2], tables.words), np.uint64)
        arrays = tables.kinds.arrays
        most = max(1, int(np.diff(arrays.items_at).max(initial=0)))
        motions = max(1, int(np.diff(arrays.motion_at).max(initial=0)))
        scratch, modules = self._scratch, self.modules
        if (
            scratch is None
            or len(scratch.head) < room
            or self._items < most
            or len(scratch.movers) < motions
        ):
            self._items = most
            items = np.zeros((4, modules * most), np.int32)
            self._scratch = Scratch(
                head=np.full(room, -1, np.int32),
                claim=items[0],
                code=items[1],
                following=items[2],
                place=items[3],
                claimant=np.zeros(modules, np.int32),
                move=np.zeros(modules, np.int32),
                first=np.zeros(modules, np.int32),
                granted=np.zeros(modules, np.uint8),
                waiting=np.zeros(modules, np.int32),
                stack=np.zeros(modules, np.int32),
                rivals=np.zeros((4 * modules, 4), np.int32),
                rank=np.zeros(modules, np.uint64),
                movers=np.zeros(motions, np.int32),
                fresh=np.zeros(self.environments * modules, np.int32),
            )

        self._plain = (
            tuple(tables.places),
            tuple(tables.goals),
            tables.knower,
            tuple(tables.stands),
            tuple(tables.kinds.arrays),
            tuple(self._state),
            tuple(self._scratch or ()),
            tuple(self.observed),
        )

    def _forget(self) -> None:
        """Number only the places where modules are, and the goals, and what is around them."""
        standing = [self.sites(environment) for environment in range(self.environments)]
        self._tables = tables_of(self.scene, notes=self.note_length > 0)
        self.forgotten += 1
        self._shown = np.zeros((self.environments, 0), np.int32)
        self._module = np.zeros((self.environments, 0), np.int32)
        self._scratch = None
        self._known = 0
        self._start = self._stand_at(self.scene.start)
        found = [self._stand_at(sites) for sites in standing]
        self._needed = self._tables.count
        self._follow()
        for environment, (places, codes) in enumerate(found):
            self._set(np.array([environment]), places, codes)

    def _stand_at(self, sites: Sequence[Site]) -> tuple[Ints, Ints]:
        """Return the places and codes of modules at these sites, with their stands worked out."""
        system, tables = self.scene.system, self._tables
        places = np.array(tables.numbers(map(system.place_of, sites)), np.int32)
        codes = np.array([system.code_of(site) for site in sites], np.int32)
        tables.prepare(places, codes)
        return places, codes

    @property
    def _state(self) -> BatchState:
        return BatchState(
            self._place,
            self._code,
            self._shown,
            self._module,
            self._bits,
            self._at_goal,
            self.round,
            self._key,
            self.notes,
        )

    def reset(self, seeds: Sequence[int], chosen: Sequence[int] | None = None) -> None:
        """Put the chosen environments (by default all) at the start, with a seed for each."""
        which = list(range(self.environments)) if chosen is None else list(chosen)
        at = np.array(which, np.intp)
        self._key[at] = np.array([seed_key(seed, RANK) for seed in seeds], np.uint64)
        self._set(at, *self._start)
        self.round[at] = 0
        self.notes[at] = 0

    def observe(self) -> ObservationArrays:
        """Write what all modules observe; return it. It has to follow a `reset`."""
        self._play(self._idle, self._everyone, only_observe=True)
        return self.observed

    def _play(
        self, actions: NDArray[np.int64], live: NDArray[np.uint8], *, only_observe: bool
    ) -> int:
        return play_round(
            *self._plain[:5],
            self._tables.codes,
            self._plain[5],
            actions,
            live,
            self._plain[6],
            self.outcomes,
            self._plain[7],
            only_observe,
        )

    def step(
        self,
        actions: NDArray[np.int64],
        *,
        spoken: tuple[NDArray[np.bool_], Ints] | None = None,
        live: NDArray[np.uint8] | None = None,
    ) -> NDArray[np.int8]:
        """Play one round in every live environment and observe; return the result of each action.

        `actions` has shape (environments, modules). `spoken` says which modules speak, shape
        (environments, modules), and their notes. Actions are held against what was observed last.
        """
        tables = self._tables
        if spoken is not None and self.note_length:
            speaks, notes = spoken
            self.notes[speaks] = notes[speaks]
        live = self._everyone if live is None else live
        fresh = self._play(actions, live, only_observe=False)
        if fresh and self._scratch is not None:
            new = self._scratch.fresh[:fresh]
            tables.prepare(self._place.ravel()[new], self._code.ravel()[new])
            if tables.count > max(PLACES_MAX, PLACES_GROWTH * self._needed):
                self._forget()
            self._follow()
            self.observe()
        return self.outcomes

    @property
    def at_goal(self) -> NDArray[np.int64]:
        """Return how many modules of each environment are on sites of the goal."""
        return self._at_goal

    @property
    def reached(self) -> NDArray[np.bool_]:
        """Return which environments are at the goal; none if there is no goal."""
        if self.scene.goal is None:
            return np.zeros(self.environments, np.bool_)
        return np.asarray(self._at_goal == self.modules)

    def sites(self, environment: int = 0) -> list[Site]:
        """Return the site of each module of an environment, by number."""
        site = self._tables.site
        places, codes = self._place[environment], self._code[environment]
        return [site(*pair) for pair in zip(places.tolist(), codes.tolist(), strict=True)]

    def standings(self) -> tuple[Ints, Ints]:
        """Return the numbers of the modules' places, and what they show.

        Both have shape (environments, modules).
        """
        return self._place.copy(), self._code.copy()

    @property
    def tables(self) -> Tables:
        """Return the tables that have the numbers of `standings`, now."""
        return self._tables

    def stands(self) -> NDArray[np.intp]:
        """Return the number of the stand of each module, shape (environments, modules)."""
        codes = self._tables.codes
        found = self._place.astype(np.intp) * codes
        return found + self._code if codes > 1 else found

    def site_of(self, stand: int) -> Site:
        """Return the site of a stand; in a labelled system, with the least label."""
        place, code = divmod(stand, self._tables.codes)
        if self._tables.codes > 1:
            return self._tables.site(place, code)
        return self._tables.site(place, MODULE if self.scene.system.labels is None else FIRST_LABEL)

    def put(
        self, environment: int, sites: Sequence[Site], round_number: int, notes: Sequence[Note]
    ) -> None:
        """Put the modules of an environment at these sites after a round, with their last notes.

        An `observe` has to follow.
        """
        places, codes = self._stand_at(sites)
        self._follow()
        self._set(np.array([environment]), places, codes)
        self.round[environment] = round_number
        if self.note_length:
            self.notes[environment] = notes

    def _set(self, environments: NDArray[np.intp], places: Ints, codes: Ints) -> None:
        tables, rows = self._tables, environments[:, None]
        self._shown[environments, : tables.count] = tables.places.background[: tables.count]
        self._module[environments] = -1
        self._place[environments], self._code[environments] = places, codes
        self._shown[rows, places] = codes
        self._module[rows, places] = np.arange(self.modules, dtype=np.int32)
        self._at_goal[environments] = int((tables.places.final[places] == codes).sum())


Floats = NDArray[np.float32]


class RelativeArrays:
    """Makes the relative observations of a batch; `array` is overwritten each time."""

    def __init__(self, batch: Batch) -> None:
        """Take in what modules know from the start."""
        scene = batch.scene
        system = scene.system
        self._batch, self._system = batch, system
        self.layout = relative_layout(system)
        goals = scene.goals or ((),) * len(scene.start)
        found = [relative_observer(system, each) for each in goals]
        distinct = list({id(each): each for each in found}.values())
        number = {id(each): place for place, each in enumerate(distinct)}
        self._kept = distinct  # observers are shared only while somebody has them
        self._modules_here = np.array([number[id(each)] for each in found], np.intp)
        aims = np.zeros((len(distinct), system.dimension))
        for place, each in enumerate(distinct):
            aims[place] = each.total or 0.0
        self._totals = aims[self._modules_here]
        self._counts = np.array([len(each) for each in goals], np.float64)[:, None]
        hops = [each.hops for each in distinct if each.hops is not None]
        self._hops = np.stack(hops) if hops else None
        self._forgotten = batch.forgotten
        self._stands = self._no_stands()
        self.array: Floats = np.zeros(
            (batch.environments, batch.modules, self.layout.length), np.float32
        )

    def _no_stands(self) -> tuple[GrowingArray, ...]:
        kind = self.layout.parts["kind"]
        system = self._system
        return (
            GrowingArray(0, np.bool_),
            GrowingArray(0, np.float64, system.dimension),
            GrowingArray(0, np.float32, kind.stop - kind.start),
            GrowingArray(0, np.intp),
            GrowingArray(0, np.intp, system.move_slots),
        )

    def update(self) -> Floats:
        """Return the relative observations of the present state, shape (..., modules, length)."""
        batch, layout, found = self._batch, self.layout, self.array
        seen, size = batch.observed.observation, self._system.site_size
        stands = batch.stands()
        self._learn(stands)
        _, spots, kinds, own, targets = [each.array for each in self._stands]
        found[:, :, 0] = seen[:, :, size]
        found[:, :, layout.parts["kind"]] = kinds[stands]
        if self._totals.shape[1] and self._counts.any():
            counts = np.maximum(self._counts, 1)
            way = (self._totals - counts * spots[stands]) / counts
            way[:, self._counts[:, 0] == 0] = 0
            far = 1 + np.abs(way).max(axis=2, keepdims=True)
            found[:, :, layout.parts["way"]] = way / far
        if self._hops is not None:
            modules = self._modules_here[None, :]
            here = self._hops[modules, own[stands]][:, :, None]
            there = self._hops[modules[:, :, None], targets[stands]]
            nearer = found[:, :, layout.parts["nearer"]]
            np.subtract(there < here, there > here, nearer, dtype=np.float32)
        looks = 2 * seen[:, :, size + 1 :: 2] + seen[:, :, size + 2 :: 2]
        shown = layout.looks.take(looks, axis=0)
        found[:, :, layout.parts["sensed"]] = shown.reshape(*looks.shape[:2], -1)
        return found

    def _learn(self, stands: NDArray[np.intp]) -> None:
        if self._forgotten != self._batch.forgotten:
            self._forgotten, self._stands = self._batch.forgotten, self._no_stands()
        for each in self._stands:
            each.room(int(stands.max()) + 1)
        known = self._stands[0].array
        if known[stands].all():
            return
        for stand in np.unique(stands[~known[stands]]).tolist():
            self._learn_of(stand, self._batch.site_of(stand))

    def _learn_of(self, stand: int, site: Site) -> None:
        system, layout = self._system, self.layout
        known, spots, kinds, own, targets = [each.array for each in self._stands]
        numbers = np.zeros(observation_length(system), np.int32)
        numbers[: system.site_size] = system.encode_site(site)
        kinds[stand] = self._kept[0].of(numbers)[layout.parts["kind"]]
        if system.dimension:
            spots[stand] = system.coordinates(system.place_of(site))
        if layout.sites is not None:
            own[stand], targets[stand] = layout.sites.targets(system, site)
        known[stand] = True


_AGENT_STEP_US = 25
"""What an agent-step in plain Python costs, in microseconds."""
_NICE = 10
_CODE = "from cubepath.agents.arrays.batch import compile_all; compile_all()"


class _Compiler:
    """The process that compiles; there is one at most."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._ready: bool | None = None

    def ready(self) -> bool:
        """Return whether compiled code can be had at once; if not, have it compiled."""
        if self._ready:
            return True
        if self._process is None:
            if is_compiled():
                self._ready = True
                return True
            self._start()
        # Where nothing can be kept, it has to be compiled here.
        if self._process is not None and self._process.poll() is not None:
            self._ready = True
        return bool(self._ready)

    def _start(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CODE],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        atexit.register(self._stop, os.getpid())

    def _stop(self, owner: int) -> None:
        if self._process is not None and os.getpid() == owner:
            with suppress(OSError):
                self._process.kill()
                self._process.wait()


_compiler = _Compiler()


def is_due(agents: int) -> bool:
    """Return whether this many agents continue in compiled code; if not, their step is counted."""
    return not allowance.grant(_AGENT_STEP_US * agents) and _compiler.ready()


def _kernels() -> tuple[Compiled[..., Any], ...]:
    return (rounds.play_round, lattice_tables.make_tiles, lattice_tables.rehash)


def is_compiled() -> bool:
    """Return whether everything that worlds are made of is compiled and on disk."""
    return all(each.kept() for each in _kernels())


def compile_all() -> None:
    """Compile everything that worlds are made of, beside more urgent work."""
    os.nice(_NICE)
    compile_world()


def compile_world() -> None:
    """Compile everything that worlds are made of, and keep it on disk."""
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415 - here alone

    batch = Batch(scene_from_spec("hex:n=2"), note_length=1)
    batch.reset([0])
    batch.observe()
    batch.step(np.zeros((1, 2), np.int64))
