from cubepath.coordinator.testing.commands import Command as Command
from cubepath.coordinator.testing.fixtures import (
    Replay as Replay,
)
from cubepath.coordinator.testing.fixtures import (
    Simulate as Simulate,
)
from cubepath.coordinator.testing.fixtures import (
    StartRun as StartRun,
)
from cubepath.coordinator.testing.link import Link as Link
from cubepath.coordinator.testing.log import Claimed as Claimed
from cubepath.coordinator.testing.log import Executed as Executed
from cubepath.coordinator.testing.log import Log as Log
from cubepath.coordinator.testing.replaying import (
    Listener as Listener,
)
from cubepath.coordinator.testing.replaying import (
    live_modules as live_modules,
)
from cubepath.coordinator.testing.replaying import (
    other_rule as other_rule,
)
from cubepath.coordinator.testing.replaying import (
    replay_into as replay_into,
)
from cubepath.coordinator.testing.replaying import (
    replay_into_node as replay_into_node,
)
from cubepath.coordinator.testing.rig import Rig as Rig
from cubepath.coordinator.testing.rules import Pattern as Pattern
from cubepath.coordinator.testing.rules import Rule as Rule
from cubepath.coordinator.testing.seen import Seen as Seen
from cubepath.coordinator.testing.strategies import faults as faults
from cubepath.coordinator.testing.strategies import scenarios as scenarios
from cubepath.coordinator.testing.trials import (
    Trial as Trial,
)
from cubepath.coordinator.testing.trials import (
    Tried as Tried,
)
from cubepath.coordinator.testing.trials import (
    fault as fault,
)
from cubepath.coordinator.testing.trials import (
    trial_of as trial_of,
)
