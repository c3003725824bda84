"""What the rules of vehicles share, with rounds and without: a goal, roads, and pushes."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Generic, Protocol, TypeAlias, TypeVar

from cubepath.agents.local.observation import View
from cubepath.agents.rules.graph_distances import roads_of
from cubepath.agents.rules.rule import InitialKnowledge
from cubepath.protocol.core.errors import InputError

NOWHERE = -1
"""In a note or a register, and for a vehicle: no vertex."""
Key: TypeAlias = tuple[int, ...]
"""The priority of a vehicle: the smaller key is stronger."""


class Push(Protocol):
    """What a note says of the push that its vehicle makes or follows."""

    @property
    def key(self) -> Key:
        """Return the key that the vehicle acts with."""
        ...

    @property
    def pusher(self) -> int:
        """Return where the vehicle stands that began the push."""
        ...

    @property
    def pushed(self) -> int:
        """Return the vertex next to it that it wants."""
        ...

    def pushes(self, at: int) -> bool:
        """Return whether the vehicle pushes from `at`, where it now stands."""
        ...


NoteT = TypeVar("NoteT")
PushT = TypeVar("PushT", bound=Push)


class Vehicle(Generic[NoteT]):
    """A vehicle that knows the roads and has one goal; vertices by number."""

    def __init__(self, rule: str, knowledge: InitialKnowledge, note: Callable[..., NoteT]) -> None:
        """Know the goal; InputError if the system has no graph, or there is not one goal."""
        graph = knowledge.system.graph
        if graph is None:
            raise InputError(f"rule {rule!r} is for vehicles on a graph")
        if len(knowledge.goals) != 1:
            raise InputError(
                f"rule {rule!r} needs one goal a vehicle, found {len(knowledge.goals)}:"
                " expected a list `goals` with one vertex for each"
            )
        self._graph = graph
        self._roads = roads_of(graph)
        self._knowledge = knowledge
        self._note = note
        self._goal = graph.index[knowledge.goals[0]]
        self._place = NOWHERE
        self._heard: dict[int, NoteT] = {}
        self._taken: set[int] = set()

    def _look(self, view: View) -> None:
        """Note where it stands, what it hears, and which neighbours are occupied."""
        index = self._graph.index
        self._place = index[view.place]
        self._heard = {index[place]: self._note(*note) for place, note in view.notes.items()}
        self._taken = {index[place] for place in view.occupied}

    def _lost(self) -> str | None:
        """Return why it gives up in its first round or turn, if there is no way to the goal."""
        if self._roads.distances(self._goal)[self._place] >= 0:
            return None
        here = self._graph.vertices[self._place]
        return f"no way from {here!r} to the goal {self._knowledge.goals[0]!r}"

    def _next(self, place: int, goal: int, taken: Collection[int]) -> int:
        """Return the next vertex on the way, an empty one if possible; at the goal the place."""
        ways = self._roads.nearer(place, goal)
        return min(ways, key=lambda way: (way in taken, way), default=place)

    def _action(self, view: View, to: int) -> int:
        """Return the action that enters a vertex; to stay, if that is not possible."""
        place_of, vertices = view.system.place_of, self._graph.vertices
        moves = (slot for slot, move in view.legal() if place_of(move.target) == vertices[to])
        return 0 if to == NOWHERE else next(moves, 0)


class PushedVehicle(Vehicle[PushT]):
    """A vehicle among pushes."""

    def _pushes(self, key: Key) -> list[PushT]:
        """Return the pushes that a vehicle with this key must follow."""
        return [
            note
            for at in self._roads.near[self._place]
            if (note := self._heard.get(at)) is not None
            and note.pushes(at)
            and note.key < key
            and self._place in self._roads.deeper(note.pusher, note.pushed, at)
        ]

    def _closed(self, key: Key) -> set[int]:
        """Return the vertices that are closed to a vehicle with this key."""
        return {
            vertex
            for at, note in self._heard.items()
            if note.key < key and note.pushes(at)
            for vertex in self._roads.deeper(note.pusher, note.pushed, at)
        }

    def _best(self, ways: Iterable[int], closed: Collection[int]) -> int:
        """Return the best of the empty vertices that are not closed."""
        distance = self._roads.distances(self._goal)

        def cost(vertex: int) -> tuple[int, int, float]:
            ahead = self._roads.nearer(vertex, self._goal)
            onward = sum(way not in self._heard for way in ahead)
            return distance[vertex], -onward, self._knowledge.random.random()

        free = (way for way in ways if way not in self._taken and way not in closed)
        return min(free, key=cost, default=NOWHERE)

    def _weaker(self, ways: Iterable[int], key: Key, target: int) -> int:
        """Return the way to push: `target` if that is allowed, else the first."""
        may = [way for way in ways if way in self._heard and self._heard[way].key >= key]
        return min(may, key=lambda way: way != target, default=NOWHERE)
