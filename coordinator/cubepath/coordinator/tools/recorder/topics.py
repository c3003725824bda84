"""Which messages of a run are recorded, and under which topic.

A topic is KIND/SENDER, as in the recording of the run itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.wire.free_messages import FREE_KINDS
from cubepath.protocol.wire.messages import KINDS

_KINDS = {*KINDS, *FREE_KINDS}
_SAID_TO = "to"
"""The first part of the keys of what is said to regions; the messages are of the kind `said`."""
_COORDINATOR = "coordinator"


def topic_in(key: str) -> str | None:
    """Return the topic of what is put on a key; None if no message of a run is put there.

    What the coordinator puts for one process alone repeats what it has told all.

    >>> topic_in("cubepath/0123456789ab/to/0,1/process_3")
    'said/process_3'
    """
    parts = key.split("/")
    if len(parts) < 4:
        return None
    kind = "said" if parts[2] == _SAID_TO else parts[2]
    if kind not in _KINDS or (kind in ("go", "reset") and parts[-1] != _COORDINATOR):
        return None
    return f"{kind}/{parts[-1]}"


class Topics:
    """Topics by key: None for what is not recorded."""

    def __init__(self, topics: Sequence[str] = (), exclude: Sequence[str] = ()) -> None:
        """Record what fits one of the globs `topics` (all, if there is none) and none of `exclude`.

        A glob without a slash is of the kind, and stands for all senders. InputError if one is
        empty, or matches no kind that there can be.
        """
        for each in (*topics, *exclude):
            if not each:
                raise InputError("topics: found an empty glob, expected one as 'said/*' or 'ready'")
            kind = each.partition("/")[0]
            if not any(fnmatchcase(known, kind) for known in _KINDS):
                near = did_you_mean(kind, _KINDS)
                raise InputError(f"topics {each}: no kind of messages matches{near}")
        self._topics = [_whole(each) for each in topics]
        self._exclude = [_whole(each) for each in exclude]
        self._known: dict[str, tuple[str | None, bool]] = {}

    def __bool__(self) -> bool:
        """Return whether some topics are left out."""
        return bool(self._topics or self._exclude)

    def of(self, key: str) -> tuple[str | None, bool]:
        """Return the topic of a key, and whether it is recorded."""
        known = self._known.get(key)
        if known is None:
            topic = topic_in(key)
            known = self._known[key] = topic, topic is not None and self.has(topic)
        return known

    def has(self, topic: str) -> bool:
        """Return whether messages of a topic are recorded."""
        wanted = not self._topics or any(fnmatchcase(topic, each) for each in self._topics)
        return wanted and not any(fnmatchcase(topic, each) for each in self._exclude)


def _whole(glob: str) -> str:
    return glob if "/" in glob else f"{glob}/*"
