"""A link between a process and the router: what passes, in which order, and what rules do to it."""

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue

import pytest
import zenoh

from cubepath.coordinator.testing.link import LinkProxy
from cubepath.coordinator.testing.rules import Pattern, Rule
from cubepath.coordinator.testing.wire_messages import WireMessage
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.wire.credentials import COORDINATOR
from cubepath.protocol.wire.messages import Ready, encode
from cubepath.protocol.wire.router import Router
from cubepath.protocol.wire.sessions import open_client, publisher, subscribe
from processes.ears import wait_for_subscriber

RUN = "cubepath/r"
UP, DOWN = f"{RUN}/ready/process_0", f"{RUN}/go/coordinator"
ENOUGH_S = 30.0
pytestmark = pytest.mark.slow


def ready(number: int) -> bytes:
    """Return a message of this round."""
    return encode(Ready(number, 0, "sense"))


class Ends:
    """A link with a session at each end, and what each of them hears of the other."""

    def __init__(self, router: Router, link: LinkProxy) -> None:
        self.link = link
        self.lead = open_client(router.endpoint, credentials=router.credentials(COORDINATOR))
        mine = router.credentials("process_0")
        self.process = open_client(link.endpoint, credentials=mine)
        self.heard: dict[str, SimpleQueue[bytes]] = {UP: SimpleQueue(), DOWN: SimpleQueue()}
        subscribe(self.lead, UP, lambda one: self.heard[UP].put(one.payload.to_bytes()))
        subscribe(self.process, DOWN, lambda one: self.heard[DOWN].put(one.payload.to_bytes()))
        wait_for_subscriber(self.lead, DOWN)
        self.until_heard(DOWN)
        self.until_heard(UP)

    def until_heard(self, key: str) -> None:
        """Say a word until it comes: from then on everything does."""
        for _ in range(100):
            self.say(key, b"a word")
            try:
                while self.heard[key].get(timeout=0.1) != b"a word":
                    pass
                break
            except Empty:
                continue
        time.sleep(0.1)
        while not self.heard[key].empty():
            self.heard[key].get()

    def say(self, key: str, *messages: bytes) -> None:
        with publisher(self.process if key == UP else self.lead, key) as declared:
            for each in messages:
                declared.put(each)

    def hear(self, key: str, count: int) -> list[bytes]:
        """Return the next messages; and a moment later no more have come."""
        found = [self.heard[key].get(timeout=ENOUGH_S) for _ in range(count)]
        time.sleep(0.1)
        assert self.heard[key].empty()
        return found

    def close(self) -> None:
        self.lead.close()
        self.process.close()


@pytest.fixture(scope="module")
def both_ends() -> Iterator[Ends]:
    """Return a link to a private router with a session at each end."""
    with (
        Router(processes=1) as router,
        LinkProxy("process_0", router.endpoint, router.credentials("process_0")) as link,
    ):
        found = Ends(router, link)
        yield found
        found.close()


@pytest.fixture
def ends(both_ends: Ends) -> Iterator[Ends]:
    """Return the link without rules, and take away those of the test."""
    yield both_ends
    both_ends.link.clear()


@pytest.mark.parametrize("key", [UP, DOWN])
@pytest.mark.parametrize("count", [2000, pytest.param(20_000, marks=pytest.mark.nightly)])
def test_everything_passes_once_and_in_order(ends: Ends, key: str, count: int) -> None:
    """Twenty thousand messages, with a rule that is asked about each and meets none."""
    ends.link.add(Rule(action="drop", pattern=Pattern(kind="bundle")))
    sent = [ready(number) for number in range(count)]
    ends.say(key, *sent)
    assert ends.hear(key, count) == sent
    ends.link.check()


