"""What the core takes from `theory` and `tools`: the one place that names their modules.

Nothing here is imported before it is asked for. A person who changes how a run works never needs
either package, and a command loads only what it uses.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

COMMANDS = {
    "run": ("commands.runs", "run modules in processes, record them, shorten their path"),
    "router": ("commands.runs", "route for runs on several hosts, until interrupted"),
    "join": ("commands.runs", "join a run elsewhere, with some of its modules"),
    "shorten": ("commands.shorten", "shorten a path to its normal cube path"),
    "convert": ("commands.shorten", "write a path in another form: JSON Lines or .npz"),
    "verify": (
        "commands.recordings",
        "check a recording, from the start state on; or a certificate or a proof",
    ),
    "info": ("commands.recordings", "show what a recording contains"),
    "replay": ("commands.replay", "put a recording back on zenoh; gather and shorten it again"),
    "diff": ("tools.commands.diff", "show where two runs part, and why"),
    "record": ("tools.commands.record", "record a live run from outside, and leave"),
    "filter": ("tools.commands.cutting", "write some messages of a recording as a recording"),
    "split": ("tools.commands.cutting", "split a recording into several"),
    "merge": ("tools.commands.cutting", "put recordings of one run together"),
    "export": (
        "tools.commands.exporting",
        "write a recording as a table, or for viewers as Foxglove and rerun",
    ),
    "view": (
        "tools.commands.pictures",
        "draw a run or another path: some states, and its schedule; or a scene",
    ),
    "complex": ("theory.commands.complexes", "build a system's state complex and describe it"),
    "paper": ("theory.commands.complexes", "compare the paper's claims with what is computed"),
    "simulate": (
        "commands.simulate",
        "simulate whole runs under random faults, each from its seed",
    ),
    "sweep": ("commands.sweep", "play many runs: systems by rules by seeds, and more"),
    "report": ("commands.report", "tables, plots and a page on the runs of a sweep"),
    "certificates": ("commands.secure", "make an authority and certificates for secure runs"),
    "check-rule": (
        "commands.check_rule",
        "check that a rule sees no further than its module, and no more",
    ),
    "new": ("commands.new", "begin a distribution with a rule or a system of your own"),
    "systems": ("commands.listing", "list the systems with their keys and defaults"),
    "rules": ("commands.listing", "list the rules and the systems that they are for"),
}
"""Each command in the order of the help: the module whose `add_commands` adds it, and its line."""

_FUNCTIONS = {
    "add_beyond_options": "theory.commands.search_options",
    "add_following_options": "theory.commands.following",
    "add_live_options": "tools.commands.live",
    "add_proof_options": "theory.commands.optimality_proofs",
    "beyond_rows": "theory.commands.search_options",
    "diff": "tools.comparison.comparing",
    "facts_of": "theory.scene_facts",
    "improving": "theory.commands.search_options",
    "is_of_a_proof": "theory.commands.optimality_proofs",
    "look_beyond": "theory.commands.search_options",
    "lower_bound": "theory.search.lower_bounds",
    "shorten_following": "theory.commands.following",
    "state_space": "theory.complexes.state_spaces",
    "verify_following": "theory.commands.following",
    "verify_proof": "theory.commands.optimality_proofs",
    "watched": "tools.commands.live",
}


def plugin(name: str) -> Any:
    """Return a function of `theory` or `tools`.

    >>> plugin("lower_bound").__module__
    'cubepath.coordinator.theory.search.lower_bounds'
    """
    return getattr(_module(_FUNCTIONS[name]), name)


def add_commands_of(command: str) -> Any:
    """Return the function that adds a command, with those of the same module."""
    return _module(COMMANDS[command][0]).add_commands


def _module(name: str) -> Any:
    return import_module(f"cubepath.coordinator.{name}")
