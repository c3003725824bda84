"""What must follow from the claims of a round and the verdicts sent, and which module disagrees.

A module knows the claims that conflict with its own and receives the verdicts on those that outrank
it; the rest follows. A process that receives all of it can name the module that broke the rule.
"""

from collections.abc import Mapping, Sequence

from cubepath.agents.local.arbitration import (
    contest,
    outcome,
    priority,
    seed_in,
    site_after,
    verdict,
    waiting_for,
)
from cubepath.protocol.core.catalogue import Move
from cubepath.protocol.core.sites import Site
from cubepath.protocol.wire.messages import Report


class Settling:
    """The contests of a round, from all claims of it."""

    def __init__(
        self,
        claims: Mapping[int, Move],
        *,
        seed: int,
        round_number: int,
        later_seeds: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Find for each claim those that go before it, and the sites that wait for its verdict.

        `later_seeds` are as for `seed_in`.
        """
        seed = seed_in(round_number, seed, later_seeds)
        over: dict[Site, dict[int, Move]] = {}
        for module, claim in claims.items():
            for site in claim.action.support:
                over.setdefault(site, {})[module] = claim
        self.claims = claims
        self.before: dict[int, frozenset[int]] = {}
        """By module those whose claims conflict with its own and outrank it."""
        self.waiting: dict[int, frozenset[Site]] = {}
        """By module the sites from which its verdict is waited for."""
        for module, claim in claims.items():
            near: dict[int, Move] = {}
            for site in claim.action.support:
                near |= over[site]
            near.pop(module)
            found = contest(module, claim, near, seed=seed, round_number=round_number)
            self.before[module] = found.before
            self.waiting[module] = waiting_for(claim, [near[other] for other in found.after])
        self._ranked = sorted(
            claims, key=lambda module: priority(seed, round_number, module), reverse=True
        )

    def fault(
        self, verdicts: Mapping[int, bool], reports: Mapping[int, Report], sites: Mapping[int, Site]
    ) -> tuple[int, str] | None:
        """Return the first module whose verdict or report does not follow, and a line; or None.

        All verdicts that are waited for must be known, and the reports of all modules; `sites` are
        those at the beginning of the round. A module that received a false verdict and acted on it
        is not named, but the one that sent it is: it ranks before.
        """
        for module in self._ranked:
            due = verdict(self.before[module], verdicts)
            due_verdict = outcome(due)
            if verdicts.get(module, due) != due:
                return module, f"verdict of module_{module}: by those before it it is {due_verdict}"
            if reports[module].claim != due_verdict:
                return module, f"report of module_{module}: by those before it it is {due_verdict}"
        taken: dict[Site, Move] = {}
        for module in self._ranked:
            if reports[module].move is not None:
                taken |= {source: self.claims[module] for source, _ in self.claims[module].motion}
        for module, site in sites.items():
            due_site = site_after(site, [taken[site]] if site in taken else [])
            if reports[module].site != due_site:
                return module, f"report of module_{module}: the moves take it to {due_site!r}"
        return None
