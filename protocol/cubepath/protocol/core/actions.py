"""Actions: placed generators, and the one definition of admissible and of commuting.

Source: Abrams and Ghrist, State Complexes for Metamorphic Robots, definitions of generator,
action and commuting. Knows nothing of lattices, modules or messages.
"""

from __future__ import annotations

from collections.abc import Iterable, Set as AbstractSet

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.sites import Site, in_order, site_text

State = AbstractSet[Site]
"""A state is the set of the sites that are on."""
_SETS = (frozenset, set)


class Action:
    """A placed generator: a support, a trace inside it, an unordered pair of local states.

    The sites of `support` must be as they are, those of `trace` may change, and `reads` is the
    support without the trace. `ends` holds, for each of the two local states, the sites of the
    support that are on, in a canonical order that does not depend on which was given first. Sites
    in `free` may be on or off; a pair ``(a, b)`` in `guards` says that if `a` is on then so is `b`
    (the dot and arrow of the paper's sliding squares). Two actions are equal iff support, trace,
    local states and these conditions are; `label` is for display only.
    """

    __slots__ = ("_hash", "ends", "free", "guards", "label", "reads", "support", "trace")

    support: frozenset[Site]
    trace: frozenset[Site]
    reads: frozenset[Site]
    ends: tuple[frozenset[Site], frozenset[Site]]
    free: frozenset[Site]
    guards: frozenset[tuple[Site, Site]]
    label: str

    def __init__(
        self,
        support: Iterable[Site],
        trace: Iterable[Site],
        before: Iterable[Site],
        after: Iterable[Site],
        *,
        free: Iterable[Site] = (),
        guards: Iterable[tuple[Site, Site]] = (),
        label: str = "",
    ) -> None:
        """Build an action; raise InputError for what contradicts the definition of a generator."""
        self.support = frozenset(support)
        self.trace = frozenset(trace)
        self.reads = self.support - self.trace
        first, second = frozenset(before), frozenset(after)
        self.free = frozenset(free)
        self.guards = frozenset(guards)
        self.label = label
        _check(self, first, second)
        # The sites that differ lie in the trace and never coincide, so their order decides.
        ordered = in_order(first - second), in_order(second - first)
        swap = _later(ordered[0], ordered[1])
        self.ends = (second, first) if swap else (first, second)
        self._hash = hash((self.support, self.trace, self.ends, self.free, self.guards))

    def labelled(self, label: str) -> Action:
        """Return an equal action with this label, without checking its definition again."""
        found = Action.__new__(Action)
        for name in Action.__slots__:
            setattr(found, name, getattr(self, name))
        found.label = label
        return found

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Action):
            return NotImplemented
        return (
            self._hash == other._hash
            and self.trace == other.trace
            and self.support == other.support
            and self.ends == other.ends
            and self.free == other.free
            and self.guards == other.guards
        )

    def __hash__(self) -> int:
        return self._hash

    def __repr__(self) -> str:
        return f"Action({self.label or in_order(self.trace)})"

    def __reduce__(self) -> tuple[object, ...]:
        # Hashes of strings differ from process to process: rebuild, do not copy the hash.
        return (
            _rebuild,
            ((self.support, self.trace, *self.ends, self.free), self.guards, self.label),
        )


def action_of_parts(
    support: frozenset[Site],
    trace: frozenset[Site],
    ends: tuple[frozenset[Site], frozenset[Site]],
    *,
    label: str = "",
) -> Action:
    """Return the action of parts that are known to fit the definition: nothing is checked.

    The two local states must be in canonical order; there are no free sites and no guards.
    """
    found = Action.__new__(Action)
    found.support, found.trace, found.ends, found.label = support, trace, ends, label
    found.reads = support - trace
    found.free = found.guards = frozenset()
    # A function beside the class, as `_rebuild` is: what is set here is the class's own.
    object.__setattr__(found, "_hash", hash((support, trace, ends, found.free, found.guards)))
    return found


class ActionContents(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True
):
    """An action as files list it: the sites of each part; decode it with `site_hook`."""

    support: tuple[Site, ...]
    trace: tuple[Site, ...]
    before: tuple[Site, ...]
    after: tuple[Site, ...]
    free: tuple[Site, ...] = ()
    guards: tuple[tuple[Site, Site], ...] = ()

    def action(self, label: str) -> Action:
        """Return the action; InputError for what contradicts the definition of a generator."""
        states = self.before, self.after
        return Action(
            self.support, self.trace, *states, free=self.free, guards=self.guards, label=label
        )


def contents_of(action: Action, *, reverse: bool = False) -> ActionContents:
    """Return an action's contents in canonical order; in `reverse` from its second local state."""
    before, after = action.ends[::-1] if reverse else action.ends
    return ActionContents(
        support=in_order(action.support),
        trace=in_order(action.trace),
        before=in_order(before),
        after=in_order(after),
        free=in_order(action.free),
        guards=in_order(action.guards),
    )