@pytest.mark.few(10)
@pytest.mark.parametrize("key", [UP, DOWN])
@pytest.mark.parametrize(
    ("rule", "due"),
    [
        (Rule(action="drop", pattern=Pattern(round=2)), [0, 1, 3, 4, 5]),
        (Rule(action="drop", pattern=Pattern(round=range(1, 9)), times=2), [0, 3, 4, 5]),
        (Rule(action="drop", pattern=Pattern(phase="claim")), [0, 1, 2, 3, 4, 5]),
        (Rule(action="drop", after=4), [0, 1, 2, 3]),
        (Rule(action="double", pattern=Pattern(round=3)), [0, 1, 2, 3, 3, 4, 5]),
        (Rule(action="delay", pattern=Pattern(round=1), seconds=0.2), [0, 1, 2, 3, 4, 5]),
        (
            Rule(action="delay", pattern=Pattern(round=1), seconds=0.2, overtaken=True),
            [0, 2, 3, 4, 5, 1],
        ),
        (Rule(action="hold", pattern=Pattern(round=1), seconds=0.2), [0, 2, 3, 4, 5, 1]),
        (Rule(action="reorder", pattern=Pattern(round=1), by=2), [0, 2, 3, 1, 4, 5]),
        (Rule(action="reorder", pattern=Pattern(round=5)), [0, 1, 2, 3, 4, 5]),
        (Rule(action="double", pattern=Pattern(round=4), seconds=0.2), [0, 1, 2, 3, 4, 5, 4]),
        (Rule(action="drop", pattern=Pattern(where=lambda each: each.round == 0)), [1, 2, 3, 4, 5]),
    ],
    ids=lambda each: "" if isinstance(each, list) else str(each).partition(" at 0x")[0],
)
def test_a_rule_does_what_it_says_and_no_more(
    ends: Ends, key: str, rule: Rule, due: list[int]
) -> None:
    """To the messages that it means; all others keep their order."""
    rule = ends.link.add(replace(rule, count=0, met=deque()))
    ends.say(key, *map(ready, range(6)))
    assert ends.hear(key, len(due)) == [ready(number) for number in due]
    assert rule.count == len(rule.met)


def test_what_is_held_back_comes_when_the_rule_stops(ends: Ends) -> None:
    """In its order, behind what has passed meanwhile."""
    rule = ends.link.add(Rule(action="hold", pattern=Pattern(round=range(2))))
    ends.say(UP, *map(ready, range(4)))
    assert ends.hear(UP, 2) == [ready(2), ready(3)]
    rule.wait(2)
    rule.release()
    assert ends.hear(UP, 2) == [ready(0), ready(1)]
    ends.say(UP, ready(0))
    assert ends.hear(UP, 1) == [ready(0)]


@pytest.mark.few(1)
@pytest.mark.parametrize("keep", [False, True])
def test_nothing_passes_a_link_that_is_cut(ends: Ends, *, keep: bool) -> None:
    """What is said meanwhile is lost, or kept until it is healed; who is alive is not noticed."""
    token = ends.process.liveliness().declare_token(f"{RUN}/alive/process_0")
    until(lambda: alive(ends) == 1)
    ends.link.cut(keep=keep)
    for key in (UP, DOWN):
        ends.say(key, ready(1), ready(2))
        assert ends.hear(key, 0) == []
    token.undeclare()
    time.sleep(0.2)
    assert alive(ends) == 1
    ends.link.heal()
    until(lambda: alive(ends) == 0)
    for key in (UP, DOWN):
        ends.say(key, ready(3))
        assert ends.hear(key, 3 if keep else 1) == [
            ready(number) for number in ([1, 2, 3] if keep else [3])
        ]


def alive(ends: Ends) -> int:
    """Return how many processes the lead believes to be alive."""
    replies = ends.lead.liveliness().get(f"{RUN}/alive/*")
    return len({str(each.ok.key_expr) for each in replies if each.ok is not None})


