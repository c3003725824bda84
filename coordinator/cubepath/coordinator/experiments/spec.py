"""A sweep as data: every combination of systems, rules, clocks, hesitations, faults and seeds.

A file and the command line are expanded in the same order: by system, rule, clock, hesitation,
faults and, fastest, seed.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache, lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any, cast

from cubepath.agents.rules import registry
from cubepath.coordinator.experiments.instances import standard
from cubepath.coordinator.experiments.options import SweepOptions
from cubepath.coordinator.experiments.published import PublishedResults, ReportNotes, published_in
from cubepath.coordinator.experiments.setting import (
    CLOCKS,
    Clock,
    FaultRates,
    RunBatch,
    RunSetting,
    code_version,
    run_id,
    scene_hash,
    source_hash,
)
from cubepath.protocol.core.errors import InputError, OptionError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.input_files import read_text
from cubepath.protocol.core.options import (
    keys_of,
    known_name,
    option_fields,
    options_from_values,
    real_number,
    whole_number,
)
from cubepath.protocol.core.parsing import all_values, given_values, parsed_toml
from cubepath.protocol.core.ranges import LARGEST, checked_seeds, expanded, seeds_of
from cubepath.protocol.core.system import Scene, local_only
from cubepath.protocol.scenes.registry import family_named
from cubepath.protocol.scenes.specs import (
    files_in,
    is_scene_file,
    path_and_values,
    scene_from_spec,
    spec_within,
)

_SWEEPS = Path(__file__).parent / "sweeps"
"""Sweeps that come with cubepath, each by the name of its file; a changed one has a new number."""
STANDARD = "standard"
"""The name that stands for all standard instances."""
_TOGETHER = {"compiled": 25, "simulated": 2, "wire": 1}
"""How many runs of a setting are played together, by core."""
_SMALL = 1000
"""With fewer modules in all runs together no other processes are started."""


@dataclass(frozen=True, slots=True)
class Sweep(SweepOptions):
    """What to run: all systems with all rules, clocks, hesitations, faults and seeds.

    `systems` may have ranges and lists in their keys, as in ``hex:n=4..40``; no `rules` means for
    each system the rule of its family. Without a `core` runs are played in compiled code, and under
    the simulator if something happens to messages. `max_rounds` ends a run: this many rounds;
    without rounds this many turns of each module in one process, and this many levels of moves over
    the wire. `processes` and `keepers` are those of a run with messages. `optimum` asks for the
    least number of cubes between start and goal, by a search that keeps this many states at most,
    and `improve` for the best path that a search of this many steps finds, in any class. A run that
    takes longer than `timeout_s` seconds of the machine is ended; None lets it take what it takes.
    `pool` and `published` are for the report: keys of systems in which replicates differ, and what
    others published on the same systems.

    >>> expand(Sweep(systems=("hex:n=4..5",), rules=("chain",), seeds=(0, 1))).runs
    4
    """

    systems: tuple[str, ...]
    rules: tuple[str, ...] = ()
    clocks: tuple[str, ...] = ("lockstep",)
    hesitate: tuple[float, ...] = (0.0,)
    faults: tuple[FaultRates, ...] = (FaultRates(),)
    seeds: tuple[int, ...] = tuple(range(10))
    pool: tuple[str, ...] = ()
    published: tuple[PublishedResults, ...] = ()

    def __post_init__(self) -> None:
        """Check what is wrong whatever the systems are; InputError names it."""
        if not self.systems:
            raise InputError("systems: expected one or more, found none")
        for clock in self.clocks:
            known_name("clocks: ", clock, CLOCKS)
        for key in ("clocks", "hesitate", "faults"):
            if not getattr(self, key):
                raise InputError(f"{key}: expected one value or more, found none")
        if not all(0.0 <= share < 1.0 for share in self.hesitate):
            found = ", ".join(f"{share:g}" for share in self.hesitate)
            raise OptionError(f"hesitate: {found}, expected at least 0 and less than 1")
        for key, field in option_fields(SweepOptions).items():
            value = getattr(self, key)
            field.check(value, key)
            if field.kind is int and value > LARGEST:
                raise OptionError(f"{key}={value}: expected at most {LARGEST}")
        checked_seeds(list(self.seeds))
        for rule in self.rules:
            if registry.find_rule(rule) is None:
                raise registry.unknown_rule(rule)


@dataclass(frozen=True, slots=True)
class Expansion:
    """The runs of a sweep, settings by seeds in order, and why other combinations are left out."""

    settings: tuple[RunSetting, ...]
    seeds: tuple[int, ...]
    code: str
    timeout_s: float | None
    left_out: tuple[str, ...]
    notes: ReportNotes | None

    @property
    def runs(self) -> int:
        """Return how many runs there are."""
        return len(self.settings) * len(self.seeds)

    @property
    def batches(self) -> Iterator[RunBatch]:
        """Yield the runs that are played together, made as they are asked for."""
        for setting in self.settings:
            together = _TOGETHER[setting.core] if setting.clock == "lockstep" else 1
            for first in range(0, len(self.seeds), together):
                seeds = self.seeds[first : first + together]
                yield RunBatch(setting, seeds, self.code, self.timeout_s)

    @property
    def foreign(self) -> bool:
        """Whether rules are from elsewhere, which may end their process."""
        return any(setting.source for setting in self.settings)


def expand(sweep: Sweep) -> Expansion:
    """Return the runs of a sweep in their canonical order, each once.

    InputError if a system or a rule is unknown, or if no combination fits; combinations that do not
    fit are else left out, each with a line on why. Files are read anew.
    """
    registry.forget_rule_files()
    _scene.cache_clear()
    code = code_version()
    left_out: list[str] = []
    settings: dict[str, RunSetting] = {}
    for label, system in _instances(sweep.systems):
        try:
            scene = _scene(system)
        except InputError as error:
            left_out.append(_left_out_line(label, error))
            continue
        for setting in _of_scene(sweep, (label, system), scene, left_out):
            first = settings.setdefault(run_id(setting, 0, code), setting)
            if first.label != setting.label:
                line = f"{setting.label}: the same scene as {first.label}, which is played"
                left_out += [line] if line not in left_out else []
    if not settings:
        more = f" (and {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise InputError(f"nothing to run: {left_out[0]}{more}")
    found = tuple(settings.values())
    notes = ReportNotes(sweep.pool, sweep.published) if sweep.pool or sweep.published else None
    return Expansion(found, sweep.seeds, code, sweep.timeout_s, tuple(left_out), notes)


def _left_out_line(label: str, error: InputError) -> str:
    line = str(error)
    return line if line.startswith(f"{label}:") else f"{label}: {line}"


def _instances(systems: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Yield the label and the name of each system."""
    for text in systems:
        if text == STANDARD:
            for each in standard():
                yield each.name, each.system
            continue
        for name in expanded(text):
            _check_name(name)
            yield name, name


