"""For the tests of others: links that lose messages, conditions, assertions on the log, pytest.

Room: coordinator. It stands on `runs`, `simulation` and `shortening`, and only `commands` may use
it. The plugin for pytest is here too; it imports nothing of all this before a fixture is asked for.
Unlike those of other rooms, this face is for users.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.testing.commands import Command
    from cubepath.coordinator.testing.fixtures import Replay, Simulate, StartRun
    from cubepath.coordinator.testing.link import Link
    from cubepath.coordinator.testing.log import Claimed, Executed, Log
    from cubepath.coordinator.testing.replaying import (
        Listener,
        live_modules,
        other_rule,
        replay_into,
        replay_into_node,
    )
    from cubepath.coordinator.testing.rig import Rig
    from cubepath.coordinator.testing.rules import Pattern, Rule
    from cubepath.coordinator.testing.seen import Seen
    from cubepath.coordinator.testing.strategies import faults, scenarios
    from cubepath.coordinator.testing.trials import Trial, Tried, fault, trial_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "commands": "Command",
            "fixtures": "Replay Simulate StartRun",
            "link": "Link",
            "log": "Claimed Executed Log",
            "replaying": "Listener live_modules other_rule replay_into replay_into_node",
            "rig": "Rig",
            "rules": "Pattern Rule",
            "seen": "Seen",
            "strategies": "faults scenarios",
            "trials": "Trial Tried fault trial_of",
        },
    )

__all__ = [
    "Claimed",
    "Command",
    "Executed",
    "Link",
    "Listener",
    "Log",
    "Pattern",
    "Replay",
    "Rig",
    "Rule",
    "Seen",
    "Simulate",
    "StartRun",
    "Trial",
    "Tried",
    "fault",
    "faults",
    "live_modules",
    "other_rule",
    "replay_into",
    "replay_into_node",
    "scenarios",
    "trial_of",
]
