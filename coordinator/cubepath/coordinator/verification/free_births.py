"""Whether modules act in epochs in which they entered, and epochs grow with births.

Part of `cubepath verify`.
"""

from __future__ import annotations

from cubepath.coordinator.verification.free_transcript import FreeTranscript, Said, attempt_text
from cubepath.coordinator.verification.transcript import Fail, site_in
from cubepath.protocol.core.system import System
from cubepath.protocol.recordings.records import Record
from cubepath.protocol.wire.free_messages import Entered, Occupant
from cubepath.protocol.wire.tiles import Tiles


class Births:
    """The births and epochs of modules, as keepers tell of them."""

    def __init__(
        self, transcript: FreeTranscript, tiles: Tiles, system: System, fail: Fail
    ) -> None:
        """Begin with nothing told."""
        self._said, self._losses = transcript, transcript.losses
        self._tiles, self._place_of, self._fail = tiles, system.place_of, fail
        self._births: dict[int, dict[int, int]] = {}
        """By module the epoch of each birth."""

    def _lack(self, check: str, why: str, *, excused: bool) -> None:
        self._losses.lack(self._fail, check, why, excused=excused)

    def answered(self, said: Said, entered: Entered) -> None:
        """Check the answer to a module that asked where it stands."""
        occupant = entered.occupant
        if (occupant.module, entered.birth) not in self._said.entered:
            self._lack(
                "entries",
                f"{said.where}: module_{occupant.module} did not ask where it is",
                excused=self._losses.of_module(occupant.module)
                or self._losses.before(occupant.module, occupant.epoch),
            )
        if occupant.birth != entered.birth:
            self._fail("entries", f"{said.where}: birth {occupant.birth} is not the one answered")
        site = site_in(entered.site)
        processes = self._said.asked_by.get(occupant.module, ())
        if said.to not in processes:
            self._lack(
                "entries",
                f"{said.where}: process_{said.to} did not ask for it",
                excused=not processes and self._losses.of_module(occupant.module),
            )
        if site is not None and self._tiles.keeper_of(self._place_of(site)) != said.keeper:
            self._fail("entries", f"{said.where}: keeper_{said.keeper} does not have that place")

    def take(self, where: Record, occupant: Occupant) -> None:
        """Take note of the epoch of a birth."""
        known = self._births.setdefault(occupant.module, {0: 0})
        if known.setdefault(occupant.birth, occupant.epoch) != occupant.epoch:
            name = f"birth {occupant.birth} of module_{occupant.module}"
            self._fail("entries", f"{where}: {name} has epoch {occupant.epoch}, and another")

    def check(self) -> None:
        """Check all births that were told of, and the epochs of all attempts."""
        for module, known in sorted(self._births.items()):
            births = sorted(known)
            epochs = [known[birth] for birth in births]
            if sorted(set(epochs)) != epochs:
                self._fail("entries", f"module_{module}: its epochs do not grow with its births")
            for birth in births:
                if birth and (module, birth) not in self._said.entered:
                    self._lack(
                        "entries",
                        f"module_{module} has birth {birth}, for which it did not ask",
                        excused=self._losses.of_module(module)
                        or self._losses.before(module, known[birth]),
                    )
        for name in self._said.attempts:
            if name[1] not in self._births.get(name[0], {}).values():
                self._lack(
                    "entries",
                    f"{attempt_text(name)}: it never entered so",
                    excused=self._losses.of_keepers(range(self._tiles.keepers))
                    or self._losses.before(name[0], name[1]),
                )
