"""What the core takes from `theory` and `tools`: the one place that names their modules.

Nothing listed here is imported before it is used. To change how a run works you need neither
package, and a command loads only what it uses.
"""

from importlib import import_module
from typing import Any

COMMANDS = {
    "run": ("commands.run", "run modules in processes, record them, shorten their path"),
    "join": ("commands.host", "join a run elsewhere, with some of its modules"),
    "replay": ("commands.replay", "put a recording back on zenoh, and shorten a run again"),
    "shorten": (
        "commands.shorten",
        "shorten a path to its normal cube path, or write it in another form",
    ),
    "improve": (
        "theory.commands.improve",
        "search for a shorter schedule outside the homotopy class; bounds and proofs",
    ),
    "verify": (
        "commands.verify",
        "check a recording, from the start state on; or a certificate or a proof",
    ),
    "diff": (
        "tools.commands.diff",
        "show where two runs part, and why; or whether two paths are equal",
    ),
    "view": (
        "tools.commands.view",
        "draw a run or another path: some states, and its schedule; or a scene",
    ),
    "sweep": ("commands.sweep", "play many runs: systems by rules by seeds, and more"),
    "report": ("commands.sweep", "tables, plots and a page on the runs of a sweep"),
    "simulate": (
        "commands.simulate",
        "simulate whole runs under random faults, each from its seed",
    ),
    "complex": ("theory.commands.complex", "build a system's state complex and describe it"),
    "paper": ("theory.commands.complex", "compare the paper's claims with what is computed"),
    "log info": ("commands.log", "show what a recording contains"),
    "log record": ("tools.commands.log", "record a live run from outside, and leave"),
    "log filter": ("tools.commands.log", "write some messages of a recording as a recording"),
    "log split": ("tools.commands.log", "split a recording into several"),
    "log merge": ("tools.commands.log", "put recordings of one run together"),
    "log export": (
        "tools.commands.log",
        "write a recording as a table, or for viewers as Foxglove and rerun",
    ),
    "log recover": ("commands.log", "write what can be read of a damaged recording as a recording"),
    "rule list": ("commands.rule", "list the rules and the systems that they are for"),
    "rule new": ("commands.new", "begin a distribution with a rule of your own"),
    "rule check": (
        "commands.rule",
        "check that a rule uses only local information and is reproducible",
    ),
    "system list": ("commands.rule", "list the systems with their keys and defaults"),
    "system new": ("commands.new", "begin a page, or a distribution, with a system of your own"),
    "system check": (
        "theory.commands.catalogue",
        "find the mistakes in a lattice system on a page, and say what its moves are like",
    ),
    "system show": ("theory.commands.catalogue", "draw the moves of a system, before and after"),
    "host router": ("commands.host", "route for runs on several hosts, until interrupted"),
    "host certificates": ("commands.host", "make an authority and certificates for secure runs"),
}
"""Each command in the order of the help: the module that adds its options, and its line."""

GROUPS = {
    "log": "recordings: show, record, cut, export and recover them",
    "rule": "rules: list and check them, begin one of your own",
    "system": "systems: list, check and draw them, begin one of your own",
    "host": "runs on several hosts: a router, certificates",
}
"""Each first word that several commands share, with its line."""

_FUNCTIONS = {
    "add_live_options": "tools.commands.live",
    "add_proof_options": "theory.commands.optimality_proofs",
    "diff": "tools.comparison.run_comparison",
    "draw_complex": "theory.complexes.export",
    "facts_of": "theory.scene_facts",
    "html_of": "tools.notebooks",
    "is_of_a_proof": "theory.commands.optimality_proofs",
    "lower_bound": "theory.search.lower_bounds",
    "state_space": "theory.complexes.export",
    "text_of": "tools.notebooks",
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


def add_options_of(command: str) -> Any:
    """Return the function that gives a parser the options of a command.

    >>> add_options_of("log info").__name__
    'add_log_info'
    """
    return getattr(_module(COMMANDS[command][0]), f"add_{command.replace(' ', '_')}")


def _module(name: str) -> Any:
    return import_module(f"cubepath.coordinator.{name}")
