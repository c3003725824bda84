"""How near `compression` is to its distribution without rounds, by how long a turn takes.

    python tests/bench/bench_compression.py [--quick] [--time T]

The rows are mean latencies in mean waits, as `samples.slow_turns` plays them. The columns are the
total variation from the exact shares of rounds, up to symmetry: computed, and in a run with the
keeper that decides on the wire, with a 95% interval; and the share of attempts that it refused.
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from oracles.slow_compression import shares_without_rounds
from samples.compressed import distance, shares_up_to_symmetry, total_variation
from samples.slow_turns import shapes_in_turns

LATENCIES = (0.02, 0.1, 0.5, 2.0)
_BIAS = 4.0


def main() -> None:
    """Print a row for each latency."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three modules, a short run of each")
    parser.add_argument("--time", type=float, default=40_000, help="in mean waits")
    asked = parser.parse_args()
    count, end = (3, 200) if asked.quick else (4, asked.time)
    due = shares_up_to_symmetry(count, _BIAS)
    print(f"{'latency':>8} {'computed':>9} {'in a run':>18} {'refused':>8}")
    for latency in LATENCIES:
        computed = total_variation(shares_without_rounds(count, latency, _BIAS), due)
        shapes, refused = shapes_in_turns(count, latency, end=end, seed=1)
        found = distance([shapes], due)
        print(f"{latency:8g} {computed:9.4f} {found!s:>18} {refused:8.4f}", flush=True)


if __name__ == "__main__":
    main()