def _known_of(scene: Scene, hashed: str) -> tuple[int | None, int | None]:
    """Return the best known and the proved number of cubes, by whatever name a scene goes."""
    for each in standard():
        family, _, _ = each.system.partition(":")
        if family == scene.family and hashed == _hash_of(each.system):
            return each.best, each.bound
    return None, None


@cache
def _hash_of(system: str) -> str:
    return scene_hash(scene_from_spec(system))


def _check_name(name: str) -> None:
    """Raise InputError for a system, key or file that there is not; it is no misfit, but a slip."""
    family, _, rest = name.partition(":")
    if is_scene_file(name):
        if not Path(path_and_values(name)[0]).is_file():
            raise InputError(f"{name}: no such file, expected a system")
        return
    given_values(rest, family_named(family).keys, name)


@lru_cache(maxsize=64)
def _scene(system: str) -> Scene:
    scene = local_only(scene_from_spec(system), "runs")
    _ = scene.system.move_slots  # too many moves to list are found out here
    return scene


def is_small(batches: Iterable[RunBatch]) -> bool:
    """Return whether runs are over sooner than other processes would be there to play them."""
    modules = 0
    for batch in batches:
        if batch.setting.core != "compiled":
            return False
        modules += len(batch.seeds) * len(_scene(batch.setting.system).start)
        if modules >= _SMALL:
            return False
    return True


