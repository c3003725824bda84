"""Scenes by name: `name:key=value,...`, or the path of a TOML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import cast

from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.keyed_values import all_values, given_values
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.family import Family
from cubepath.protocol.scenes.registry import contradiction, family_named, sound_family
from cubepath.protocol.scenes.toml import read_scene


def scene_from_spec(spec: str) -> Scene:
    """Return the scene that `spec` names; InputError says what is wrong with it."""
    name, _, rest = spec.partition(":")
    # The file may also be a pipe, such as /dev/fd/63 from a shell's process substitution.
    if (spec.endswith(".toml") or "/" in name) and sound_family(name) is None:
        return read_scene(Path(spec))
    family = family_named(name)
    given = given_values(rest, family.keys, spec)
    shown = ",".join(f"{key}={given[key]}" for key in family.keys if key in given)
    scene = _built(spec, family, all_values(given, family.keys))
    return replace(scene, spec=f"{name}:{shown}" if shown else name)


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
