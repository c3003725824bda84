"""A store over zenoh: it adds up what tills sell, and acknowledges each sale."""

import json
import sys
import time

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([sys.argv[1]]))
session = zenoh.open(config)
sales: dict[int, int] = {}


def sell(sample: zenoh.Sample) -> None:
    """Add up a sale, once, and acknowledge it, whenever it comes."""
    number, amount = json.loads(sample.payload.to_bytes())
    if number not in sales:
        sales[number] = amount
    session.put("stock/sold", json.dumps([number, sum(sales.values())]))


session.declare_subscriber("stock/sale", sell)
while True:
    time.sleep(1)
