"""One run of a sweep as data: its id, its rule's sources, its slow modules.

A run's id is a hash of its configuration, of the contents of its files and of the code, so a run
with a known id is not repeated. For a rule from elsewhere, the hash covers its files and what it
learned. The slow modules are the same ones under every rule, clock and core.
"""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache, partial
from hashlib import sha256
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, get_args

import numpy as np
from msgspec import Meta

from cubepath.agents.rules.registry import BUILT_IN, RULE_MODULE, find_rule
from cubepath.agents.rules.rule import RuleName, RuleType
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.options import option_fields
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_to_toml

_DIGITS = 16


def source_hash(rule: str) -> str:
    """Return a hash of all that a rule from elsewhere follows from; "" for built-in ones.

    That is its `content`, which has the file of FILE.py:NAME, and the files in which the functions
    and the policy are that it is made of; it is of what was loaded, whatever is there now.
    InputError if there is no such rule.
    """
    named = RuleName.of(rule)
    if named.without_values in BUILT_IN:
        return ""
    found = find_rule(rule)
    if found is None:
        raise InputError(f"unknown rule {rule!r}")
    own = Path(named.file).resolve() if named.file else None
    others = {_file_hash(path) for path in _files(found) if path != own}
    content = " ".join([found.content, *sorted(others)])
    return sha256(content.encode()).hexdigest()[:_DIGITS]


@cache
def _file_hash(path: Path) -> str:
    """Return the hash of a file when it was first asked for; modules are loaded once, too."""
    return sha256(path.read_bytes()).hexdigest()


def _files(rule: RuleType) -> set[Path]:
    """Return the files of code that a rule is made of, but for those that it imports."""
    parts: list[object] = [rule.make, rule.fits, rule.note_length, rule.vectorised]
    if rule.free is not None:
        parts += [rule.free.make, rule.free.note_length]
    found: set[Path] = set()
    for part in parts:
        while isinstance(part, partial):
            part = part.func  # noqa: PLW2901
        found |= {path.resolve() for path in _files_of(part) if path.is_file()}
    return found


def _files_of(part: object) -> Iterator[Path]:
    """Yield the file in which a function, or the class of an object, is, and that of its module.

    They differ for a policy: it has its own module, and what makes a rule of it its own file.
    """
    if part is None:
        return
    code = inspect.unwrap(part) if callable(part) else part
    for held in (code, type(code)):
        with suppress(TypeError, OSError):
            yield Path(inspect.getsourcefile(held) or "")  # type: ignore[arg-type]
            break
    name = getattr(part, "__module__", None) or ""
    file = getattr(sys.modules.get(name), "__file__", None)
    # Modules of rule files are distinguished by their files, which `content` has.
    if file and not name.startswith(RULE_MODULE):
        yield Path(file)


Core: TypeAlias = Literal["compiled", "simulated", "wire"]
Clock: TypeAlias = Literal["lockstep", "free"]
CLOCKS: tuple[str, ...] = get_args(Clock)
_Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]
OF_SCENES = ("optimum", "improve", "best_known", "proved")
"""Keys of a setting that are of its scene, and decide nothing about a run."""
_ID = 16
_WITHOUT_RESULTS = ("commands", "paper", "auditing", "testing")
"""Rooms of the coordinator whose code decides nothing about a run."""
_OF_REPORTS = ("report", "published", "plots", "statistics", "tables")
"""Modules of this room of which the same holds."""


@dataclass(frozen=True, slots=True, order=True)
class FaultRates:
    """What goes wrong in a run; rates are between 0 and 1, and none of it happens at 0.

    `loss`, `delay` and `duplicate` are the shares of messages that are lost on a link, come
    `delay_ms` later and hold back those behind them, or come twice. `crash` is how probable it is
    that a module process dies before a message that it takes: with rounds that ends the run,
    without rounds another takes its place after a second. `slow` is the share of modules that take
    `slow_factor` times as long as the others for a turn.

    >>> FaultRates(loss=0.1, slow=0.5).text()
    'loss=0.1,slow=0.5'
    """

    loss: _Share = 0.0
    delay: _Share = 0.0
    delay_ms: Annotated[float, Meta(gt=0, le=1_000_000)] = 50.0
    duplicate: _Share = 0.0
    crash: _Share = 0.0
    slow: _Share = 0.0
    slow_factor: Annotated[int, Meta(ge=1, le=10_000)] = 10

    def __post_init__(self) -> None:
        """Check the rates; InputError names one that is out of its bounds."""
        for name, field in option_fields(FaultRates).items():
            field.check(getattr(self, name), f"faults: {name}")

    @property
    def of_messages(self) -> bool:
        """Whether something happens to messages or processes, for which there must be some."""
        return bool(self.loss or self.delay or self.duplicate or self.crash)

    @property
    def normal(self) -> FaultRates:
        """Return the same rates, with what has no effect as it is by default."""
        return replace(
            self,
            delay_ms=self.delay_ms if self.delay else 50.0,
            slow_factor=self.slow_factor if self.slow else 10,
        )

    def text(self) -> str:
        """Return the rates as they are given on the command line; "none" if nothing happens."""
        plain, given = asdict(FaultRates()), asdict(self.normal)
        found = ",".join(f"{key}={value:g}" for key, value in given.items() if value != plain[key])
        return found or "none"


