"""What a link of a run under test costs, against a session that is at the router itself.

    python tests/bench/bench_link.py [--quick]

A session puts messages of about 300 bytes, and another hears them, both in this process, through a
private router: that is the floor. Then the same through a link, without rules, with one that meets
nothing but has to look at each message, and with one that doubles a message in a hundred. Times are
of this process, in microseconds of processor time a message; the ratio is to the floor of the same
run. The growth exponent is the slope of log time over log messages against the row before; linear
is 1. Medians of several; nothing is asserted.
"""

import argparse
import sys
import time
from collections.abc import Callable
from math import log
from pathlib import Path
from queue import SimpleQueue
from statistics import median

sys.path.append(str(Path(__file__).parents[1]))

from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.rules import Pattern, Rule
from cubepath.protocol.wire.credentials import COORDINATOR, Credentials
from cubepath.protocol.wire.messages import Go, encode
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, publisher, subscribe
from processes.ears import wait_for_subscriber

KEY = "cubepath/r/go/coordinator"
SIZES = (2_000, 8_000, 32_000)
QUICK_SIZES = (500, 1_000)
REPEATS = 5
_SETTLE_S = 0.5
_WIDTHS = (9, 9, 9, 7, 9, 7, 9, 7, 8)
Rules = Callable[[], list[Rule]]
CASES: dict[str, Rules | None] = {
    "floor": None,
    "link": list,
    "looks": lambda: [Rule(action="drop", pattern=Pattern(kind="bundle"))],
    "doubles": lambda: [Rule(action="double", probability=0.01)],
}


def microseconds(router: Router, count: int, rules: Rules | None) -> float:
    """Return the processor time a message, of so many that pass to a session."""
    lead = open_client(router.endpoint, credentials=router.credentials(COORDINATOR))
    mine: Credentials = router.credentials("process_0")
    link = None if rules is None else LinkProxy("process_0", router.endpoint, mine)
    process = open_client(router.endpoint if link is None else link.endpoint, credentials=mine)
    for rule in rules() if rules is not None and link is not None else ():
        link.add(rule) if link is not None else None
    came: SimpleQueue[int] = SimpleQueue()
    subscribe(process, KEY, lambda sample: came.put(len(sample.payload)))
    wait_for_subscriber(lead, KEY)
    time.sleep(_SETTLE_S)
    sent = [encode(Go(n, "claim", {f"{n},{x}": x for x in range(22)})) for n in range(count)]
    began = time.process_time()
    with publisher(lead, KEY) as declared:
        for each in sent:
            declared.put(each)
    for _ in sent:
        came.get(timeout=60)
    spent = time.process_time() - began
    process.close()
    lead.close()
    if link is not None:
        link.close()
    return spent / count * 1e6


def main() -> None:
    """Measure and print a table."""
    parser = argparse.ArgumentParser(description="What a link costs.")
    parser.add_argument("--quick", action="store_true", help="small sizes, once")
    quick = parser.parse_args().quick
    titles = ["messages", *(word for name in CASES for word in (name, "ratio"))]
    titles.remove("ratio")
    print(*(f"{title:>{w}}" for title, w in zip([*titles, "growth"], _WIDTHS, strict=True)))
    before: tuple[int, float] | None = None
    for count in QUICK_SIZES if quick else SIZES:
        with Router(processes=1) as router:
            found: dict[str, list[float]] = {name: [] for name in CASES}
            for _ in range(1 if quick else REPEATS):
                for name, rules in CASES.items():  # in turn, as the machine is noisy
                    found[name].append(microseconds(router, count, rules))
        floor = median(found["floor"])
        cells = [f"{count}", f"{floor:.1f}"]
        for name in list(CASES)[1:]:
            cells += [f"{median(found[name]):.1f}", f"{median(found[name]) / floor:.1f}"]
        total = count * median(found["link"])
        slope = "" if before is None else f"{log(total / before[1]) / log(count / before[0]):.2f}"
        before = count, total
        print(*(f"{cell:>{w}}" for cell, w in zip([*cells, slope], _WIDTHS, strict=True)))


if __name__ == "__main__":
    main()
