"""What the coordinator refuses: counted, and told of on record without filling it.

Of the messages of a round with the same sender and reason the first is told of at once, with how it
begins, and how many more there were when the round ends or the wait goes on.
"""

from __future__ import annotations

from collections import Counter

from cubepath.agents.processes.judge import RefusedError
from cubepath.protocol.wire.keys import topic_in_key
from cubepath.protocol.wire.messages import Reason, Refused, encode
from cubepath.protocol.wire.nodes import Keep

_KINDS_MAX = 32
"""So many senders and reasons are told apart in a round."""
_OTHERS = "others"
_NAME_MAX, _KEY_MAX, _WHY_MAX, _SAMPLE_MAX = 64, 200, 400, 200


class Refusals:
    """The messages that were refused in a run."""

    def __init__(self) -> None:
        """Begin with none."""
        self.count = 0
        """How many there were so far."""
        self.last: Refused | None = None
        """The last that was told of in full."""
        self._known: dict[tuple[str, Reason], Refused] = {}
        self._more: Counter[tuple[str, Reason]] = Counter()
        self._round = -1

    def add(
        self, round_number: int, key: str, data: bytes, error: RefusedError
    ) -> list[Keep[Refused]]:
        """Count a message that was refused; return what there is to tell of it now."""
        told = [] if round_number == self._round else self._begin(round_number)
        self.count += 1
        topic = topic_in_key(key)
        who = topic.rpartition("/")[2][:_NAME_MAX]
        if (who, error.reason) not in self._known and len(self._known) >= _KINDS_MAX:
            who = _OTHERS
        kind = who, error.reason
        if kind in self._known:
            self._more[kind] += 1
            return told
        self._known[kind] = self.last = Refused(
            round=round_number,
            key=topic[:_KEY_MAX],
            who=who,
            reason=error.reason,
            why=str(error)[:_WHY_MAX],
            count=1,
            sample=data[:_SAMPLE_MAX].decode(errors="replace"),
        )
        return [*told, _keep(self.last)]

    def told(self) -> list[Keep[Refused]]:
        """Return how many more there were of each kind since this was asked."""
        found = []
        for kind, more in self._more.items():
            first = self._known[kind]
            found.append(
                _keep(Refused(first.round, first.key, first.who, first.reason, first.why, more))
            )
        self._more.clear()
        return found

    def _begin(self, round_number: int) -> list[Keep[Refused]]:
        found = self.told()
        self._known.clear()
        self._round = round_number
        return found


def _keep(refused: Refused) -> Keep[Refused]:
    return Keep(encode(refused), refused)