@dataclass(frozen=True, slots=True)
class RunSetting:
    """Everything that decides the result of a run, except its seed.

    `system` names the scene, and `label` is how it is called in results; `scene` and `source` are
    hashes of what the scene holds and, of a rule from elsewhere, of what it follows from.
    `processes` and `keepers` are 0 where there are none.
    """

    label: str
    system: str
    scene: str
    rule: str
    source: str
    clock: Clock
    hesitate: float
    faults: FaultRates
    core: Core
    max_rounds: int
    processes: int
    keepers: int
    optimum: int = 0
    """How many states a search for the optimum may keep; 0 for no search."""
    improve: int = 0
    """How many steps a search for a path with few cubes takes; 0 for no search."""
    best_known: int | None = None
    proved: int | None = None
    """What is known of the scene from elsewhere: cubes of the best path, and a proved bound."""

    def configuration(self) -> dict[str, Any]:
        """Return the setting as plain data."""
        return asdict(self)

    def deciding(self) -> dict[str, Any]:
        """Return what decides about the run: files by what they hold, and not by where they lie.

        What is searched for or known in the scene changes nothing in it.
        """
        fields = asdict(self)
        for name in ("label", "system", *OF_SCENES):
            del fields[name]
        return fields | {"rule": self.rule.rpartition("/")[2]}


@dataclass(frozen=True, slots=True)
class RunBatch:
    """Runs of one setting that are played together, a seed each."""

    setting: RunSetting
    seeds: tuple[int, ...]
    code: str
    """The version of the code that the runs are to be of."""
    timeout_s: float | None = None
    """How long a run may take, in seconds of the machine; None for as long as it does."""

    def ids(self) -> tuple[str, ...]:
        """Return the id of each run."""
        return tuple(run_id(self.setting, seed, self.code) for seed in self.seeds)


def run_id(setting: RunSetting, seed: int, code: str) -> str:
    """Return the id of a run: 16 hexadecimal digits of a hash of all that decides about it."""
    return sha256(b"%s %d" % (_deciding(setting, code), seed)).hexdigest()[:_ID]


@lru_cache(maxsize=256)
def _deciding(setting: RunSetting, code: str) -> bytes:
    return json.dumps({**setting.deciding(), "code": code}, sort_keys=True).encode()


def scene_hash(scene: Scene) -> str:
    """Return a hash of what a scene holds, whatever name or file it came by."""
    first, _, rest = scene_to_toml(scene).split("\n", 2)  # the second line has its name
    return sha256(f'{first}\nname = ""\n{rest}'.encode()).hexdigest()[:_ID]


@cache
def code_version() -> str:
    """Return the version of cubepath with a hash of the sources that decide about runs."""
    digest = sha256()
    for name, path in sorted(_sources()):
        digest.update(f"{name}\n".encode())
        digest.update(path.read_bytes())
    return f"{version('cubepath')}+{digest.hexdigest()[:12]}"


def _sources() -> Iterator[tuple[str, Path]]:
    """Yield the modules that decide about runs, each with its name and its file."""
    for large in ("protocol", "agents", "coordinator"):
        found = find_spec(f"cubepath.{large}")
        for folder in () if found is None else found.submodule_search_locations or ():
            for path in Path(folder).rglob("*.py"):
                parts = path.relative_to(folder).with_suffix("").parts
                if large == "coordinator" and (
                    parts[0] in _WITHOUT_RESULTS
                    or (parts[0] == "experiments" and parts[-1] in _OF_REPORTS)
                ):
                    continue
                yield ".".join((large, *parts)), path


_STREAM = 3
"""What a stream of random numbers is for, beside those of rules, schedulers and late sights."""


def slow_modules(setting: RunSetting, scene: Scene, seed: int) -> list[int]:
    """Return the slow modules of a run by number: a share of all, drawn from its seed alone."""
    modules = len(scene.start)
    count = round(setting.faults.slow * modules)
    drawn = np.random.default_rng([seed, _STREAM]).permutation(modules)[:count]
    return sorted(drawn.tolist())


def thinking(setting: RunSetting, scene: Scene, seed: int) -> dict[int, float]:
    """Return how slowly each module thinks without rounds, in runs with messages.

    1 is 10 ms for a choice. Where no share of slow modules is given nobody takes time to think, and
    nothing is returned; where one is, all others think too, also if it comes to no module at all.
    """
    if not setting.faults.slow:
        return {}
    factors = dict.fromkeys(range(len(scene.start)), 1.0)
    slow = slow_modules(setting, scene, seed)
    return factors | dict.fromkeys(slow, float(setting.faults.slow_factor))