def _rebuild(
    sites: tuple[frozenset[Site], ...], guards: frozenset[tuple[Site, Site]], label: str
) -> Action:
    support, trace, before, after, free = sites
    return Action(support, trace, before, after, free=free, guards=guards, label=label)


def _later(first: tuple[Site, ...], second: tuple[Site, ...]) -> bool:
    return first != second and in_order([first, second])[0] == second


def _check(action: Action, before: frozenset[Site], after: frozenset[Site]) -> None:
    name = action.label or "an action"
    guarded = frozenset(site for pair in action.guards for site in pair)
    for what, sites in (
        ("the trace", action.trace),
        ("a local state", before | after),
        ("the free sites", action.free),
        ("a guard", guarded),
    ):
        if not sites <= action.support:
            stray = in_order(sites - action.support)[0]
            raise InputError(f"{name}: {what} holds {stray!r}, which is not in the support")
    if not action.trace:
        raise InputError(f"{name}: the trace is empty, a generator moves something")
    if before == after:
        raise InputError(f"{name}: the two local states are equal, a generator changes something")
    if action.free & (action.trace | before | after):
        stray = in_order(action.free & (action.trace | before | after))[0]
        raise InputError(f"{name}: site {stray!r} is free and in the trace or a local state")
    if guarded & action.trace:
        stray = in_order(guarded & action.trace)[0]
        raise InputError(f"{name}: guard site {stray!r} is in the trace, so undoing could fail")
    if not before ^ after <= action.trace:
        stray = in_order((before ^ after) - action.trace)[0]
        raise InputError(f"{name}: the local states differ at {stray!r}, which is off the trace")


def commute(one: Action, other: Action) -> bool:
    """Return whether neither action's trace meets the other's support (definition of commuting).

    This is the one definition: it decides safety among agents, cubes of the complex, and
    shortening. An action never commutes with itself.

    >>> one, other, far = (Action([x, y], [x, y], [x], [y]) for x, y in ("ab", "bc", "cd"))
    >>> commute(one, other), commute(one, far), commute(one, one)
    (False, True, False)
    """
    return one.trace.isdisjoint(other.support) and other.trace.isdisjoint(one.support)


def end_at(action: Action, state: State) -> int | None:
    """Return which of the action's two local states (0 or 1) `state` shows, or None.

    The cost is that of the support, whatever the size of the state.
    """
    fixed = action.support - action.free if action.free else action.support
    if type(state) in _SETS:  # they intersect much faster, at the cost of the smaller one
        shown = fixed.intersection(state)
    else:
        shown = frozenset([site for site in fixed if site in state])
    ends = action.ends
    index = 0 if shown == ends[0] else 1 if shown == ends[1] else None
    if index is None:
        return None
    for site, neighbour in action.guards:
        if site in state and neighbour not in state:
            return None
    return index


def admissible(action: Action, state: State) -> bool:
    """Return whether the action applies at the state: one of its local states is shown there.

    >>> step = Action(support=["a", "b"], trace=["a", "b"], before=["a"], after=["b"])
    >>> admissible(step, frozenset({"a", "c"})), admissible(step, frozenset({"a", "b"}))
    (True, False)
    """
    return end_at(action, state) is not None


def apply(action: Action, state: State) -> frozenset[Site]:
    """Return the state after the action; InputError if it is not admissible there.

    >>> step = Action(support=["a", "b"], trace=["a", "b"], before=["a"], after=["b"])
    >>> sorted(apply(step, frozenset({"a", "c"})))
    ['b', 'c']
    """
    result = set(state)
    apply_in_place(action, result)
    return frozenset(result)


def apply_in_place(action: Action, state: set[Site]) -> None:
    """Apply the action in place, at the cost of its support; InputError if not admissible."""
    index = end_at(action, state)
    if index is None:
        raise InputError(why_inadmissible(action, state))
    state -= action.ends[index]
    state |= action.ends[1 - index]


def why_inadmissible(action: Action, state: State) -> str:
    """Return one line on why the action is not admissible at the state, naming the first site.

    >>> step = Action(["a", "b"], ["a", "b"], ["a"], ["b"], label="step")
    >>> why_inadmissible(step, frozenset({"a", "b"}))
    "step is not admissible: site 'b' is on, expected off"
    """
    name = action.label or repr(action)
    wrong = [in_order((end ^ (action.support & state)) - action.free) for end in action.ends]
    sites = min(wrong, key=len)
    if sites:
        found, expected = ("on", "off") if sites[0] in state else ("off", "on")
        return f"{name} is not admissible: site {sites[0]!r} is {found}, expected {expected}"
    for site, neighbour in sorted(action.guards, key=site_text):
        if site in state and neighbour not in state:
            return f"{name} is not admissible: site {site!r} is on, so {neighbour!r} must be on"
    return f"{name} is admissible"
