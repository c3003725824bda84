"""The command ``cubepath system list``."""

from __future__ import annotations

import argparse

from cubepath.coordinator.commands.console import DONE, answer


def add_system_list(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``system list``."""
    parser.set_defaults(command=_list)


def _list(options: argparse.Namespace) -> int:
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
