"""What is missing of the numbered messages, and what is not checked without it.

Part of `cubepath verify`. Evidence that was lost on its way to the recording is no fault of a run:
where a message that would have carried the evidence is missing, nothing is claimed either way. A
contradiction is a failure in any case.
"""

from collections.abc import Iterable, Mapping

from cubepath.coordinator.verification.findings import StageFailures
from cubepath.coordinator.verification.number_table import Name, NumberTable
from cubepath.coordinator.verification.transcript import Fail
from cubepath.protocol.recordings.stored_messages import Record
from cubepath.protocol.wire import free_messages as free
from cubepath.protocol.wire.credentials import keeper_name, process_name
from cubepath.protocol.wire.outgoing_log import INCARNATIONS_OF_A_FLEET

_PROCESS = process_name(0)[:-1]


class Losses:
    """The messages that are missing, and the evidence that is lacking."""

    def __init__(self) -> None:
        self._transcript: dict[tuple[str, int], NumberTable] = {}
        """By sender and incarnation the hash of each message by its number."""
        self._last: dict[tuple[str, int], int] = {}
        """By sender and incarnation the greatest reported number."""
        self._speakers: dict[int, set[int]] = {}
        """By module the processes that spoke for it."""
        self._entered: dict[tuple[int, int], int] = {}
        """By module and epoch the incarnation in which it entered."""
        self._acted: dict[int, tuple[int, int]] = {}
        """By process, incarnation and number of the last message with which it did anything."""
        self._rested: dict[int, tuple[int, int]] = {}
        """By process the incarnation and the number at which it last reported that it rests."""
        self._lacking: dict[str, tuple[int, tuple[int, ...], str]] = {}

    def take(self, where: Record, message: free.FreeMessage, sender: str, fail: Fail) -> None:
        """Note the number of a message."""
        self._take_parts(message)
        number = getattr(message, "sequence", 0)
        if not number:
            return
        key = sender, getattr(message, "incarnation", 0)
        if number > self._last.get(key, 0):
            self._last[key] = number
        if isinstance(message, free.Halted | free.CommitLog):
            return
        # Only whether it is the same is asked, and that within one process: any hash will do.
        content = hash(where.data)
        hashes = self._transcript.get(key)
        if hashes is None:
            hashes = self._transcript[key] = NumberTable()
        if hashes.setdefault(number, content) != content:
            name, incarnation = key
            fail(
                "messages",
                f"{where}: message {number} of {name} in incarnation {incarnation} was another",
            )

    def _take_parts(self, message: free.FreeMessage) -> None:
        """Note the process of each module, the incarnation in which it entered, and who rests."""
        match message:
            case (
                free.Requests(process=process, parts=parts)
                | free.Turns(process=process, parts=parts)
            ):
                modules = [part.module for part in parts if not isinstance(part, free.TileQuery)]
                for module in modules:
                    self._speakers.setdefault(module, set()).add(process)
                if modules:
                    at = message.incarnation, message.sequence
                    self._acted[process] = max(self._acted.get(process, at), at)
            case free.Halted(process=process):
                at = message.incarnation, message.sequence
                self._rested[process] = max(self._rested.get(process, at), at)
            case free.Replies(parts=replies):
                for each in replies:
                    if isinstance(each, free.Entered):
                        occupant = each.occupant
                        self._entered[occupant.module, occupant.epoch] = each.incarnation
            case _:
                pass

    def of(self, sender: str) -> int:
        """Return how many messages of a sender are known to be missing."""
        return sum(
            last - len(self._transcript.get(key, ()))
            for key, last in self._last.items()
            if key[0] == sender
        )

    @property
    def count(self) -> int:
        """Return how many messages are known to be missing."""
        return sum(self.of(sender) for sender in {sender for sender, _ in self._last})

    @property
    def of_processes(self) -> bool:
        """Return whether anything is missing that a module process sent."""
        return any(self.of(sender) for sender, _ in self._last if sender.startswith(_PROCESS))

    def of_module(self, module: int) -> bool:
        """Return whether anything is missing that may have been sent for a module."""
        speakers = self._speakers.get(module)
        if speakers is None:
            return self.of_processes
        return any(self.of(process_name(process)) for process in speakers)

    def of_attempt(self, name: Name) -> bool:
        """Return whether what was asked for an attempt may be missing."""
        module, epoch, _ = name
        return self.of_module(module) or self.before(module, epoch)

    def of_keepers(self, keepers: Iterable[int]) -> bool:
        """Return whether anything is missing that one of these keepers sent."""
        return any(self.of(keeper_name(keeper)) for keeper in keepers)

    @property
    def processes(self) -> list[int]:
        """Return the processes that did anything."""
        return sorted(self._acted)

    def at_rest(self, process: int) -> bool:
        """Return whether a process reported in its last incarnation that it rests after all it did.

        If nothing is recorded of that incarnation, this counts as missing.
        """
        acted, rested = self._acted.get(process, (-1, 0)), self._rested.get(process)
        if rested is None or rested < acted:
            return False
        return acted[0] == rested[0] or rested[1] > 0

    def before(self, module: int, epoch: int) -> bool:
        """Return whether an epoch was one of a fleet before the last: its end may be cut off."""
        entered = self._entered.get((module, epoch), 0)
        return entered // INCARNATIONS_OF_A_FLEET < self._fleet()

    @property
    def resumed(self) -> bool:
        """Return whether the run was taken up again."""
        return self._fleet() > 0

    def _fleet(self) -> int:
        return (
            max((incarnation for _, incarnation in self._last), default=0)
            // INCARNATIONS_OF_A_FLEET
        )

    def lack(self, fail: Fail, check: str, why: str, *, excused: bool) -> None:
        """Note evidence that is not recorded: a failure, unless that is `excused`."""
        if not excused:
            fail(check, why)
            return
        position = fail.position if isinstance(fail, StageFailures) else ()
        count, known, first = self._lacking.get(check, (0, position, why))
        if position < known:
            known, first = position, why
        self._lacking[check] = count + 1, known, first

    @property
    def unchecked(self) -> Mapping[str, str]:
        """Return in one line why checks were not made everywhere, by their names."""
        return {
            check: f"not checked: {count} with messages that are missing, the first: {first}"
            for check, (count, _, first) in self._lacking.items()
        }
