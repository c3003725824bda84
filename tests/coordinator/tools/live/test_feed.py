"""The events of a run, put together again as a page does it."""

import json
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from cubepath.coordinator.tools.live.feed import Feed, FeedPosition
from cubepath.coordinator.tools.viewing.pages import pack, unpack
from cubepath.coordinator.tools.viewing.run_view import document_of
from cubepath.protocol.core.actions import end_at
from processes.watched_pages import KINDS, Watched, watched


class Follower:
    """Takes events as the page does, into a document of lists."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = unpack(pack(document))
        self.world = self.document["worlds"][0]
        self.path, self.normal = self.document["paths"]
        self.ended: dict[str, Any] | None = None

    def take(self, event: bytes) -> None:
        fields = dict(line.split(": ", 1) for line in event.decode().strip().split("\n"))
        told = json.loads(fields["data"])
        match fields["event"]:
            case "steps":
                self._steps(told)
            case "schedule":
                if "states" in told:
                    self.document["complex"]["paths"][1] = told.pop("states")
                self.normal |= told.pop("normal")
                self.path |= told
            case "end":
                self.ended = told
            case _:
                pass

    def _steps(self, told: dict[str, Any]) -> None:
        news = told["world"] or {}
        for part in ("sites", "rows"):
            for key, values in news.pop(part, {}).items():
                self.world[part][key] += values
        self.world |= news
        if "states" in told:
            states = self.document["complex"]["paths"][0]
            states[told["from"] + 1 :] = told["states"]
        del self.path["ends"][told["from"] :]
        del self.path["rows"][self.path["ends"][-1] if self.path["ends"] else 0 :]
        for rows in told["rows"]:
            self.path["rows"] += rows
            self.path["ends"].append(len(self.path["rows"]))


@contextmanager
def fed(found: Watched, step_name: str = "round") -> Generator[tuple[Feed, Follower]]:
    """Serve the feed of a scene to a follower."""
    feed = Feed(found.shown.scene, step_name=step_name)
    try:
        yield feed, Follower(feed.document)
    finally:
        feed.close()


def follow(feed: Feed, follower: Follower) -> None:
    place = FeedPosition()
    while (events := feed.next(place, 10)) is not None:
        for event in events:
            follower.take(event)


def same(one: Any, other: Any) -> bool:
    """Return whether two documents are the same but for the last digits of places."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    if isinstance(one, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) or isinstance(other, float):
        missing = [each is None or each != each for each in (one, other)]  # noqa: PLR0124 - nan
        return all(missing) or (not any(missing) and abs(one - other) < 1e-4)
    return bool(one == other)


@pytest.mark.few(2)
@pytest.mark.parametrize("spec", KINDS)
def test_events_lead_to_the_page_of_the_whole_run(spec: str, tmp_path: Path) -> None:
    """However the steps come in, what a page has at the end is the page of the recording."""
    found = watched(spec, tmp_path)
    steps = [tuple(step) for step in found.shown.steps]
    expected = unpack(pack(document_of([found.shown])))
    with fed(found, found.shown.step_name) as (feed, follower):
        for place in range(0, len(steps), 5):
            feed.give(place, steps[place : place + 5])
        feed.end({"ended": "max-rounds", "error": None})
        follow(feed, follower)
    assert follower.ended == {"ended": "max-rounds", "error": None}
    for key in ("claims", "heard"):
        assert not any(follower.path.pop(key).values())  # nobody has said anything
    for key in ("paths", "worlds", "names", "title", "beside", "format", "complex"):
        assert same(follower.document[key], expected[key]), key


def test_levels_that_are_known_otherwise_later_are_taken_back(tmp_path: Path) -> None:
    """Steps that take the place of others lead to the same page as if these had never been."""
    found = watched("hex:n=5", tmp_path)
    steps = [tuple(step) for step in found.shown.steps]
    short = [step for step in steps if step]
    with fed(found) as (feed, follower), fed(found) as (other, expected):
        feed.give(0, [*short[:3], ()])
        feed.give(3, [(), *short[3:]])
        feed.give(2, short[2:])
        other.give(0, short)
        for each, one in ((feed, follower), (other, expected)):
            each.end({"ended": "goal", "error": None})
            follow(each, one)
    assert same(follower.document["paths"], expected.document["paths"])


def test_who_comes_back_goes_on_where_it_was(tmp_path: Path) -> None:
    """Events are numbered from 1, and nobody gets one twice that says how many it has."""
    found = watched("hex:n=5", tmp_path)
    steps = [tuple(step) for step in found.shown.steps]
    with fed(found) as (feed, _):
        feed.give(0, steps[:2])
        place = FeedPosition()
        first = [event for event in feed.next(place, 10) or [] if event.startswith(b"id: ")]
        feed.give(2, steps[2:])
        feed.end({"ended": "goal", "error": None})
        events = list(first)
        while (more := feed.next(place, 10)) is not None:
            events += [event for event in more if event.startswith(b"id: ")]
        numbers = [int(event.split(b"\n")[0][4:]) for event in events]
        assert numbers == list(range(1, len(events) + 1))
        again = feed.next(FeedPosition(events=1), 10) or []
        assert [event for event in again if event.startswith(b"id: ")] == events[1:]


def test_what_is_no_step_is_told_where_the_feed_is_closed(tmp_path: Path) -> None:
    """A move that cannot be ends the feed, and whoever watches is not left waiting."""
    found = watched("hex:n=5", tmp_path)
    scene = found.shown.scene
    path = [action for step in found.shown.steps for action in step]
    early = next(action for action in path if end_at(action, scene.start_state) is None)
    feed = Feed(scene)
    feed.give(0, [(early,)])
    assert feed.next(FeedPosition(), 10) is None
    with pytest.raises(Exception, match="not a step"):
        feed.close()
