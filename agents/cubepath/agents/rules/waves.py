"""What spreads by notes, for any rule: a gradient with its tree, an election, and a token.

Each is a tuple of numbers that a rule puts into its note, and functions from what a module says and
hears to what it says next. They know no places and no clock, and remember nothing else, so they
hold in a module that is started again with its register. Modules name one another by their numbers.

Sources: Dolev, Israeli and Moran, Self-stabilization of dynamic systems assuming only read/write
atomicity (1993), for the gradient; Wagner, Lindenbaum and Bruckstein, Distributed covering by
ant-robots using evaporating traces (1999), for a token that goes where it has not been for longest.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from cubepath.agents.local.observation import Note
from cubepath.agents.rules.rule import InitialKnowledge

_BITS = 31
"""How many modules a number of a note has room for."""


class Gradient(NamedTuple):
    """How many hops a module is from the nearest source, and the next module on the way.

    In the first t rounds after modules have moved, or sources changed, for the last time, a module
    within t hops comes to know its distance, and others say t or more, whatever was said before. So
    after n rounds all is right, and following parents leads along shortest ways to the sources: a
    spanning tree, if there is one source. Without rounds it takes n turns of each module that see
    all that was written before.

    >>> root = Gradient.next(0, (), modules=3, source=True)
    >>> near = Gradient.next(2, (root,), modules=3)
    >>> near, root.children((near,))
    (Gradient(module=2, hops=1, parent=0), [2])
    """

    module: int
    """The module that sends this."""
    hops: int
    """To the nearest source; the number of modules if none is known."""
    parent: int
    """The neighbour that is one hop nearer, of several that of least number; else itself."""

    @classmethod
    def next(
        cls, module: int, heard: Iterable[Gradient], *, modules: int, source: bool = False
    ) -> Gradient:
        """Return what a module says next, from what its neighbours say."""
        own = cls(module, 0 if source else modules, module)
        # Hops that no source stands behind increase in every round, so they come to an end here.
        found = (cls(module, near.hops + 1, near.module) for near in heard)
        return min((own, *(each for each in found if each.hops < own.hops)), key=lambda it: it[1:])

    def children(self, heard: Iterable[Gradient]) -> list[int]:
        """Return the neighbours whose parent is this module, in order."""
        return sorted(near.module for near in heard if near.parent == self.module)


class Election(NamedTuple):
    """The least rank of which a module has heard, whose it is, and of whom it has heard.

    Ranks are drawn from the modules' own streams, so any may lead, and the seed decides which. As
    modules only gather what others say, one that has heard of all knows the same leader as all
    others that have, while modules move, whenever notes arrive, and if they arrive twice.

    >>> one, two = Election(9, 0, 0b01), Election(4, 1, 0b10)
    >>> (both := one.merged(two)), both.settled(2), both.settled(3)
    (Election(rank=4, leader=1, heard=3), True, False)
    >>> Election.of(both.note(modules=2)) == both
    True
    """

    rank: int
    leader: int
    heard: int
    """Bit i is 1 if something of module i is known."""

    @classmethod
    def begin(cls, knowledge: InitialKnowledge) -> Election:
        """Return what a module knows at first; ask once, since it draws the module's rank."""
        return cls(knowledge.stream.below(1 << _BITS), knowledge.module, 1 << knowledge.module)

    @classmethod
    def of(cls, note: Note) -> Election:
        """Read a note back."""
        heard = sum(bits << _BITS * index for index, bits in enumerate(note[2:]))
        return cls(note[0], note[1], heard)

    @staticmethod
    def note_length(modules: int) -> int:
        """Return the length of the notes."""
        return 2 + -(-modules // _BITS)

    def note(self, modules: int) -> Note:
        """Return it as a note of `note_length` numbers."""
        places = range(0, modules, _BITS)
        return (*self[:2], *(self.heard >> place & (1 << _BITS) - 1 for place in places))

    def merged(self, other: Election) -> Election:
        """Return what both together know."""
        return Election(*min(self[:2], other[:2]), self.heard | other.heard)

    def settled(self, modules: int) -> bool:
        """Return whether the leader is known for certain."""
        return self.heard == (1 << modules) - 1


class Token(NamedTuple):
    """The token as a module has seen it last; at any time at most one module has it.

    A module passes the token by naming a neighbour, and repeats that until the token comes back.
    The neighbour takes it when it hears this, and counts one more. So the module that is named with
    the greatest count has the token or will take it, and nobody else does: a lesser count by which
    a module is named is one that it has taken before. That holds with rounds or without, if notes
    are late, and if modules skip rounds, move, or start again with their registers. A token is
    delayed while the two are out of reach: pass it to a module that stands, and stand until then.

    It goes to the neighbour that has not had it for longest. If neighbours stay the same, a module
    that has had it k + 1 times, with k neighbours, knows that each of them has had it meanwhile,
    for none is passed over twice for the same one. So it comes to all, again and again; in a tree
    it goes along each edge both ways in 2 (n - 1) steps.

    >>> first, second = Token(0, 1, 0), Token(1, 0, 1)
    >>> passed = first.passed([second])
    >>> passed, passed.mine, second.taken([passed])
    (Token(module=0, passes=1, to=1), False, Token(module=1, passes=2, to=1))
    """

    module: int
    """The module that sends this."""
    passes: int
    """How often the token had been given when it came here; at first 1 with it, else 0."""
    to: int
    """To whom this module gave it; at first, or if it has it, itself."""

    @property
    def mine(self) -> bool:
        """Return whether the module has the token."""
        return self.passes > 0 and self.to == self.module

    def taken(self, heard: Iterable[Token]) -> Token:
        """Return it with the token, if a neighbour has passed it to this module."""
        counts = [near.passes for near in heard if near.to == self.module]
        newest = max(counts, default=0)
        return Token(self.module, newest + 1, self.module) if newest > self.passes else self

    def passed(self, among: Iterable[Token]) -> Token:
        """Return it with the token, if that is here, given to one of these neighbours."""
        oldest = min(among, key=lambda near: (near.passes, near.module), default=self)
        return self._replace(to=oldest.module) if self.mine else self
