"""Scenes by name: `name:key=value,...`, with the path of a TOML file for the name, or alone."""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.input_files import file_within
from cubepath.protocol.core.parsing import all_values, given_values
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import Family, contradiction, family_named, sound_family
from cubepath.protocol.scenes.toml import read_scene


def scene_from_spec(spec: str) -> Scene:
    """Return the scene that `spec` names; InputError says what is wrong with it."""
    name, _, rest = spec.partition(":")
    if is_scene_file(spec):
        return read_scene(*path_and_values(spec))
    family = family_named(name)
    given = given_values(rest, family.keys, spec)
    shown = ",".join(f"{key}={given[key]}" for key in family.keys if key in given)
    scene = _built(spec, family, all_values(given, family.keys))
    return replace(scene, spec=f"{name}:{shown}" if shown else name)


def is_scene_file(spec: str) -> bool:
    """Return whether a name is the path of a scene's file."""
    name = spec.partition(":")[0]
    # The file may also be a pipe, such as /dev/fd/63 from a shell's process substitution.
    ends = spec.endswith(".toml") or name.endswith(".toml") or "/" in name
    return ends and sound_family(name) is None


_VALUES = re.compile(r":([A-Za-z_]\w*=[^/:]*)$")


def path_and_values(spec: str) -> tuple[str, str]:
    """Return the path in the name of a scene's file, and the values of its keys, if they follow."""
    found = _VALUES.search(spec)
    return (spec[: found.start()], found[1]) if found else (spec, "")


def files_in(spec: str) -> list[str]:
    """Return the paths of files that a name has: itself, or the values of its keys.

    InputError if there is no such family or key.
    """
    name, _, rest = spec.partition(":")
    if is_scene_file(spec):
        return [str(Path(path_and_values(spec)[0]))]
    family, given = family_named(name), given_values(rest, family_named(name).keys, spec)
    return [value for key, value in given.items() if family.is_file(key, value)]


def spec_within(folder: Path, spec: str) -> str:
    """Return a name that an input in a folder has, with the paths of its files from here.

    InputError if one leads out of the folder, or there is no such family or key.
    """
    if is_scene_file(spec):
        path, rest = path_and_values(spec)
        return str(file_within(folder, path)) + (f":{rest}" if rest else "")
    name, colon, rest = spec.partition(":")
    family = family_named(name)
    values = {
        key: str(file_within(folder, value)) if family.is_file(key, value) else value
        for key, value in given_values(rest, family.keys, spec).items()
    }
    return name + colon + ",".join(f"{key}={value}" for key, value in values.items())


def _built(spec: str, family: Family, values: Mapping[str, str]) -> Scene:
    """Build a scene; any failure of a family becomes one line that names it."""
    try:
        scene = cast("object", family.build(family.name, values))
    except CubepathError:
        raise
    except (Exception, SystemExit) as error:
        text = " ".join(str(error).split())
        raise InputError(
            f"{spec}: system {family.name!r}: {type(error).__name__}: {text}"
        ) from error
    if not isinstance(scene, Scene):
        raise InputError(f"{spec}: system {family.name!r} built {scene!r}, which is no Scene")
    wrong = contradiction(family, scene.system)
    if wrong is not None:
        raise InputError(f"{spec}: {wrong}")
    return scene
