"""What a process has received and sent, by phase and region, until the phase is over.

A phase begins once everything sent in the previous one has arrived. A message that a receiver
missed is sent again.
"""

from collections.abc import Iterable

from cubepath.agents.processes.judge import Spoken
from cubepath.protocol.core.system import System
from cubepath.protocol.wire.keys import key_of, regions_near
from cubepath.protocol.wire.messages import Bundle, Part, Presence, Verdict, encode
from cubepath.protocol.wire.nodes import Put


class Inbox:
    """The messages of other processes, each once."""

    def __init__(self) -> None:
        self._heard: dict[tuple[int, Spoken], dict[tuple[str, int, int], Bundle]] = {}

    def knows(self, bundle: Bundle) -> bool:
        """Return whether a message of that number is kept already, whatever it holds."""
        kept = self._heard.get((bundle.round, bundle.phase), ())
        return (bundle.region, bundle.process, bundle.number) in kept

    def keep(self, bundle: Bundle) -> None:
        """Keep a bundle."""
        kept = self._heard.setdefault((bundle.round, bundle.phase), {})
        kept[bundle.region, bundle.process, bundle.number] = bundle

    def kept(self, round_number: int, phase: Spoken) -> list[Bundle]:
        """Return the bundles of a phase, in an order that does not depend on their arrival."""
        kept = self._heard.get((round_number, phase), {})
        return [kept[key] for key in sorted(kept)]

    def take(self, round_number: int, phase: Spoken) -> list[Bundle]:
        """Return the bundles of a phase, and keep them no longer."""
        found = self.kept(round_number, phase)
        self._heard.pop((round_number, phase), None)
        return found

    def counts(self, round_number: int, phase: Spoken) -> dict[str, int]:
        """Return by region how many messages of a phase are kept."""
        found: dict[str, int] = {}
        for region, _, _ in self._heard.get((round_number, phase), ()):
            found[region] = found.get(region, 0) + 1
        return found

    def forget_before(self, round_number: int) -> None:
        """Forget the bundles of earlier rounds."""
        self._heard = {key: kept for key, kept in self._heard.items() if key[0] >= round_number}


class Outbox:
    """The messages of a process's modules in a round."""

    def __init__(self, system: System, run: str, process: int, round_number: int) -> None:
        self._system = system
        self._run = run
        self._process = process
        self._regions_of = regions_near(system)
        self.begin(round_number)

    def begin(self, round_number: int) -> None:
        """Begin a round, in which nothing has been sent yet."""
        self._round = round_number
        self._sent: dict[str, dict[str, list[Put]]] = {}

    def say(self, phase: Spoken, parts: Iterable[Part]) -> list[Put]:
        """Say parts to the regions that they are addressed to, a message a region."""
        by_region: dict[str, list[Part]] = {}
        for part in parts:
            for region in self._regions(part):
                by_region.setdefault(region, []).append(part)
        sent = self._sent.setdefault(phase, {})
        found = []
        for region in sorted(by_region):
            puts = sent.setdefault(region, [])
            message = Bundle(
                round=self._round,
                phase=phase,
                process=self._process,
                region=region,
                number=len(puts),
                parts=by_region[region],
            )
            put = Put(key_of(self._run, message), encode(message))
            puts.append(put)
            found.append(put)
        return found

    def sent(self, phase: str) -> list[Put]:
        """Return all bundles of a phase: nothing, if it is not one to speak in."""
        return [put for puts in self._sent.get(phase, {}).values() for put in puts]

    def sent_to(self, phase: Spoken, region: str) -> list[Put]:
        """Return the bundles to a region in a phase."""
        return self._sent.get(phase, {}).get(region, [])

    def counts(self, phase: str) -> dict[str, int]:
        """Return by region how many messages were sent in a phase."""
        return {region: len(puts) for region, puts in self._sent.get(phase, {}).items()}

    def _regions(self, part: Part) -> frozenset[str]:
        system = self._system
        if isinstance(part, Verdict):
            return frozenset(system.region(place) for place in part.to)
        place = system.place_of(part.site)
        return self._regions_of(place, type(part) is Presence)
