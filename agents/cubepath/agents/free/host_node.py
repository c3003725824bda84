"""The node of a module process in a run without rounds: its modules, and what they sense.

It receives messages and ticks and returns effects. Its only notion of time is its ticks, each of
which arrives some time after the node asked for it; that is enough to know when to ask again.
"""

from cubepath.agents.free.config import HALT_S, FreeProcessConfig
from cubepath.agents.free.mover import Ask, Mover, paces
from cubepath.agents.free.sensing import Sensing
from cubepath.agents.rules.registry import rule_named
from cubepath.agents.rules.schedule import scheduled
from cubepath.protocol.core.sites import Site
from cubepath.protocol.core.system import Scene
from cubepath.protocol.scenes.toml import scene_from_toml
from cubepath.protocol.wire.free_messages import (
    Attempt,
    Decision,
    Entered,
    EnterRequest,
    Halted,
    Held,
    Hold,
    Replies,
    Requests,
    RetransmitRange,
    TileQuery,
    TileUpdate,
    Turn,
    Turns,
    heard_by_process,
    heard_of_tile,
    read_free,
)
from cubepath.protocol.wire.keys import Tiles
from cubepath.protocol.wire.messages import Go
from cubepath.protocol.wire.nodes import Effect, End, Ignore, Listen, Node, Timer
from cubepath.protocol.wire.outgoing_log import OutgoingLog

TICK_S_MIN, TICK_S_MAX = 0.002, 0.25
_SWEEP_S = 1.0
"""How often tiles that nobody needs are looked for."""


