"""Liars: processes of a simulated run that send false messages, and how each lie is detected.

A liar has the node of an honest process; its messages are changed on their way to the wire. The
same message is changed in the same way whenever it is repeated. A liar speaks only in its own name,
as routers ensure, so it publishes on no key of another.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from random import Random
from typing import TypeAlias, TypeVar

from msgspec.structs import replace

from cubepath.coordinator.simulation.faults import SAYS, Fault, Faults
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.keys import key_of
from cubepath.protocol.wire.nodes import Effect, Node, Put

_FLOOD = 40
"""How many messages a flood has."""
_OLD_MAX = 50

_T = TypeVar("_T")
_Tell: TypeAlias = Callable[[str, Fault], object]


class Liar:
    """A node that tells lies where `faults` say so."""

    def __init__(
        self,
        node: Node,
        name: str,
        *,
        run: str,
        scene: Scene,
        faults: Faults,
        counts: Counter[str],
        tell: _Tell,
    ) -> None:
        """Lie in the name of this process; `counts` continues when the process comes back."""
        self._node = node
        self._name = name
        self._run = run
        self._scene = scene
        self._faults = faults
        self._counts = counts
        self._tell = tell
        self._versions: dict[bytes, list[Put]] = {}
        self._old: list[Put] = []
        self._silent: Counter[tuple[int, str, str]] = Counter()
        """By round, phase and region how many messages it keeps to itself, and does not count."""

    def start(self) -> list[Effect]:
        """Begin."""
        return self._changed(self._node.start())

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message."""
        return self._changed(self._node.receive(key, data))

    def tick(self) -> list[Effect]:
        """Note that the timer has run out."""
        return self._changed(self._node.tick())

    def _changed(self, effects: list[Effect]) -> list[Effect]:
        found: list[Effect] = []
        for effect in effects:
            if isinstance(effect, Put):
                found += self._sent(effect)
            else:
                found.append(effect)
        return found

    def _sent(self, put: Put) -> list[Put]:
        known = self._versions.get(put.data)
        if known is None:
            known = self._versions[put.data] = self._first_sent(put)
            self._old = [*self._old[-_OLD_MAX:], put]
        return known

    def _first_sent(self, put: Put) -> list[Put]:
        message = self._without_the_silent(wire.decode(put.data))
        where = self._name + SAYS
        nth = self._counts[where]
        self._counts[where] += 1
        fault = self._faults.at(where, nth, possible_lies(message))
        if fault is None:
            return self._puts(message)
        random = Random(f"{where}/{nth}/{fault.kind}")  # noqa: S311 - not for secrets
        lie = self._lie(fault.kind, message, random)
        if lie is None:
            return self._puts(message)
        self._tell(self._name, fault)
        return lie

    def _without_the_silent(self, message: wire.Message) -> wire.Message:
        if not isinstance(message, wire.Ready):
            return message
        counts = {
            region: count - self._silent[message.round, message.phase, region]
            for region, count in message.sent.items()
        }
        return replace(message, sent={region: n for region, n in counts.items() if n})

    def _puts(self, *messages: wire.Message) -> list[Put]:
        return [Put(key_of(self._run, each), wire.encode(each)) for each in messages]

    def _lie(self, kind: str, message: wire.Message, random: Random) -> list[Put] | None:
        """Return what is put instead; None if there is no such lie about this message."""
        true = self._puts(message)
        match kind:
            case "lie-withhold":
                return []
            case "lie-double":
                return [*true, *true]
            case "lie-old" if self._old:
                return [*true, random.choice(self._old)]
            case "lie-flood":
                return [*true, *self._flood(message, random)]
            case _:
                changed = self._other(kind, message, random)
                return None if changed in (None, [message]) else self._puts(*changed or [])

    def _flood(self, message: wire.Message, random: Random) -> list[Put]:
        found = [Put(f"{self._puts(message)[0].key}", random.randbytes(9)) for _ in range(3)]
        if isinstance(message, wire.Bundle):
            more = [replace(message, number=random.randrange(1 << 20)) for _ in range(_FLOOD)]
            return [*found, *self._puts(*more)]
        if isinstance(message, wire.Ready):
            again = wire.Retransmit(message.round, message.process, "sense", "0")
            return [*found, *self._puts(*[again] * _FLOOD)]
        return [*found, *self._puts(*[message] * _FLOOD)]

    def _other(self, kind: str, message: wire.Message, random: Random) -> list[wire.Message] | None:
        match message:
            case wire.Bundle():
                return self._other_bundle(kind, message, random)
            case wire.Reports(parts=parts):
                place = random.randrange(len(parts))
                other = self._other_report(kind, parts[place], random)
                return [replace(message, parts=_with(parts, place, other))]
            case wire.Ready(sent=counts) if kind == "lie-count":
                region = random.choice([*counts, "0"])
                count = max(0, counts.get(region, 0) + random.choice((-1, 1, 2)))
                return [replace(message, sent={**counts, region: count})]
            case _:
                return None

    def _other_bundle(
        self, kind: str, bundle: wire.Bundle, random: Random
    ) -> list[wire.Message] | None:
        if kind == "lie-silence":
            self._silent[bundle.round, bundle.phase, bundle.region] += 1
            return []
        parts = bundle.parts
        place = random.randrange(len(parts))
        if kind == "lie-part":
            return [replace(bundle, parts=[*parts[:place], *parts[place + 1 :]])]
        other = self._other_part(kind, parts[place], random)
        return [replace(bundle, parts=_with(parts, place, other))]

    def _other_part(self, kind: str, part: wire.Part, random: Random) -> wire.Part:  # noqa: PLR0911 - by kind
        match part, kind:
            case _, "lie-site":
                return replace(part, site=self._site(random))
            case _, "lie-other":
                return replace(part, module=random.randrange(len(self._scene.start)))
            case wire.Claim(), "lie-claim":
                move = self._move(part.site, random)
                return replace(part, generator=move.generator, at=move.at)
            case wire.Presence(), "lie-claim":  # before its time
                move = self._move(part.site, random)
                return wire.Claim(part.round, part.module, part.site, move.generator, move.at)
            case wire.Verdict(granted=granted, to=to), "lie-verdict":
                other = self._scene.system.place_of(self._site(random))
                turned = random.randrange(3) > 0
                return replace(
                    part, granted=granted ^ turned, to=to if turned else [other, *to[1:]]
                )
            case wire.Note(note=note), "lie-note" if note:
                place = random.randrange(len(note))
                return replace(part, note=_with(note, place, random.randrange(-5, 50)))
            case _:
                return part

    def _other_report(self, kind: str, report: wire.Report, random: Random) -> wire.Report:
        match kind:
            case "lie-site":
                return replace(report, site=self._site(random))
            case "lie-other":
                return replace(report, module=random.randrange(len(self._scene.start)))
            case "lie-heard":
                kinds = [*report.received, "presence", "claim"]
                heard = {**report.received, random.choice(kinds): [random.randrange(3)]}
                return replace(report, received=heard)
            case "lie-report":
                return self._other_move(report, random)
            case _:
                return report

    def _other_move(self, report: wire.Report, random: Random) -> wire.Report:
        if report.move is not None and random.randrange(2):
            claim = random.choice(("none", "lost"))
            return replace(report, move=None, claim=claim, site=report.before)
        move = self._move(report.before, random)
        return replace(report, claim="granted", move=move, site=self._target(report.before, move))

    def _site(self, random: Random) -> object:
        """Return some site near which modules are, or one of them."""
        system = self._scene.system
        site = random.choice(self._scene.start)
        targets = [move.target for move in system.moves(site) if move is not None]
        return random.choice([site, *targets])

    def _move(self, site: object, random: Random) -> GeneratorPlacement:
        moves = [move for move in self._scene.system.moves(site) if move is not None]
        if not moves:
            return GeneratorPlacement("none", 0)
        move = random.choice(moves)
        return GeneratorPlacement(move.generator, move.at)

    def _target(self, site: object, placed: GeneratorPlacement) -> object:
        moves = self._scene.system.moves(site)
        named = (move for move in moves if move is not None and move.generator == placed.generator)
        return next((move.target for move in named if move.at == placed.at), site)


_ABOUT = {
    "presence": "lie-claim",
    "note": "lie-note",
    "claim": "lie-claim",
    "verdict": "lie-verdict",
}
"""The lie that there is about a kind of part alone; instead of where it is a module may claim."""


def possible_lies(message: wire.Message) -> Sequence[str]:
    """Return the kinds of lies that there are about a message."""
    anything = ("lie-withhold", "lie-double", "lie-old", "lie-flood")
    match message:
        case wire.Bundle(parts=parts):
            about = ["lie-site", "lie-other", "lie-part", "lie-silence"]
            about += sorted({_ABOUT[wire.kind_of(part)] for part in parts})
            return (*anything, *about)
        case wire.Reports():
            return (*anything, "lie-site", "lie-other", "lie-report", "lie-heard")
        case wire.Ready():
            return (*anything, "lie-count")
        case _:
            return anything


def _with(values: Sequence[_T], place: int, value: _T) -> list[_T]:
    return [*values[:place], value, *values[place + 1 :]]
