"""Scenes by name: what `name:key=value,...` or the path of a TOML file stands for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.keyed_values import all_values, given_values
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.registry import all_families, family_named, sound_families
from cubepath.protocol.scenes.toml import read_scene


def scene_from_spec(spec: str) -> Scene:
    """Return the scene that `spec` names; InputError says what is wrong with it."""
    name, _, rest = spec.partition(":")
    family = sound_families().get(name)
    if family is None and spec.endswith(".toml"):
        return read_scene(Path(spec))
    family = family or family_named(name)
    if family is None:
        names = ", ".join(all_families())
        raise InputError(f"unknown system {name!r}, expected one of {names} or a .toml file")
    given = given_values(rest, family.keys, spec)
    shown = ",".join(f"{key}={given[key]}" for key in family.keys if key in given)
    scene = family.build(name, all_values(given, family.keys))
    return replace(scene, spec=f"{name}:{shown}" if shown else name)
