"""The commands ``cubepath systems`` and ``cubepath rules``."""

from __future__ import annotations

import argparse

from cubepath.coordinator.commands.console import DONE, answer, complain
from cubepath.coordinator.commands.usage import AddCommand
from cubepath.protocol.core.errors import InputError


def add_commands(command: AddCommand) -> None:
    """Add ``systems`` and ``rules``."""
    command("systems", _systems)
    command("rules", _rules)


def _systems(options: argparse.Namespace) -> int:
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415

    document = [
        {
            "name": family.name,
            "summary": family.summary,
            "rule": family.rule,
            "keys": {
                key: {"default": default, "summary": summary}
                for key, (default, summary) in family.keys.items()
            },
        }
        for family in all_families().values()
    ]
    lines = []
    for family in all_families().values():
        rule = f" (rule {family.rule})" if family.rule else ""
        lines.append(f"{family.name}: {family.summary}{rule}")
        for key, (default, summary) in family.keys.items():
            lines.append(f"    {key}={default:<6} {summary}")
    answer(options, document, "\n".join(lines))
    return DONE


def _rules(options: argparse.Namespace) -> int:
    from cubepath.agents.rules.registry import (  # noqa: PLC0415
        misfit,
        rules,
    )
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415
    from cubepath.protocol.scenes.specs import scene_from_spec  # noqa: PLC0415

    scenes = {name: scene_from_spec(name) for name in all_families()}
    scenes = {name: scene for name, scene in scenes.items() if scene.system.local}
    document: list[dict[str, object]] = []
    lines: list[str] = []
    for rule in rules().values():
        try:
            fitting = [
                name
                for name, scene in scenes.items()
                if rule.is_for(scene.system) and misfit(rule, scene) is None
            ]
        except InputError as error:
            complain(str(error))
            continue
        free = None if rule.free is None else rule.free.why
        document.append(
            {
                "name": rule.name,
                "summary": rule.summary,
                "source": rule.source,
                "systems": fitting,
                "clocks": list(rule.clocks),
                "free": free,
            }
        )
        lines += [
            f"{rule.name}: {rule.summary}",
            f"    for {', '.join(fitting)}",
            f"    clocks: {', '.join(rule.clocks)}" + (f"; without rounds: {free}" if free else ""),
            f"    source: {rule.source}",
        ]
    answer(options, document, "\n".join(lines))
    return DONE
