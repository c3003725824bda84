"""The events that a page receives during a run, in the order in which it applies them.

A thread of the feed makes events of the steps, once for all viewers, and takes a small share of the
time for that. A message may come after the step that it belongs to; then that step is sent again.
What strangers send to an open router, and what cannot be, is ignored.

The events and their data (fields of paths and worlds as in `page_document`):

- `steps`: `from`, how many steps stay; `rows` of each later step; `before`, the number of rounds
  before the page's first; `world`, null, or what is new in `sites` and `rows`, and changes of
  `box`, `behind`, `before` and `goal`; with a state complex `states` after these steps;
- `said`: `claims` and `heard`, lists of pairs of a step and three numbers an entry (`module`,
  `row`, `won`; `kind`, `from`, `to`); `kinds`, their names; `world` as above; `left_out` instead of
  `heard` after a million deliveries; `dropped`, the number of messages too many to follow;
- `schedule`: of all moves so far `level`, `partner`, `below`, `depth`, and the `normal`
  cube path; with a state complex the `states` along it;
- `state`: `paused`, `steps` still to be made, `rate`; not if the run can only be watched;
- `end`: `ended`, `error`.
"""

import threading
import time
from collections import deque
from collections.abc import Iterable, Sequence, Set as AbstractSet
from dataclasses import dataclass
from itertools import chain
from typing import Any, TypeAlias

import msgspec
import numpy as np

from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.plugins import plugin
from cubepath.coordinator.tools.viewing.run_view import (
    DELIVERIES_MAX,
    FORMAT,
    Entry,
    NumberedWorld,
    claim_entry,
    delivery_entries,
    path_document,
    title_of,
    waits_of,
)
from cubepath.protocol.core.actions import Action, apply_in_place, end_at, why_inadmissible
from cubepath.protocol.core.errors import CubepathError, InputError
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Commit,
    CommitLog,
    Decision,
    Forwarded,
    FreeMessage,
)
from cubepath.protocol.wire.messages import Claim, Message, Report

HEARD = ("claim", "report", "attempt", "forwarded", "decision", "commit", "commits")
"""The kinds of messages, and of their parts, that are of use here."""
_KEPT = 64
"""A step can be sent again until this many others have followed."""
_NO_SITE = (CubepathError, TypeError, ValueError, LookupError, AttributeError, OverflowError)
"""What systems raise for a value that is none of their sites."""
_Key: TypeAlias = tuple[int, ...]
Words: TypeAlias = Message | FreeMessage | Attempt | Forwarded | Decision
"""A message, or a part of one."""


