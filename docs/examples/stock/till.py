"""A till over zenoh: it reports sales, each again until the store acknowledges it."""

import json
import sys
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
open_sales = dict.fromkeys(range(int(sys.argv[2])), 10)


def acknowledge(sample: zenoh.Sample) -> None:
    """Forget a sale that the store has."""
    open_sales.pop(json.loads(sample.payload.to_bytes())[0], None)


session.declare_subscriber("stock/sold", acknowledge)
while open_sales:
    for sale in list(open_sales.items()):
        session.put("stock/sale", json.dumps(sale))
        time.sleep(0.01)
    time.sleep(0.1)
session.close()
