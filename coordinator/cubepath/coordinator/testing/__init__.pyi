from cubepath.coordinator.testing.commands import Command as Command
from cubepath.coordinator.testing.fixtures import (
    Replay as Replay,
    Simulate as Simulate,
    StartRun as StartRun,
)
from cubepath.coordinator.testing.link import Link as Link
from cubepath.coordinator.testing.log import Claimed as Claimed, Executed as Executed, Log as Log
from cubepath.coordinator.testing.replaying import (
    Listener as Listener,
    live_modules as live_modules,
    other_rule as other_rule,
    replay_into as replay_into,
    replay_into_node as replay_into_node,
)
from cubepath.coordinator.testing.rig import Rig as Rig
from cubepath.coordinator.testing.rules import Pattern as Pattern, Rule as Rule
from cubepath.coordinator.testing.seen import Seen as Seen
from cubepath.coordinator.testing.strategies import faults as faults, scenarios as scenarios
from cubepath.coordinator.testing.trials import (
    Trial as Trial,
    Tried as Tried,
    fault as fault,
    trial_of as trial_of,
)