class ClaimListener:
    """The claims and deliveries of a run, by the steps of a page, which count from 1."""

    def __init__(self, world: NumberedWorld, *, free: bool, before: int = 0) -> None:
        """Begin with nothing heard; this many rounds lie before the first step of the page."""
        self._world = world
        self._count = len(world.scene.start)
        self._free = free
        self._before = before
        self._top = 0
        """The greatest level of a move so far, without rounds."""
        self._claims: dict[int, dict[_Key, tuple[int, str, Site, Site]]] = {}
        """For each step its claims: the module, the generator, its place, and where it stands."""
        self._step_of: dict[_Key, int] = {}
        self._outcomes: dict[_Key, str] = {}
        self._heard: dict[int, dict[int, list[Entry]]] = {}
        self._kinds: dict[str, int] = {}
        self._deliveries = 0
        self._changed: set[int] = set()

    def begin(self) -> dict[str, Any]:
        """Return the fields of a path in which nothing was heard yet."""
        claims: dict[str, Any] = {"ends": [], "module": [], "row": [], "won": []}
        heard: dict[str, Any] = {"kinds": [], "ends": [], "kind": [], "from": [], "to": []}
        return {"claims": claims} if self._free else {"claims": claims, "heard": heard}

    def take(self, message: Words) -> None:
        """Take a message, or a part of one."""
        match message:
            case Claim():
                key = message.module, message.round
                self._claim(key, message.round - self._before, message)
            case Report():
                self._report(message)
            case CommitLog():
                for moved in message.parts:
                    self._moved(moved)
            case Commit():
                self._moved(message)
            case Forwarded():
                self._attempt(message.attempt)
            case Attempt():
                self._attempt(message)
            case Decision():
                self._decision(message)
            case _:
                pass

    def _attempt(self, attempt: Attempt) -> None:
        # It is sent before anybody can know its level: that is above all that it may have seen.
        if attempt.generator is not None:
            self._claim((attempt.module, attempt.epoch, attempt.number), self._top + 1, attempt)

    def _decision(self, decision: Decision) -> None:
        key = decision.module, decision.epoch, decision.number
        if decision.commit is not None:
            self._moved(decision.commit)
        elif key not in self._outcomes:
            self._came(key, "lost")

    def _moved(self, moved: Commit) -> None:
        self._top = max(self._top, moved.level)
        self._came((moved.module, moved.epoch, moved.number), "granted")

    def news(self, steps: int) -> dict[str, Any] | None:
        """Return what is new of the first this many steps; None if nothing is.

        Each list of ``claims`` and of ``heard`` is that of a whole step, three numbers for each
        entry. With more deliveries than a page holds there are none, and ``left_out`` has their
        number so far.
        """
        ready = sorted(step for step in self._changed if step <= steps)
        if not ready:
            return None
        self._changed.difference_update(ready)
        found: dict[str, Any] = {"claims": [self._claims_of(step) for step in ready]}
        if self._deliveries > DELIVERIES_MAX:
            found["left_out"] = self._deliveries
            self._heard.clear()
        elif not self._free:
            found["kinds"] = list(self._kinds)
            found["heard"] = [[step, self._heard_in(step)] for step in ready]
        for step in [step for step in self._claims if step <= steps - _KEPT]:
            self._forget(step)
        return found

    def _claims_of(self, step: int) -> list[Any]:
        claims = sorted(self._claims.get(step, {}).items())
        entries = (
            claim_entry(self._world, *claim, outcome=self._outcomes.get(key, ""))
            for key, claim in claims
        )
        return [step, list(chain.from_iterable(entry for entry in entries if entry is not None))]

    def _heard_in(self, step: int) -> list[int]:
        entries = chain.from_iterable(self._heard.get(step, {}).values())
        return list(chain.from_iterable(sorted(entries)))

    def _forget(self, step: int) -> None:
        for key in self._claims.pop(step):
            del self._step_of[key]
            self._outcomes.pop(key, None)
        self._heard.pop(step, None)

    def _claim(self, key: _Key, step: int, message: Claim | Attempt) -> None:
        if step < 1 or message.module >= self._count or key in self._step_of:
            return
        try:
            at, site = message.at, message.site
            self._world.scene.system.move_named(site, str(message.generator), at)
        except _NO_SITE:
            return
        self._step_of[key] = step
        claims = self._claims.setdefault(step, {})
        claims[key] = message.module, str(message.generator), at, site
        self._changed.add(step)

    def _came(self, key: _Key, outcome: str) -> None:
        if self._outcomes.get(key) != outcome and (not self._free or key in self._step_of):
            self._outcomes[key] = outcome
            if key in self._step_of:
                self._changed.add(self._step_of[key])

    def _report(self, report: Report) -> None:
        step, module = report.round - self._before, report.module
        if step < 1 or module >= self._count:
            return
        if report.claim != "none":
            self._came((module, report.round), report.claim)
        heard = self._heard.setdefault(step, {})
        if module in heard:
            return
        entries = [each for each in delivery_entries(report, self._kinds) if each[1] < self._count]
        self._deliveries += len(entries)
        heard[module] = entries if self._deliveries <= DELIVERIES_MAX else []
        self._changed.add(step)


