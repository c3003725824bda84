"""No sale is lost, whatever the network does: ``python -m pytest`` in the folder above."""

import json
import sys
from pathlib import Path

from hypothesis import Phase, given, settings

from cubepath.coordinator.testing import NetworkFault, NetworkUnderTest, WireMessage, network_faults

HERE = Path(__file__).parents[1]
SALES, TOTAL = 8, 80


def sold(message: WireMessage) -> int:
    """Return what a message of the store says was sold so far."""
    return int(json.loads(message.data)[1])


def sell(network: NetworkUnderTest, *faults: NetworkFault) -> None:
    """Run a store and a till under faults, until the till has all sales acknowledged."""
    store = [sys.executable, f"{HERE / 'store.py'}", "{endpoint}"]
    network.start("store", store, listens="stock/sale")
    network.endpoint("till")  # from now on there is a link that faults can strike
    network.inject(faults)
    till = [sys.executable, f"{HERE / 'till.py'}", "{endpoint}", str(SALES)]
    assert network.start("till", till).wait() == 0
    assert max(map(sold, network.log.messages("stock/sold"))) == TOTAL


def test_a_link_that_is_cut_loses_no_sale(cubepath_network: NetworkUnderTest) -> None:
    """The next four messages are lost: no more than two acknowledgements, so two sales or more."""
    sell(cubepath_network, NetworkFault("cut", "till", nth=2, count=4))
    cubepath_network.log.assert_order("stock/sale", "stock/sold")


@given(network_faults(["store", "till"], kinds=["cut", "drop", "double", "delay", "pause"]))
@settings(
    max_examples=20,
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # to shrink real processes takes minutes
)
def test_no_fault_loses_a_sale(faults: list[NetworkFault]) -> None:
    """Nor sells anything twice."""
    with NetworkUnderTest() as network:
        sell(network, *faults)
