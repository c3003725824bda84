"""The commands ``cubepath rule check`` and ``cubepath rule list``."""

from __future__ import annotations

import argparse
import time
from typing import TYPE_CHECKING

from cubepath.coordinator.commands import console
from cubepath.coordinator.commands.usage import above_0, whole
from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import visible
from cubepath.protocol.core.parsing import Keys

if TYPE_CHECKING:  # a command starts faster without it
    from cubepath.agents.locality.check import LocalityReport

_UNTESTED = ": not tested whether the rule sees farther, try a larger system"


def add_rule_check(check: argparse.ArgumentParser) -> None:
    """Add the options of ``rule check``."""
    check.set_defaults(command=_check)
    check.add_argument("rule", metavar="RULE", help="a name, or FILE.py:NAME of a RuleType")
    check.add_argument(
        "systems",
        nargs="*",
        default=[],  # or else it is told to be required where RULE is missing
        metavar="SYSTEM",
        help="scenes to play it in, as for 'cubepath run' (default: a small and a larger one of"
        " each family that it is for)",
    )
    check.add_argument(
        "--clock",
        choices=("lockstep", "free"),
        default="lockstep",
        help="play it in rounds, or without",
    )
    check.add_argument(
        "--seed", type=whole(0), default=0, help="seed of the runs and of what is changed"
    )
    check.add_argument(
        "--timeout",
        type=above_0,
        default=600.0,
        metavar="SECONDS",
        help="end a check that takes longer (default 600)",
    )


def _check(options: argparse.Namespace) -> int:
    from cubepath.agents.locality.check import check_rule  # noqa: PLC0415 - only what is needed

    began = time.monotonic()
    with console.progress_bar(None, "rule check", " plays") as bar:
        found = check_rule(
            options.rule,
            options.systems or None,
            seed=options.seed,
            clock=options.clock,
            timeout_s=options.timeout,
            progress=bar.update,
        )
    seconds = time.monotonic() - began
    console.answer(options, _document(found, seconds), _text(found, seconds))
    return console.DONE if found.ok else console.FAILED


def _document(found: LocalityReport, seconds: float) -> dict[str, object]:
    return {
        "rule": found.rule,
        "clock": found.clock,
        "seed": found.seed,
        "systems": list(found.systems),
        "local": found.ok,
        "findings": [{"kind": each.kind, "text": each.text} for each in found.findings],
        "modules": found.modules,
        "choices": found.choices,
        "changes": found.changes,
        "seconds": round(seconds, 3),
    }


def _text(found: LocalityReport, seconds: float) -> str:
    clock = "" if found.clock == "lockstep" else f", {found.clock} clock"
    rows: list[tuple[str, object]] = [
        ("rule", f"{found.rule}, seed {found.seed}{clock}"),
        ("systems", ", ".join(found.systems)),
        ("modules", f"{found.modules} played again alone"),
        ("choices", f"{found.choices} compared"),
        ("changes", f"{found.changes} beyond reach" + _UNTESTED * (not found.changes)),
        ("findings", len(found.findings) or "none"),
        ("time", f"{seconds:.2f} s"),
    ]
    lines = [f"  {visible(each.text)}" for each in found.findings]
    return "\n".join([console.table(rows), *lines])


def add_rule_list(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``rule list``."""
    parser.set_defaults(command=_list)


def _list(options: argparse.Namespace) -> int:
    from cubepath.agents.rules.registry import misfit, rules  # noqa: PLC0415
    from cubepath.agents.rules.rule import LIMITS  # noqa: PLC0415
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
            console.complain(str(error))
            continue
        free = None if rule.free is None else rule.free.why
        document.append(
            {
                "name": rule.name,
                "summary": rule.summary,
                "keys": _keys_document(rule.keys),
                "source": rule.source,
                "systems": fitting,
                "clocks": list(rule.clocks),
                "free": free,
            }
        )
        lines += [
            f"{rule.name}: {rule.summary}",
            *_key_lines(rule.keys),
            f"    for {', '.join(fitting)}",
            f"    clocks: {', '.join(rule.clocks)}" + (f"; without rounds: {free}" if free else ""),
            f"    source: {rule.source}",
        ]
    lines += ["any rule:", *_key_lines(LIMITS)]
    lines.append(
        "a page (TOML): random, metropolis, and each rule whose systems have the page's moves"
    )
    console.answer(options, document, "\n".join(lines))
    return console.DONE


def _keys_document(keys: Keys) -> dict[str, dict[str, str]]:
    return {
        key: {"default": default, "summary": summary} for key, (default, summary) in keys.items()
    }


def _key_lines(keys: Keys) -> list[str]:
    return [f"    {key}={default:<6} {summary}" for key, (default, summary) in keys.items()]


def add_system_list(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``system list``."""
    parser.set_defaults(command=_list_systems)


def _list_systems(options: argparse.Namespace) -> int:
    from cubepath.protocol.scenes.registry import all_families  # noqa: PLC0415

    document = [
        {
            "name": family.name,
            "summary": family.summary,
            "rule": family.rule,
            "keys": _keys_document(family.keys),
        }
        for family in all_families().values()
    ]
    lines = []
    for family in all_families().values():
        rule = f" (rule {family.rule})" if family.rule else ""
        lines += [f"{family.name}: {family.summary}{rule}", *_key_lines(family.keys)]
    console.answer(options, document, "\n".join(lines))
    return console.DONE