class FreeHostNode(Node):
    """The modules of one process."""

    def __init__(self, config: FreeProcessConfig, scene: Scene | None = None) -> None:
        """Read the scene and the rule; InputError if there is no such rule for it."""
        self._config = config
        self._scene = scene_from_toml(config.scene, "the configuration") if scene is None else scene
        self._tiles = Tiles(self._scene.system, config.keepers)
        schedule = config.schedule
        rule = (
            scheduled({})
            if schedule is not None
            else rule_named(config.rule, self._scene.system, "free")
        )
        self.movers = {
            module: Mover(
                self._scene,
                self._tiles,
                rule,
                module,
                incarnation=config.incarnation,
                seed=config.seed,
                hesitate=config.hesitate,
                pace=paces(config.speeds, config.jitter, module),
                own=None if schedule is None else schedule.get(module, []),
            )
            for module in config.modules
        }
        self.sensing = Sensing(self._scene.system, self._tiles)
        self.refused = 0
        """Messages that were none, or not for this process."""
        self._outgoing = OutgoingLog(config.run, config.incarnation)
        self._now_s = 0.0
        self._ends_s = float("inf")
        """When the timer runs out that is set."""
        self._swept_s = 0.0
        self._halts_s = float("inf")
        """Until when modules halt, if they do."""
        self._order: int | None = None
        """The order to halt that it must answer when its modules rest."""
        self._asks: list[Ask] = []
        self._needed: frozenset[str] = frozenset()
        self._due: dict[int, None] = dict.fromkeys(self.movers)

    def start(self) -> list[Effect]:
        """Listen, and let every module enter."""
        listen = Listen(heard_by_process(self._config.run, self._config.process))
        return [listen, *self._go_on()]

    def receive(self, key: str, data: bytes) -> list[Effect]:
        """Take a message; anything else has no effect except that it is counted."""
        message = read_free(self._config.run, key, data)
        match message:
            case TileUpdate():
                self._take(message)
            case Replies(process=process, parts=parts) if process == self._config.process:
                for part in parts:
                    self._told(part, message.keeper)
            case RetransmitRange():
                return list(self._outgoing.retransmit(message))
            case Go(phase="stop"):
                return [Timer(None), End()]
            case Go(phase="over", round=order):
                self._halt(order)
            case Go(phase="sense"):
                self._halt(None)
            case _:
                self.refused += 1
        return self._go_on()

    def _halt(self, order: int | None) -> None:
        """Halt all modules, or let them continue."""
        halted = order is not None
        for module, mover in self.movers.items():
            mover.halted = halted
            self._due[module] = None
        self._order = order
        # Who halts everybody and is not heard of again stops nobody for long.
        self._halts_s = self._now_s + HALT_S if halted else float("inf")

    def tick(self) -> list[Effect]:
        """Go on with what is due."""
        self._now_s = self._ends_s
        self._ends_s = float("inf")
        if self._now_s >= self._halts_s:
            self._halt(None)
        for module, mover in self.movers.items():
            if mover.due_s <= self._now_s:
                self._due[module] = None
        return self._go_on()

    def _take(self, shows: TileUpdate) -> None:
        if self._tiles.keeper_of_tile(shows.tile) != shows.keeper:
            self.refused += 1
            return
        changed, now_whole = self.sensing.take(shows, self._now_s)
        self._changed(changed, anything=now_whole)

    def _changed(self, places: list[Site], *, anything: bool = False) -> None:
        """Tell the modules concerned that something new is known of places."""
        for place in places:
            known = self.sensing.place(place)
            if known.module in self.movers and known.site is not None:
                self.movers[known.module].taken_to(known.site, known.module_version)
        if places or anything:
            for module, mover in self.movers.items():
                if anything or not mover.near.isdisjoint(places):
                    mover.dirty = True
                    self._due[module] = None

    def _told(self, part: Decision | Entered | Held, keeper: int) -> None:
        module = part.occupant.module if isinstance(part, Entered) else part.module
        mover = self.movers.get(module)
        if mover is None:
            self.refused += 1
            return
        if isinstance(part, Entered):
            mover.entered(part, self._now_s)
        elif isinstance(part, Held):
            self._changed(self.sensing.know(part.parts))
            self._asks += mover.held(part, keeper, self._now_s)
        else:
            self._asks += mover.decided(part, self._now_s)
        self._due[module] = None

    def _go_on(self) -> list[Effect]:
        effects: list[Effect] = []
        asks: dict[int, list[Attempt | EnterRequest | Hold | TileQuery]] = {}
        for keeper, part in self._asks:
            asks.setdefault(keeper, []).append(part)
        self._asks = []
        turns: list[Turn] = []
        due, self._due = self._due, {}
        for module in sorted(due):
            mover = self.movers[module]
            for keeper, part in mover.step(self._now_s, self.sensing):
                asks.setdefault(keeper, []).append(part)
            turns += mover.turns
            mover.turns = []
        effects += self._need()
        for tile, serial in self.sensing.due(self._now_s):
            keeper = self._tiles.keeper_of_tile(tile)
            asks.setdefault(keeper, []).append(TileQuery(tile, serial))
        process, outgoing = self._config.process, self._outgoing
        # What a rule chose is recorded before what follows from it.
        if turns:
            effects.append(outgoing.append(Turns(process, turns)))
        effects += (
            outgoing.append(Requests(process, keeper, parts)) for keeper, parts in asks.items()
        )
        if self._order is not None and all(mover.rests for mover in self.movers.values()):
            effects.append(outgoing.stamp(Halted(process, self._order)))
            self._order = None
        return effects + self._timer()

    def _need(self) -> list[Effect]:
        tiles = frozenset[str]().union(*(mover.needs for mover in self.movers.values()))
        if tiles == self._needed and self._now_s < self._swept_s + _SWEEP_S:
            return []
        self._needed, self._swept_s = tiles, self._now_s
        new, old = self.sensing.need(tiles, self._now_s)
        run = self._config.run
        effects: list[Effect] = []
        if new:
            effects.append(Listen(tuple(heard_of_tile(run, tile) for tile in new)))
        if old:
            effects.append(Ignore(tuple(heard_of_tile(run, tile) for tile in old)))
        return effects

    def _timer(self) -> list[Effect]:
        """Set the timer, if it is to run out sooner than it would."""
        next_s = min(mover.due_s for mover in self.movers.values())
        next_s = min(next_s, self.sensing.next_s)
        wait = min(max(next_s - self._now_s, TICK_S_MIN), TICK_S_MAX)
        if self._now_s + wait >= self._ends_s:
            return []
        self._ends_s = self._now_s + wait
        return [Timer(wait)]
