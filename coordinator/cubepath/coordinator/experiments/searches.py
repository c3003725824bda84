"""What is found out of a scene after its runs were played: added to their rows."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator

from cubepath.coordinator.experiments.facts import SceneFacts
from cubepath.coordinator.experiments.playing import loaded_facts
from cubepath.coordinator.experiments.rows import AGAIN, Row
from cubepath.coordinator.experiments.setting import Batch

_SEARCHES = ("optimum", "improve")


def searching(batches: Iterable[Batch]) -> bool:
    """Return whether anything is searched for in scenes."""
    return any(getattr(batch.setting, name) for batch in batches for name in _SEARCHES)


def searched_again(batches: Iterable[Batch], rows: Iterable[Row]) -> Iterator[Row]:
    """Yield the rows of known runs for whose scenes more is searched now, with what is found.

    A row is as that of a run which is played with these searches, and keeps what was known.
    """
    known = {row["id"]: row for row in rows if row["ended"] not in AGAIN}
    for batch in batches:
        asked = {name: getattr(batch.setting, name) for name in _SEARCHES}
        for row in (known[each] for each in batch.ids() if each in known):
            told = json.loads(row["configuration"])
            if all(asked[name] <= told[name] for name in _SEARCHES):
                continue
            more = {name: max(asked[name], told[name]) for name in _SEARCHES}
            facts = loaded_facts(batch.setting, **more)
            configuration = json.dumps(told | more, sort_keys=True)
            yield row | _found(row, facts) | {"configuration": configuration}


def _found(row: Row, facts: SceneFacts) -> Row:
    """Return the columns of a row that follow from what is known of its scene."""
    if row["rounds"] is None:  # it failed
        cubes, bound = None, None
    else:
        cubes = row["cubes"] if row["goal"] else None
        bound = max(_known(row["bound"], facts.bound(cubes)), default=None)
    best = min(_known(row["best_known"], facts.best_found), default=None)
    optimum = next(iter(_known(facts.optimum, row["optimum"])), None)
    if optimum is None and bound is not None and bound in (best, cubes):
        optimum = bound
    return {"bound": bound, "best_known": best, "optimum": optimum}


def _known(*numbers: int | None) -> list[int]:
    return [each for each in numbers if each is not None]
