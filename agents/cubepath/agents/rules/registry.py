"""Rules by name: the built-in ones, those of other distributions, and those in your files.

A rule in a file is ``FILE.py:NAME``, where NAME is a `RuleType`. A request by name pairs a scene
with the rule that its modules follow.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterable
from contextlib import suppress
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path, PurePath
from types import ModuleType
from typing import TYPE_CHECKING

from cubepath.agents.rules.actor import actors_for
from cubepath.agents.rules.chain import CHAIN
from cubepath.agents.rules.chains import CHAINS
from cubepath.agents.rules.compression import COMPRESSION
from cubepath.agents.rules.descent import CROSSING, GEODESIC
from cubepath.agents.rules.leader import LEADER
from cubepath.agents.rules.metropolis import METROPOLIS
from cubepath.agents.rules.pibt import PIBT
from cubepath.agents.rules.rule import RuleName, RuleType
from cubepath.agents.rules.tswap import TSWAP
from cubepath.agents.rules.tunnel import TUNNEL
from cubepath.agents.rules.uniform import RANDOM
from cubepath.agents.rules.word import WORD
from cubepath.protocol.core.errors import InputError, RuleError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.options import real_number, whole_number
from cubepath.protocol.core.system import Scene, System
from cubepath.protocol.scenes.registry import sound_family
from cubepath.protocol.scenes.specs import scene_from_spec

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint


RULE_MODULE = "cubepath_rule_"
"""How the names of the modules begin that such files become."""


def is_in_file(name: str) -> bool:
    """Return whether a rule's name begins with FILE.py:NAME."""
    return bool(RuleName.of(name).file)


def permitted_rule(named: str, given: Collection[str] = ()) -> str:
    """Return the name under which to load a rule that an input names.

    An input can name any file, so a file runs only if you gave it: one of `given` is FILE.py:NAME
    with the same last part of the path, and stands for what the input names. InputError if none is.
    """
    if not is_in_file(named):
        return named
    for own in given:
        if stands_for(own, named):
            parts = RuleName.of(own)._replace(values=RuleName.of(named).values)
            return ":".join(part for part in parts if part)
    raise InputError(
        f"rule {named!r} is in a file, which does not run because an input names it, expected also"
        " --rule FILE.py:NAME"
    )


def stands_for(given: str, named: str) -> bool:
    """Return whether a rule that you give, FILE.py:NAME, is the one that an input names.

    The folder may differ, and so may the values of keys.
    """
    return is_in_file(named) and _without_folder(given) == _without_folder(named)


def check_rule_file(name: str) -> None:
    """Raise InputError unless a name is of the form FILE.py:NAME and that file is there."""
    file = Path(RuleName.of(name).file)
    if not is_in_file(name):
        raise InputError(f"rule {name!r}: expected FILE.py:NAME of a rule in a file")
    if not file.is_file():
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule")


def _without_folder(name: str) -> RuleName:
    found = RuleName.of(name)
    return found._replace(file=PurePath(found.file).name, values="")


@cache
def rule_in_file(name: str) -> RuleType:
    """Return the rule FILE.py:NAME; InputError if there is none.

    The file is run once in a process, as a separate module, until `forget_rule_files`; it is not
    put on the search path. The `content` of the rule is that of the file, and its own.
    """
    file, wanted, _ = RuleName.of(name)
    path = Path(file).resolve()
    try:
        text = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"{file}: no such file, expected FILE.py:NAME of a rule") from None
    except OSError as error:
        why = "is a folder" if path.is_dir() else f"cannot be read: {error.strerror or error}"
        raise InputError(f"{file}: {why}, expected FILE.py:NAME of a rule") from None
    title = f"{RULE_MODULE}{path.stem}"
    module = sys.modules[title] = ModuleType(title)  # dataclasses and pickles look there
    module.__file__ = str(path)
    try:
        # As it was read: what Python compiled of it before may be of another text.
        exec(compile(text, path, "exec"), vars(module))  # noqa: S102 - that is what you ask for
    except (Exception, SystemExit) as error:
        why = " ".join(str(error).split())
        raise InputError(f"{file}: {type(error).__name__}: {why}") from error
    names = {key for key, value in vars(module).items() if isinstance(value, RuleType)}
    if wanted not in names:
        near = did_you_mean(wanted, sorted(names))
        held = ", ".join(sorted(names)) or "none"
        raise InputError(f"{file}: no rule {wanted!r}{near}, expected a RuleType, found {held}")
    rule: RuleType = getattr(module, wanted)
    return replace(rule, content=f"{sha256(text).hexdigest()} {rule.content}")


