from cubepath.coordinator.testing.commands import Command as Command
from cubepath.coordinator.testing.fixtures import (
    Listener as Listener,
    ReplayFixture as ReplayFixture,
    RunFixture as RunFixture,
    SimulateFixture as SimulateFixture,
)
from cubepath.coordinator.testing.link import LinkProxy as LinkProxy
from cubepath.coordinator.testing.log import (
    ClaimOutcome as ClaimOutcome,
    ExecutedMove as ExecutedMove,
    RunLog as RunLog,
)
from cubepath.coordinator.testing.network import (
    NetworkFault as NetworkFault,
    NetworkUnderTest as NetworkUnderTest,
)
from cubepath.coordinator.testing.network_log import MessageLog as MessageLog
from cubepath.coordinator.testing.properties import (
    always as always,
    reached as reached,
    sometimes as sometimes,
)
from cubepath.coordinator.testing.rules import Pattern as Pattern, Rule as Rule
from cubepath.coordinator.testing.run_under_test import RunUnderTest as RunUnderTest
from cubepath.coordinator.testing.strategies import (
    Trial as Trial,
    TrialResult as TrialResult,
    fault as fault,
    faults as faults,
    network_faults as network_faults,
    scenarios as scenarios,
    trial_of as trial_of,
)
from cubepath.coordinator.testing.wire_messages import WireMessage as WireMessage