def _of_scene(
    sweep: Sweep, named: tuple[str, str], scene: Scene, left_out: list[str]
) -> Iterator[RunSetting]:
    label, system = named
    hashed = scene_hash(scene)
    best_known, proved = _known_of(scene, hashed)
    axes = (sweep.rules or (registry.own_rule(scene),), sweep.clocks, sweep.hesitate, sweep.faults)
    fitting = cache(partial(registry.rule_for, scene=scene))  # as slow as a large scene makes it
    for rule, clock, hesitate, rates in product(*axes):
        core = sweep.core or ("simulated" if rates.of_messages else "compiled")
        try:
            fitting(rule, clock=clock)
            _check_core(core, clock, rates)
        except InputError as error:
            line = _left_out_line(label, error)
            if line not in left_out:
                left_out.append(line)
            continue
        alone = core == "compiled"
        yield RunSetting(
            label=label,
            system=system,
            scene=hashed,
            rule=rule,
            source=source_hash(rule),
            clock=cast("Clock", clock),
            hesitate=float(hesitate),
            faults=rates.normal,
            core=core,
            max_rounds=sweep.max_rounds,
            processes=0 if alone else min(sweep.processes, len(scene.start)),
            keepers=0 if alone or clock != "free" else sweep.keepers,
            optimum=sweep.optimum,
            improve=sweep.improve,
            best_known=best_known,
            proved=proved,
        )


def _check_core(core: str, clock: str, rates: FaultRates) -> None:
    if rates.of_messages and core != "simulated":
        raise InputError(f"faults {rates.text()}: not in core {core}, expected core simulated")
    if rates.slow and clock == "lockstep" and core != "compiled":
        raise InputError(
            f"faults {rates.text()}: with rounds slow modules are in core compiled alone"
        )


# From files and from the command line.


def read_sweep_file(path: Path, *, own_rules: bool = True, data: Path | None = None) -> Sweep:
    """Read a sweep from a TOML file; InputError names the file and what is wrong in it.

    Paths of files in it are relative to its folder, or to `data`, and stay in it. Its rules are
    rules by name, since no file runs because an input names it; without `own_rules` they are left
    out.
    """
    where = path.stem if path.parent == _SWEEPS else path
    try:
        table = dict(parsed_toml(read_text(path)))
        if not own_rules:
            table.pop("rules", None)
        for rule in _several(table["rules"]) if "rules" in table else ():
            registry.permitted_rule(_text("rules", rule))
        return sweep_from_table(table, data or path.parent)
    except InputError as error:
        line = str(error)
        raise InputError(line if line.startswith(f"{path}:") else f"{where}: {line}") from None


def sweep_of(systems: Sequence[str], given: Mapping[str, Any]) -> Sweep:
    """Return the sweep of systems, or of one file that holds a sweep; what is given counts more.

    `given` is a table as that of `sweep_from_table`, without systems, and may have `data`, the
    folder of all files that systems name. InputError as there.
    """
    given = dict(given)
    data = Path(given.pop("data")) if "data" in given else None
    packaged = {path.stem: str(path) for path in _SWEEPS.glob("*.toml")}
    systems = [packaged.get(each, each) for each in systems]
    for each in systems:
        _check_file(each)
    files = [each for each in systems if each.endswith(".toml") and is_sweep_file(Path(each))]
    if not files:
        return sweep_from_table({"systems": list(systems), **given}, data)
    if len(systems) > 1:
        raise InputError(f"{files[0]}: holds a sweep, expected it alone")
    found = read_sweep_file(Path(files[0]), own_rules="rules" not in given, data=data)
    changed = sweep_from_table({"systems": list(found.systems), **given})
    return replace(found, **{key: getattr(changed, key) for key in given})


def _check_file(name: str) -> None:
    """Raise InputError for a file that is neither a sweep nor a system, as an empty one."""
    try:
        held = parsed_toml(read_text(Path(name))) if name.endswith(".toml") else {"systems": ()}
    except InputError:  # reading it reports that
        return
    if "systems" not in held and "format" not in held:
        raise InputError(
            f"{name}: expected the systems of a sweep, or the format of a system, found neither"
        )


def is_sweep_file(path: Path) -> bool:
    """Return whether a TOML file has the key `systems`, which no system has."""
    try:
        return "systems" in parsed_toml(read_text(path))
    except InputError:
        return False


