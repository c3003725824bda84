"""A module and what it is told: of its own attempt, and of those of earlier epochs."""

from cubepath.agents.free.config import HALT_S, FreeProcessConfig
from cubepath.agents.free.host_node import TICK_S_MAX, FreeHostNode
from cubepath.agents.keepers.journal import MemoryJournal
from cubepath.agents.keepers.keeper import Keeper
from cubepath.agents.keepers.node import KeeperNode
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.specs import scene_from_spec
from cubepath.protocol.wire.free_messages import (
    Attempt,
    EnterRequest,
    FreeMessage,
    Halted,
    Requests,
    RetransmitRange,
    Turn,
    Turns,
    decode_free,
    free_key,
)
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import Go, encode
from cubepath.protocol.wire.nodes import Effect, End, Node, Put, Timer


def host(scene: Scene, incarnation: int) -> FreeHostNode:
    """Return the process of the only module, born so often."""
    orders = FreeProcessConfig("", "run", 0, [0], 1, incarnation, "", "random", seed=3)
    return FreeHostNode(orders, scene)


def puts(effects: list[Effect]) -> list[Put]:
    """Return what is put."""
    return [effect for effect in effects if isinstance(effect, Put)]


def tell(node: Node, said: list[Put]) -> list[Put]:
    """Tell a node everything; return what it says to that."""
    return [put for each in said for put in puts(node.receive(each.key, each.data))]


def attempts(said: list[Put]) -> list[Put]:
    """Return what asks for a move."""
    return [put for put in said if any(isinstance(part, Attempt) for part in parts(put))]


def decoded(put: Put) -> FreeMessage:
    """Return the message that is put."""
    return decode_free(put.data)


def parts(put: Put) -> list[object]:
    """Return what is asked."""
    message = decoded(put)
    return [*message.parts] if isinstance(message, Requests) else []


def turns(put: Put) -> list[Turn]:
    """Return what a rule was asked."""
    message = decoded(put)
    return message.parts if isinstance(message, Turns) else []


def attempting(node: FreeHostNode, keeper: KeeperNode) -> list[Put]:
    """Start a process, and let it go on until its module attempts something; return that."""
    said = puts(node.start())
    while not attempts(said):
        told = tell(keeper, said)
        said = tell(node, told) or puts(node.tick())
    return attempts(said)


def test_a_refusal_of_an_earlier_epoch_is_none_of_this_one() -> None:
    """What its process asked before it died came late; the module waits for its own answer."""
    scene = scene_from_spec("agv:graph=grid4x4,n=1")
    keeper = KeeperNode(Keeper(0, scene, Tiles(scene.system, 1), MemoryJournal()), "run", [[0]])
    late = attempting(host(scene, 1), keeper)
    again = host(scene, 2)
    own = attempting(again, keeper)
    told = tell(keeper, late)
    said = tell(again, told)
    assert again.movers[0].state == "pending"
    assert not [part for put in said for part in parts(put) if isinstance(part, EnterRequest)]
    tell(again, tell(keeper, own))
    assert keeper.keeper.commits == 1


def test_a_process_ends_when_another_has_taken_its_place() -> None:
    """It learns that by the answer to its next attempt, and says nothing more."""
    scene = scene_from_spec("agv:graph=grid4x4,n=1")
    keeper = KeeperNode(Keeper(0, scene, Tiles(scene.system, 1), MemoryJournal()), "run", [[0]])
    before, after = host(scene, 1), host(scene, 2)
    late = attempting(before, keeper)
    attempting(after, keeper)
    (answer,) = tell(keeper, late)
    assert before.receive(answer.key, answer.data) == [Timer(None), End()]
    assert before.superseded
    assert not after.superseded


def test_both_say_again_what_they_are_asked_for() -> None:
    """Byte for byte, and what it is said to takes it as it takes what is doubled."""
    scene = scene_from_spec("agv:graph=grid4x4,n=1")
    keeper = KeeperNode(Keeper(0, scene, Tiles(scene.system, 1), MemoryJournal()), "run", [[0]])
    node = host(scene, 1)
    said = puts(node.start())
    own, its = list(said), list[Put]()
    while not attempts(said):
        told = tell(keeper, said)
        its += told
        said = tell(node, told) or puts(node.tick())
        own += said
    for sender, who, due in ((node, "process_0", own), (keeper, "keeper_0", its)):
        asked = RetransmitRange(who, 1, 1, len(due))
        assert puts(sender.receive(free_key("run", asked), encode(asked))) == due[1:]
    tell(node, tell(keeper, [*own, *own]))
    assert keeper.keeper.commits == 1


def test_modules_act_once_on_all_that_has_arrived() -> None:
    """However many messages tell of it: one message to the keeper, and one to the recorder."""
    scene = scene_from_spec("agv:graph=grid4x4,n=8")
    keeper = KeeperNode(
        Keeper(0, scene, Tiles(scene.system, 1), MemoryJournal()), "run", [list(range(8))]
    )
    node = FreeHostNode(
        FreeProcessConfig("", "run", 0, list(range(8)), 1, 1, "", "random", 3), scene
    )
    said = puts(node.start())
    while keeper.keeper.commits < 50:
        heard = [(put.key, put.data) for put in tell(keeper, said)]
        said = puts(node.receive_all(heard)) or puts(node.tick())
        choices = [turn.module for put in said for turn in turns(put)]
        assert sorted({*choices}) == sorted(choices)
        assert len(said) <= 2


def test_modules_that_were_halted_go_on_when_nobody_says_so_again() -> None:
    """Whoever halts them for the record to keep up may be dead."""
    scene = scene_from_spec("agv:graph=grid4x4,n=1")
    keeper = KeeperNode(Keeper(0, scene, Tiles(scene.system, 1), MemoryJournal()), "run", [[0]])
    node = host(scene, 1)
    for put in attempting(node, keeper):
        tell(node, tell(keeper, [put]))
    over = Go(7, "over")
    said = puts(node.receive(free_key("run", over), encode(over)))
    assert node.movers[0].halted
    while not (rests := [each for each in map(decoded, said) if isinstance(each, Halted)]):
        said = tell(node, tell(keeper, said)) or puts(node.tick())
    assert [rest.order for rest in rests] == [7]
    ticks = 0
    while node.movers[0].halted:
        node.tick()
        ticks += 1
    assert ticks >= HALT_S / TICK_S_MAX