_SITE = {"name": 1, "shape": 1, "at": 2, "to": 2, "colour": 1, "word": 1, "kind": 1, "point": 3}
"""The lists of sites, each with how many entries a site has."""
_FRAME = ("box", "behind", "before", "goal")
"""What changes when modules come to where none has been."""


class GrowingWorld:
    """A world, the state that its path has led to, and what was sent of it."""

    def __init__(self, scene: Scene) -> None:
        """Begin at the start, of which nothing was sent."""
        self.world = NumberedWorld(scene)
        self._state = set(scene.start_state)
        self._published: dict[str, Any] = {}

    def begin(self) -> dict[str, Any]:
        """Return the whole world; what is new is so from here on."""
        self._published = self.world.document()
        return self._published

    @property
    def state(self) -> AbstractSet[Site]:
        """The sites that are on where the path stands."""
        return self._state

    def follow(self, actions: Iterable[Action]) -> list[int]:
        """Return the rows of a step's moves; InputError if one is not admissible."""
        rows: list[int] = []
        for action in actions:
            end = end_at(action, self._state)
            if end is None:
                raise InputError(f"not a step: {why_inadmissible(action, self._state)}")
            rows.append(self.world.row(action, end))
            self._state -= action.ends[end]
            self._state |= action.ends[1 - end]
        return rows

    def go_back(self, steps: Iterable[Iterable[Action]]) -> None:
        """Stand where these steps lead from the start."""
        self._state = set(self.world.scene.start_state)
        for actions in steps:
            for action in actions:
                apply_in_place(action, self._state)

    def has_grown(self) -> bool:
        """Return whether there is anything to tell."""
        return self.world.counts != _counts(self._published)

    def grown(self) -> dict[str, Any] | None:
        """Return what has come to the world since it was asked last, as lists; None if nothing.

        Lists of ``sites`` and ``rows`` go behind those that are there, all else takes its place.
        """
        if not self.has_grown():
            return None
        before, self._published = self._published, self.world.document()
        now = self._published
        sites, rows = _counts(before)
        motions = int(before["rows"]["begins"][-1])
        found = now["rows"]
        return {
            "sites": {
                key: _listed(now["sites"][key][width * sites :]) for key, width in _SITE.items()
            },
            "rows": {
                "generators": found["generators"][len(before["rows"]["generators"]) :],
                "generator": _listed(found["generator"][rows:]),
                "at": found["at"][rows:],
                "begins": _listed(found["begins"][rows + 1 :]),
                "source": _listed(found["source"][motions:]),
                "target": _listed(found["target"][motions:]),
                "leg_begins": _listed(found["leg_begins"][motions + 1 :]),
                "legs": _listed(found["legs"][len(before["rows"]["legs"]) :]),
            },
            **{
                key: _listed(now[key])
                for key in _FRAME
                if _listed(now[key]) != _listed(before[key])
            },
        }


def _counts(document: dict[str, Any]) -> tuple[int, int]:
    """Return how many sites and rows a world has in a document."""
    return len(document["sites"]["name"]), len(document["rows"]["at"])


def _listed(found: Any) -> Any:
    return found.tolist() if isinstance(found, np.ndarray) else found


Steps = Sequence[tuple[Action, ...]]
SAID_MAX = 1_000_000
_EVENT_S = 0.05
_SHARE = 10
"""At least this many times as long as it took to make something, nothing is made again."""


@dataclass(slots=True)
class FeedPosition:
    """How much one who watches has seen; who comes back says how many `events` these are."""

    events: int = 0
    schedule: int = 0
    state: int = 0
    ended: bool = False


