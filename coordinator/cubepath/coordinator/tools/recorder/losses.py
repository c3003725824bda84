"""Which messages of a run, or of any publisher that numbers them, never arrived.

With rounds, a process says with `ready` how many messages it has sent to each region; without
rounds, senders number their messages. A publisher that adds zenoh's `SourceInfo` numbers its
messages as well. A message that arrives late is no longer missing.
"""

from collections import Counter

import msgspec

from cubepath.coordinator.tools.recorder.backlog import ReceivedMessage

_MISSING_MAX = 100_000
"""This many missing numbers of a sender are remembered; more are counted, and never come."""
_PHASES_MAX = 64


class Head(msgspec.Struct, gc=False):
    """What is read of a message of a run with rounds."""

    round: int = 0
    phase: str | None = None
    process: int = 0
    region: str = ""
    number: int = 0
    sent: dict[str, int] = {}


class _FreeHead(msgspec.Struct, gc=False):
    incarnation: int = 0
    sequence: int = 0


_head = msgspec.json.Decoder(Head).decode
_free_head = msgspec.json.Decoder(_FreeHead).decode
_NO_HEAD = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)


class _Numbers:
    """The numbers of one sender, from the first that was heard on."""

    def __init__(self, first: int) -> None:
        self._next = first + 1
        self._missing: set[int] = set()
        self._beyond = 0

    def take(self, number: int) -> None:
        if number < self._next:
            self._missing.discard(number)
            return
        gap = number - self._next
        if len(self._missing) + gap > _MISSING_MAX:
            self._beyond += gap
        else:
            self._missing.update(range(self._next, number))
        self._next = number + 1

    @property
    def missing(self) -> int:
        return len(self._missing) + self._beyond


class LossCounter:
    """Counts what is missing of a run, by sender."""

    def __init__(self, *, free: bool | None) -> None:
        """Begin with nothing heard, of a run without rounds or with them, or of no run (None)."""
        self._free = free
        self._sources: dict[str, _Numbers] = {}
        self._incarnations: dict[tuple[str, int], _Numbers] = {}
        self._numbers: dict[str, dict[tuple[int, str | None, str], set[int]]] = {}
        self._owed: dict[str, Counter[tuple[int, str | None, str]]] = {}
        self._reported: dict[str, int] = {}
        self._unreported: Counter[str] = Counter()
        self._first_round: int | None = None

    def take(self, topic: str, heard: ReceivedMessage) -> Head | None:
        """Note a message; return what was read of it, None if it is malformed."""
        if heard.source is not None:
            publisher, number = heard.source
            known = self._sources.get(publisher)
            if known is None:
                self._sources[publisher] = _Numbers(number)
            else:
                known.take(number)
        if self._free is None:
            return None
        kind, _, sender = topic.partition("/")
        try:
            if self._free:
                self._numbered(kind, sender, heard.data)
                return None
            head = _head(heard.data)
        except _NO_HEAD:
            return None
        if self._first_round is None:
            self._first_round = head.round
        match kind:
            case "bundle":
                self._take_number(sender, head)
            case "ready":
                self._take_ready(sender, head)
            case "reports":
                self._take_reports(sender, head.round)
            case _:
                pass
        return head

    def _numbered(self, kind: str, sender: str, data: bytes) -> None:
        head = _free_head(data)
        if not head.sequence or kind in (
            "halted",
            "commits",
        ):  # these tell the last number, and have none
            return
        key = sender, head.incarnation
        known = self._incarnations.get(key)
        if known is None:
            self._incarnations[key] = _Numbers(head.sequence)
        else:
            known.take(head.sequence)

    def _take_number(self, sender: str, head: Head) -> None:
        key = head.round, head.phase, head.region
        owed = self._owed.get(sender)
        if owed and owed[key] > 0:
            owed[key] -= 1
            return
        numbers = self._numbers.setdefault(sender, {})
        numbers.setdefault(key, set()).add(head.number)
        if len(numbers) > _PHASES_MAX * 64:
            numbers.clear()  # without a `ready` nothing tells what belongs to them

    def _take_ready(self, sender: str, head: Head) -> None:
        numbers = self._numbers.pop(sender, {})
        if head.round == self._first_round:
            return  # what was said before anyone listened is not lost
        for region, count in head.sent.items():
            key = head.round, head.phase, region
            missing = count - len(numbers.get(key, ()))
            if missing > 0:
                self._owed.setdefault(sender, Counter())[key] = missing

    def _take_reports(self, sender: str, number: int) -> None:
        before = self._reported.get(sender)
        if before is not None and number > before + 1:
            self._unreported[f"reports/{sender}"] += number - before - 1
        self._reported[sender] = max(number, before or 0)

    def by_sender(self) -> dict[str, int]:
        """Return how many messages are missing, by topic, sender or publisher."""
        found: Counter[str] = Counter(self._unreported)
        for sender, owed in self._owed.items():
            found[f"bundle/{sender}"] += owed.total()
        for (sender, _), numbers in self._incarnations.items():
            found[sender] += numbers.missing
        for publisher, numbers in self._sources.items():
            found[publisher] += numbers.missing
        return {each: found[each] for each in sorted(found) if found[each]}
