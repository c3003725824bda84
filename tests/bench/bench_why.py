"""How near `cubepath simulate --why` comes to what twelve planted bugs did wrong, and how fast.

    python tests/bench/bench_why.py [BUG ...]

For each bug the first seed that fails is shrunk and explained. The guilty event is the first wrong
act of the bug without which the run holds; it ends with the first event that differs because of it.
*Named* is the event that decided it; if that is a fault, the last event too. *Distance* is in
events from the nearest of these, *seconds* are of processor time, shrinking not counted. Nothing is
random: the same code gives the same rows.
"""

import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from exploration.guilty_events import judged, planted


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    asked = list(sys.argv[1:] if arguments is None else arguments)
    names = [name for name in asked if name in planted()] or list(planted())
    print(
        f"{'bug':<22}{'seed':>6}{'events':>8}{'guilty':>12}{'named':>9}{'distance':>10}{'seconds':>9}"
    )
    near = 0
    for name in names:
        each = judged(name)
        named = ", ".join(map(str, each.named)) or "-"
        distance = "-" if each.distance is None else each.distance
        near += each.distance is not None and each.distance <= 10
        guilty = "-".join(map(str, each.guilty))
        print(
            f"{name:<22}{each.seed:>6}{each.events:>8}{guilty:>12}{named:>9}{distance:>10}"
            f"{each.seconds:>9.1f}",
            flush=True,
        )
    print(f"within ten events: {near} of {len(names)}")


if __name__ == "__main__":
    main()