def sweep_from_table(table: Mapping[str, Any], folder: Path | None = None) -> Sweep:
    """Return the sweep of a table as in a TOML file; InputError says what is wrong with it.

    With a `folder`, paths of files are relative to it and must stay in it. The keys are those of
    `Sweep`, and `data_from`, where to get the files. A value may stand where a list of them is
    expected; `seeds` is a number of seeds, a text as ``"5..9"``, or a list; `systems` and `faults`
    may be tables.

    >>> sweep_from_table({"systems": {"name": "hex", "n": [4, 8]}, "seeds": 2}).systems
    ('hex:n=4,8',)
    """
    known = [*(field.name for field in fields(Sweep)), "data_from"]
    table = dict(table)
    source = _text("data_from", table.pop("data_from", ""))
    for key in table:
        if key not in known:
            near = did_you_mean(key, known)
            raise InputError(f"unknown key {key!r}{near}, expected one of {', '.join(known)}")
    if "systems" not in table:
        raise InputError("systems: missing, expected one or more")
    readers: dict[str, Callable[[object], object]] = {
        "systems": lambda value: tuple(
            name
            for each in map(_system_text, _several(value))
            for name in _placed(folder, each, source)
        ),
        "hesitate": lambda value: tuple(real_number("hesitate", each) for each in _several(value)),
        "faults": lambda value: tuple(
            rates for each in _several(value) for rates in _rates_of(each)
        ),
        "seeds": _seeds,
        "published": published_in,
    }
    for key in ("rules", "clocks", "pool"):
        readers[key] = partial(_texts, key)
    found = {key: readers[key](value) if key in readers else value for key, value in table.items()}
    return Sweep(**cast("dict[str, Any]", found))


def _placed(folder: Path | None, text: str, source: str) -> list[str]:
    """Return a system with the paths of its files from here: several where its keys name files."""
    if folder is None or text == STANDARD:
        return [text]
    names = expanded(text)
    files = {file for name in names for file in files_in(name)}
    found = [spec_within(folder, name) for name in names] if files else [text]
    for file in sorted(files) if source else ():
        if not (folder / file).is_file():
            raise InputError(f"{file}: not found, expected --data DIR with it, from {source}")
    return found


def _several(value: object) -> Sequence[object]:
    return cast("list[object]", value) if isinstance(value, list) else [value]


def _text(key: str, value: object) -> str:
    if not isinstance(value, str):
        raise InputError(f"{key}: expected a text, found {value!r}")
    return value


def _texts(key: str, value: object) -> tuple[str, ...]:
    return tuple(_text(key, each) for each in _several(value))


def _keys_text(table: Mapping[str, object]) -> str:
    """Return keys with one value or several as they are written on the command line."""
    return ",".join(f"{key}={','.join(map(str, _several(each)))}" for key, each in table.items())


def _system_text(value: object) -> str:
    """Return a system as it is written on the command line."""
    if not isinstance(value, dict):
        return _text("systems", value)
    table = dict(cast("dict[str, object]", value))
    if "name" not in table:
        raise InputError(f"systems: expected a table with a name, found {table!r}")
    name = _text("systems", table.pop("name"))
    return f"{name}:{_keys_text(table)}" if table else name


def _seeds(value: object) -> tuple[int, ...]:
    if isinstance(value, list):
        return checked_seeds([whole_number("seeds", each) for each in _several(value)])
    if isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool)):
        return seeds_of(str(value))
    raise InputError(f"seeds: expected a number, a text as '5..9' or a list, found {value!r}")


def _rates_of(value: object) -> list[FaultRates]:
    if not isinstance(value, dict):
        return rates_from_text(_text("faults", value))
    return rates_from_text(_keys_text(cast("dict[str, object]", value)) or "none")


def rates_from_text(text: str) -> list[FaultRates]:
    """Return the fault rates of a text as ``loss=0,0.01,crash=0.001``; InputError if it is none.

    A key may have several values, and all are taken with all; ``none`` is no faults.

    >>> [rates.text() for rates in rates_from_text("loss=0,0.25,slow=0.5")]
    ['slow=0.5', 'loss=0.25,slow=0.5']
    """
    if text == "none":
        return [FaultRates()]
    keys = keys_of(FaultRates)
    found: list[FaultRates] = []
    for each in expanded(f"faults:{text}"):
        given = given_values(each.partition(":")[2], keys, "faults")
        try:
            found.append(options_from_values(FaultRates, all_values(given, keys)))
        except InputError as error:
            raise OptionError(f"faults: {error}") from None
    return found