def until(what: Callable[[], bool]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + ENOUGH_S
    while not what():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_who_joins_finds_the_run_and_has_its_answer(ends: Ends) -> None:
    """Tokens of others, and questions with their answers and refusals, pass as well."""
    token = ends.lead.liveliness().declare_token(f"{RUN}/alive/coordinator")

    def found() -> set[str]:
        replies = ends.process.liveliness().get("cubepath/*/alive/coordinator")
        return {str(each.ok.key_expr) for each in replies if each.ok is not None}

    until(lambda: found() == {f"{RUN}/alive/coordinator"})

    def answer(query: zenoh.Query) -> None:
        with query:
            if query.payload is not None and query.payload.to_bytes() == b"good":
                query.reply(query.key_expr, b"orders")
            else:
                query.reply_err(b"refused")

    key = f"{RUN}/orders/process_0"
    ends.lead.declare_queryable(key, answer)

    def asked(data: bytes) -> list[bytes]:
        replies = ends.process.get(key, payload=data, timeout=ENOUGH_S)
        return [(each.ok or each.err).payload.to_bytes() for each in replies]  # type: ignore[union-attr]

    until(lambda: bool(asked(b"good")))
    begun = time.monotonic()
    assert asked(b"good") == [b"orders"]
    assert asked(b"bad") == [b"refused"]
    assert time.monotonic() - begun < ENOUGH_S  # nobody waited for the answers to time out
    token.undeclare()
    until(lambda: not found())


def test_chance_meets_the_same_messages_whatever_the_order() -> None:
    """By the seed and their bytes; a repetition has another chance, so it gets through some day."""

    def met(order: range | list[int], seed: int) -> set[int]:
        rule = Rule(action="drop", probability=0.3, seed=seed)
        return {each for each in order if rule.meets(WireMessage(UP, ready(each)))}

    first = met(range(1000), 1)
    assert 250 < len(first) < 350
    assert met(list(reversed(range(1000))), 1) == first
    assert met(range(1000), 2) != first
    rule = Rule(action="drop", probability=0.5)
    times = [rule.meets(WireMessage(UP, ready(1))) for _ in range(100)]
    assert {True, False} == set(times)


def test_a_rule_remembers_so_many_messages_and_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """And a message that comes again before they are over has the chances that it has alone."""
    monkeypatch.setattr("cubepath.coordinator.testing.rules.COPIES_MAX", 10)
    alone, among = (Rule(action="drop", probability=0.5) for _ in range(2))
    fates = [alone.meets(WireMessage(UP, ready(1))) for _ in range(40)]
    found = []
    for round_ in range(40):
        found.append(among.meets(WireMessage(UP, ready(1))))
        for other in range(9):
            among.meets(WireMessage(UP, ready(2 + 9 * round_ + other)))
    assert found == fates
    assert len(among._copies) == 10


@pytest.mark.parametrize(
    ("where", "told"),
    [
        (lambda _: 1 // 0 > 0, "ZeroDivision"),
        (lambda _: pytest.fail("not this"), ".*not this"),  # which is no Exception
    ],
)
def test_a_rule_that_raises_is_told_and_the_message_passes(
    ends: Ends, where: Callable[[WireMessage], bool], told: str
) -> None:
    """With what it raised; the link goes on."""
    ends.link.add(Rule(action="drop", pattern=Pattern(where=where)))
    goes_on_and_tells(ends, f"^a rule of the link of process_0 raised {told}")


def test_what_a_link_raises_is_told_and_it_goes_on(ends: Ends) -> None:
    """A token or an answer that cannot be shown holds nothing else up."""
    ends.link.up.do(lambda: print(1 // 0))
    goes_on_and_tells(ends, r"^the link of process_0 raised ZeroDiv.* the way up$")


def goes_on_and_tells(ends: Ends, line: str) -> None:
    """Say a message, which passes; the link has a line on what was raised, until it is cleared."""
    ends.say(UP, ready(1))
    assert ends.hear(UP, 1) == [ready(1)]
    with pytest.raises(CheckError, match=line):
        ends.link.check()
    ends.link.clear()
    ends.link.check()


def test_a_rule_that_meets_too_little_says_what_it_met() -> None:
    """With the messages that were meant."""
    rule = Rule(action="drop", pattern=Pattern(kind="ready", sender="process_0"), after=1)
    assert not rule.meets(WireMessage(UP, ready(1)))
    line = "drop kind=ready, sender=process_0: met 0 messages within 0 s, expected 1; 1 were meant"
    with pytest.raises(CheckError, match=f"^{line}$"):
        rule.wait(timeout_s=0.0)


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"times": 0}, "times=0: expected 1 or more"),
        ({"after": -1}, "after=-1: expected 0 or more"),
        ({"probability": 0.0}, "probability=0.0: expected more than 0, at most 1"),
        ({"seconds": -1.0}, "seconds=-1: expected 0 to 3600 seconds"),
        ({"by": 0}, "by=0: expected 1 or more"),
    ],
)
def test_numbers_out_of_bounds_are_one_line(options: dict[str, float], line: str) -> None:
    """As everywhere."""
    with pytest.raises(InputError, match=f"^{line}$"):
        Rule(action="drop", **options)  # type: ignore[arg-type]


def test_an_unknown_kind_is_one_line_with_the_known_ones() -> None:
    """A rule that can meet nothing is a mistake."""
    with pytest.raises(InputError, match=r"^kind=calim: expected one of action, .*, claim, "):
        Pattern(kind="calim")


def test_nothing_is_left_of_a_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its socket is gone, also when it could not be opened."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with (
        Router(processes=1) as router,
        LinkProxy("process_0", router.endpoint, router.credentials("process_0")),
    ):
        assert len(list(tmp_path.iterdir())) == 2
    assert not list(tmp_path.iterdir())
    with pytest.raises(InputError, match=r"a link has no certificate"):
        LinkProxy("process_0", "tls/127.0.0.1:1")
