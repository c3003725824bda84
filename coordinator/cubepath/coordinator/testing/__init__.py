"""For the tests of others: links that lose messages, conditions, assertions on the log, pytest.

Room: coordinator. It stands on `runs`, `simulation` and `shortening`, and only `commands` may use
it. The plugin for pytest is here too; it imports nothing of all this before a fixture is asked for.
Unlike those of other rooms, this face is for users.
"""

from typing import TYPE_CHECKING

from cubepath.protocol.faces import lazy_face

if TYPE_CHECKING:
    from cubepath.coordinator.testing.link import Link
    from cubepath.coordinator.testing.log import Claimed, Executed, Log
    from cubepath.coordinator.testing.rules import Pattern, Rule
    from cubepath.coordinator.testing.seen import Seen
    from cubepath.coordinator.testing.strategies import faults, scenarios
    from cubepath.coordinator.testing.trials import Trial, Tried, fault, trial_of
else:
    __getattr__, __dir__ = lazy_face(
        __name__,
        {
            "link": "Link",
            "log": "Claimed Executed Log",
            "rules": "Pattern Rule",
            "seen": "Seen",
            "strategies": "faults scenarios",
            "trials": "Trial Tried fault trial_of",
        },
    )

__all__ = [
    "Claimed",
    "Executed",
    "Link",
    "Log",
    "Pattern",
    "Rule",
    "Seen",
    "Trial",
    "Tried",
    "fault",
    "faults",
    "scenarios",
    "trial_of",
]
