"""A keeper on the wire: what it refuses, and when it ticks."""

import pytest

from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import TICK_S, KeeperNode
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    CommitLog,
    CommitQuery,
    EnterRequest,
    Forwards,
    FreeMessage,
    Inquiry,
    Replies,
    Requests,
    TileQuery,
    decode_free,
    free_key,
)
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import MESSAGE_BYTES_MAX, Go, encode
from cubepath.protocol.wire.nodes import End, Listen, Put, Timer

SCENE = scene_from_spec("agv:graph=S3,n=2")


def node() -> KeeperNode:
    """Return the only keeper of a run in which each process has one module."""
    keeper = Keeper(0, SCENE, Tiles(SCENE.system, 1), MemoryJournal())
    return KeeperNode(keeper, "run", [[0], [1]])


def said(keeper: KeeperNode, message: FreeMessage) -> list[FreeMessage]:
    """Return what a keeper answers to a message on its key."""
    effects = keeper.receive(free_key("run", message), encode(message))
    return [decode_free(effect.data) for effect in effects if isinstance(effect, Put)]


def test_a_keeper_listens_answers_and_ends() -> None:
    """On its keys; to a process, and to the coordinator."""
    keeper = node()
    (listen,) = keeper.start()
    assert isinstance(listen, Listen)
    (tells,) = said(keeper, Requests(1, 0, [EnterRequest(1, 1)]))
    assert isinstance(tells, Replies)
    (tail,) = said(keeper, CommitQuery(0, 0))
    assert isinstance(tail, CommitLog)
    assert tail.refused == 0
    stop = Go(0, "stop")
    assert keeper.receive(free_key("run", stop), encode(stop)) == [Timer(None), End()]


@pytest.mark.parametrize(
    ("key", "data"),
    [
        ("cubepath/run/requests/0/process_1", b"{"),
        ("cubepath/run/requests/0/process_1", b" " * (MESSAGE_BYTES_MAX + 1)),
        (
            "cubepath/run/requests/0/process_1",
            b'{"kind":"requests","process":1,"keeper":0,"parts":[{}]}',
        ),
        ("cubepath/run/requests/0/process_0", encode(Requests(1, 0, [EnterRequest(1, 1)]))),
        ("cubepath/other/requests/0/process_1", encode(Requests(1, 0, [EnterRequest(1, 1)]))),
        ("cubepath/run/requests/0/process_0", encode(Requests(0, 0, [EnterRequest(1, 1)]))),
        ("cubepath/run/requests/0/process_0", encode(Requests(0, 0, [EnterRequest(7, 1)]))),
        ("cubepath/run/requests/1/process_0", encode(Requests(0, 1, [EnterRequest(0, 1)]))),
        ("cubepath/run/forwards/1/keeper_0", encode(Forwards(0, 1, [Inquiry(0, 0, 1)]))),
        ("cubepath/run/fetch/1/coordinator", encode(CommitQuery(1, 0))),
        ("cubepath/run/replies/0/keeper_0", encode(Replies(0, 0, []))),
        ("cubepath/run/requests/0/process_0", encode(Requests(0, 0, [TileQuery("1", -1)]))),
    ],
)
def test_what_is_no_message_to_it_is_counted_and_has_no_effect(key: str, data: bytes) -> None:
    """Cut off, too large, unknown, on another key, of another run, for others, of others."""
    keeper = node()
    tiles_of = keeper.keeper._tiles
    tiles_of.keepers = 2  # so that a tile may be elsewhere
    keeper.start()
    assert keeper.receive(key, data) == []
    assert keeper.keeper.refused == 1
    assert not keeper.keeper.units.occupant(SCENE.start[1]).incarnation  # type: ignore[union-attr]
    assert not keeper.keeper.commits


def test_what_arrives_together_is_answered_in_one_message_to_each() -> None:
    """A keeper with much to do says it in fewer messages, also when the run ends in between."""
    keeper = node()
    keeper.start()
    asked: list[FreeMessage] = [
        Requests(0, 0, [EnterRequest(0, 1)]),
        Requests(1, 0, [EnterRequest(1, 1)]),
        Requests(0, 0, [EnterRequest(0, 2)]),
        Go(0, "stop"),
        Requests(1, 0, [EnterRequest(1, 2)]),
    ]
    *told, timer, end = keeper.receive_all(
        [(free_key("run", each), encode(each)) for each in asked]
    )
    replies = [decode_free(put.data) for put in told if isinstance(put, Put)]
    assert [(each.process, len(each.parts)) for each in replies if isinstance(each, Replies)] == [
        (0, 2),
        (1, 1),
    ]
    assert (timer, end) == (Timer(None), End())


@pytest.mark.parametrize(
    "tile", ["", "**", "$*?", "a//b", "a#b", "elsewhere", "0,", "0\n", "0,0,0"]
)
def test_a_keeper_shows_nothing_of_what_is_no_tile(tile: str) -> None:
    """What is asked for becomes a key: no one asks for one that is not, or that all listen to."""
    keeper = node()
    assert said(keeper, Requests(0, 0, [TileQuery(tile, -1)])) == []
    assert keeper.keeper.refused == 1


def test_a_keeper_ticks_while_something_is_due() -> None:
    """One timer at a time."""
    keeper = node()
    keeper.keeper._owed = {1: []}
    effects = keeper.tick()
    assert effects == [Timer(TICK_S)]
    assert keeper.receive("no key", b"") == []
    assert keeper.tick() == [Timer(TICK_S)]
    keeper.keeper._owed = {}
    assert keeper.tick() == []