def forget_rule_files() -> None:
    """Run files of rules anew when they are asked for again: they may have been changed."""
    rule_in_file.cache_clear()


GROUP = "cubepath.rules"
CLOCKS = ("lockstep", "free")

_OWN = (
    *(RANDOM, METROPOLIS, CHAIN, CHAINS, TSWAP, PIBT, WORD, CROSSING, GEODESIC, TUNNEL),
    *(COMPRESSION, LEADER),
)
BUILT_IN = {rule.name: rule for rule in _OWN}


@cache
def rules() -> dict[str, RuleType]:
    """Return all rules by name; InputError names an entry point with none, or with one twice."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - takes long, and is rarely needed

    found = dict(BUILT_IN)
    for entry in entry_points(group=GROUP):
        rule = _loaded(entry)
        if rule.name in found:
            raise InputError(f"{_where(entry)}: rule {rule.name!r} exists")
        found[rule.name] = rule
    return found


def _where(entry: EntryPoint) -> str:
    by = f" ({entry.dist.name})" if entry.dist is not None else ""
    return f"entry point {entry.name} of {GROUP}{by}"


def _loaded(entry: EntryPoint) -> RuleType:
    try:
        rule = entry.load()
    except Exception as error:
        raise InputError(f"{_where(entry)}: {type(error).__name__}: {error}") from error
    if not isinstance(rule, RuleType):
        raise InputError(f"{_where(entry)}: {rule!r} is no RuleType")
    return rule


def _by_entry(name: str) -> RuleType | None:
    """Return the rule of the entry point of this name, without loading any others."""
    from importlib.metadata import entry_points  # noqa: PLC0415 - as above

    for entry in entry_points(group=GROUP, name=name):
        rule = _loaded(entry)
        if rule.name == name:
            return rule
    return None


def find_rule(name: str) -> RuleType | None:
    """Return the rule of that name, or of the form FILE.py:NAME; None if there is none.

    Either may end with the values of its keys, as in ``metropolis:temperature=2``. Other
    distributions are searched only for names that are not built in. InputError says what is wrong
    with a value, a file, or an entry point.
    """
    parts = RuleName.of(name)
    plain = parts.without_values
    if parts.file:
        found: RuleType | None = rule_in_file(plain)
    else:
        found = BUILT_IN.get(plain) or _by_entry(plain) or rules().get(plain)
    return found.with_values(parts.values) if found is not None and parts.values else found


def is_built_in(rule: RuleType) -> bool:
    """Return whether a rule is one of the project's own, with whatever values."""
    own = BUILT_IN.get(RuleName.of(rule.name).name)
    return own is rule or (own is not None and bool(rule.keys) and own.keys is rule.keys)


def unknown_rule(name: str) -> InputError:
    """Return the error for a name that no rule has."""
    near = _near(name)
    return InputError(f"unknown rule {name!r}{near}, expected one of {', '.join(rules())}")


def _near(name: str) -> str:
    """Return what may be meant by a name that no rule has, in brackets; "" for nothing."""
    if name.endswith(".py"):
        return " (a rule in a file is FILE.py:NAME)"
    return did_you_mean(name, rules())


def rules_for(system: System) -> list[RuleType]:
    """Return the rules that fit a system, without those that cannot tell."""
    found: list[RuleType] = []
    for rule in rules().values():
        with suppress(InputError):
            found += [rule] if rule.is_for(system) else []
    return found


def rule_named(name: str, system: System, clock: str = "lockstep") -> RuleType:
    """Return the rule that `find_rule` finds; InputError if none, or it does not fit the system.

    It must hold under the clock, too.
    """
    return _named(name, system, clock)