class Feed:
    """The events of a run.

    A page begins with `document`, in which nothing has moved, and takes all events from the first.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        step_name: str = "round",
        facts: Sequence[tuple[str, str]] = (),
        before: int = 0,
    ) -> None:
        """Begin at the start of the scene, where this many rounds lay before it already."""
        self._world = GrowingWorld(scene)
        self._hearing = ClaimListener(self._world.world, free=step_name == "level", before=before)
        space = self._space = plugin("state_space")(scene)
        self._states = [] if space is None else space.along([])
        empty = np.zeros(0, np.int64)
        path = path_document(self._world.world, 0, [], title="as executed", step_name=step_name)
        normal = path_document(self._world.world, 0, [], title="normal cube path", step_name="cube")
        self.document: dict[str, Any] = {
            "format": FORMAT,
            "title": title_of(scene),
            "facts": [[list(fact) for fact in facts]],
            "names": [""],
            "worlds": [self._world.begin()],
            "paths": [path | {"level": empty, "partner": empty} | self._hearing.begin(), normal],
            "beside": [0, 1],
            "complex": None if space is None else space.document([self._states] * 2),
        }
        self._before = before
        self._news = threading.Condition()
        self._given: list[tuple[int, Steps]] = []
        self._messages: deque[Words] = deque()
        self._dropped = 0
        self._steps: list[tuple[Action, ...]] = []
        self._events: list[bytes] = []
        self._schedule: tuple[int, bytes] = 0, b""
        self._state: tuple[int, bytes] = 0, b""
        self._end: dict[str, Any] | None = None
        self._ended = b""
        self._closed = False
        self._failed: BaseException | None = None
        self._thread = threading.Thread(target=self._work, name="cubepath-feed", daemon=True)
        self._thread.start()

    # For who has the run.

    def give(self, place: int, steps: Steps) -> None:
        """Hand over the steps from a place on, counted from 0; what was there before is gone."""
        with self._news:
            self._given.append((place, steps))
            self._news.notify_all()

    def hear(self, message: Words) -> None:
        """Hand over what a module has sent; it is sent with the step that it belongs to.

        Nobody waits for that: of more than `SAID_MAX` messages the oldest are dropped, and counted.
        """
        with self._news:
            self._messages.append(message)
            if len(self._messages) > SAID_MAX:
                self._messages.popleft()
                self._dropped += 1

    def tell(self, state: dict[str, Any]) -> None:
        """Tell how the run is paced, from now on."""
        with self._news:
            self._state = self._state[0] + 1, _event("state", state)
            self._news.notify_all()

    def end(self, ending: dict[str, Any]) -> None:
        """Say how the run has ended, after all steps and the schedule of them all."""
        with self._news:
            if self._end is None:
                self._end = ending
                self._news.notify_all()

    def close(self) -> None:
        """Feed nobody any more; raises what went wrong in the thread, if anything did."""
        with self._news:
            self._closed = True
            self._news.notify_all()
        self._thread.join()
        if self._failed is not None:
            raise self._failed

    # For who watches.

    def next(self, place: FeedPosition, timeout_s: float) -> list[bytes] | None:
        """Return what is new since a place, which continues; None if there will be no more.

        Waits this many seconds at most, and returns nothing then.
        """
        with self._news:
            self._news.wait_for(lambda: self._closed or self._is_new(place), timeout_s)
            found = self._events[place.events :]
            place.events = len(self._events)
            if place.schedule < self._schedule[0]:
                place.schedule, event = self._schedule
                found.append(event)
            if place.state < self._state[0]:
                place.state, event = self._state
                found.append(event)
            if self._ended and not place.ended:
                place.ended = True
                found.append(self._ended)
            return None if not found and (place.ended or self._closed) else found

    def _is_new(self, place: FeedPosition) -> bool:
        return (
            place.events < len(self._events)
            or place.schedule < self._schedule[0]
            or place.state < self._state[0]
            or bool(self._ended)
        )

    # In the thread of the feed.

    def _work(self) -> None:
        try:
            self._feed()
        except BaseException as error:  # noqa: BLE001 - it is raised where the feed is closed
            self._failed = error
            with self._news:
                self._closed = True
                self._news.notify_all()

    def _feed(self) -> None:
        shown = 0  # steps of which the schedule is told
        again = 0.0  # when it may be found again
        while True:
            with self._news:
                wait_s = None if shown == len(self._steps) else max(0.0, again - time.monotonic())
                self._news.wait_for(
                    lambda: self._closed or self._given or self._end is not None, wait_s
                )
                if self._closed:
                    return
                given, self._given = self._given, []
                messages, self._messages = self._messages, deque()
                ending = self._end
            begun = time.monotonic()
            for place, steps in _joined(given):
                shown = min(shown, place)
                self._take(place, steps)
            self._listen(messages)
            took_s = time.monotonic() - begun
            now = time.monotonic()
            if shown < len(self._steps) and (now >= again or ending is not None):
                shown = len(self._steps)
                self._find_schedule()
                again = time.monotonic() + _SHARE * (time.monotonic() - now)
            if ending is not None:
                with self._news:
                    if not self._given:
                        self._ended = _event("end", ending)
                        self._news.notify_all()
                        return
            elif given:
                with self._news:
                    self._news.wait_for(
                        lambda: self._closed or self._end is not None,
                        max(_EVENT_S, _SHARE * took_s),
                    )

    def _take(self, place: int, steps: Steps) -> None:
        if place < len(self._steps):
            del self._steps[place:]
            self._world.go_back(self._steps)
        self._steps += steps
        document: dict[str, Any] = {"from": place, "before": self._before, "rows": []}
        del self._states[place + 1 :]
        for actions in steps:
            document["rows"].append(self._world.follow(actions))
            if self._space is not None:
                self._states.append(self._space.number(self._world.state))
        if self._space is not None:
            document["states"] = self._states[place + 1 :]
        self._put("steps", document)

    def _listen(self, messages: Iterable[Words]) -> None:
        for message in messages:
            self._hearing.take(message)
        heard = self._hearing.news(len(self._steps))
        if heard is not None:
            self._put("said", heard | {"dropped": self._dropped})

    def _find_schedule(self) -> None:
        path = [action for actions in self._steps for action in actions]
        heap = FastHeap(telling=True)
        heap.extend(path)
        cubes, found = heap.cube_path(), heap.normal_form()
        waits = waits_of(path)
        normal = path_document(self._world.world, 0, cubes, title="", step_name="cube")
        if self._world.has_grown():
            self._put("steps", {"from": len(self._steps), "before": self._before, "rows": []})
        states = {} if self._space is None else {"states": self._space.along(cubes)}
        event = _event(
            "schedule",
            {
                "level": found.levels.tolist(),
                "partner": found.partners.tolist(),
                "below": waits.below.tolist(),
                "depth": waits.depths.tolist(),
                "normal": {key: normal[key].tolist() for key in ("ends", "rows", "below", "depth")},
                **states,
            },
        )
        with self._news:
            self._schedule = self._schedule[0] + 1, event
            self._news.notify_all()

    def _put(self, name: str, document: dict[str, Any]) -> None:
        number = b"id: %d\n" % (len(self._events) + 1)
        event = number + _event(name, document | {"world": self._world.grown()})
        with self._news:
            self._events.append(event)
            self._news.notify_all()


def _joined(given: Sequence[tuple[int, Steps]]) -> list[tuple[int, Steps]]:
    """Return the same steps with those in one that follow each other: the world is sent once."""
    found: list[tuple[int, list[tuple[Action, ...]]]] = []
    for place, steps in given:
        if found and place == found[-1][0] + len(found[-1][1]):
            found[-1][1].extend(steps)
        else:
            found.append((place, list(steps)))
    return [*found]


def _event(name: str, document: dict[str, Any]) -> bytes:
    """Return an event as a browser's EventSource reads it."""
    return b"event: %s\ndata: %s\n\n" % (name.encode(), msgspec.json.encode(document))