def _named(name: str, system: System, clock: str, scene: Scene | None = None) -> RuleType:
    """Return the rule of that name; errors propose rules for the scene, if it is known."""
    if clock not in CLOCKS:
        near = did_you_mean(str(clock), CLOCKS)
        raise InputError(f"clock={clock}{near}: expected one of {', '.join(CLOCKS)}")
    if not isinstance(name, str):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"rule={name!r}: expected the name of a rule, or FILE.py:NAME")
    found = find_rule(name)
    if found is not None and clock in found.clocks and found.is_for(system):
        return found
    what, own = "not for this system: rule", ""
    if found is None:
        what = "unknown rule"
    elif clock not in found.clocks:
        what = f"not for the {clock} clock: rule"
        own = "" if is_built_in(found) else ", or a RuleType with free=FreeRule(...)"
    near = _near(name) if found is None else ""
    fits = [rule.name for rule in rules_for(system) if clock in rule.clocks]
    fitting = ", ".join(fits if scene is None else fitting_rules(scene, clock))
    raise InputError(f"{what} {name!r}{near}, expected one of {fitting}{own}")


_TRIED = 16
"""For this many modules a rule is made to see whether it refuses a scene."""


def own_rule(scene: Scene) -> str:
    """Return the scene's rule, or its family's; ``random`` if there is none or it has no goal."""
    family = sound_family(scene.family)
    rule = scene.rule or (family.rule if family is not None else "")
    return "random" if not rule or (rule == METROPOLIS.name and scene.goal is None) else rule


def rule_for(name: str, scene: Scene, clock: str = "lockstep") -> RuleType:
    """Return the rule of that name, or of the form FILE.py:NAME.

    InputError if there is none, or it is not for the system, this scene of it, or the clock.
    """
    found = _named(name, scene.system, clock, scene)
    why = misfit(found, scene, clock)
    if why is not None:
        fitting = ", ".join(fitting_rules(scene, clock))
        raise InputError(f"not for this scene: {why}, expected one of {fitting}")
    return found


def misfit(
    rule: RuleType, scene: Scene, clock: str = "lockstep", *, foreign: bool = False
) -> str | None:
    """Return why a rule that is for the system refuses this scene of it; None if it does not.

    It is made for the modules, or some where there are many. An error of another kind is that of a
    run, and no refusal. A rule from elsewhere is made only if you want `foreign` ones to be: it may
    end its process, so give it a separate one.
    """
    if not (foreign or is_built_in(rule)):
        return None
    last = len(scene.start) - 1
    tried = range(last + 1)
    if last >= _TRIED:
        tried = range(0, last + 1, last // (_TRIED - 1))
    try:
        actors_for(scene, rule, seed=0, hesitate=0.0, modules=list(tried), clock=clock)
    except InputError as error:
        return str(error)
    except RuleError:
        pass
    return None


def fitting_rules(scene: Scene, clock: str = "lockstep", *, foreign: bool = False) -> list[str]:
    """Return the names of the rules that are for a scene under a clock; see `misfit`."""
    return [
        rule.name
        for rule in rules_for(scene.system)
        if clock in rule.clocks and misfit(rule, scene, clock, foreign=foreign) is None
    ]


def scene_and_rule(
    system: str | Path | Scene, rule: str | RuleType | None, clock: str = "lockstep"
) -> tuple[Scene, RuleType]:
    """Return a scene and a rule that were given by name, or are what they should be already.

    InputError if there are none of these names, or a rule of that name does not fit the system or
    hold under the clock.
    """
    if not isinstance(system, str | Path | Scene):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"system={system!r}: expected a name, a file or a scene")
    scene = system if isinstance(system, Scene) else scene_from_spec(str(system))
    if isinstance(rule, RuleType):
        return scene, rule
    return scene, rule_named(own_rule(scene) if rule is None else rule, scene.system, clock)


def check_seeds(seeds: object, hesitate: object) -> None:
    """Check seeds, and with which probability modules skip a round; InputError as for a run."""
    if not isinstance(seeds, Iterable):
        raise InputError(f"seeds={seeds!r}: expected several seeds")
    for seed in seeds:
        whole_number("seed", seed, 0)
    if not 0.0 <= real_number("hesitate", hesitate) < 1.0:
        raise InputError(f"hesitate={hesitate}: expected at least 0 and less than 1")
