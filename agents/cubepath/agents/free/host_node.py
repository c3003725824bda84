"""The node of a module process in a run without rounds: its modules, and what they sense.

It receives messages and ticks and returns effects. Its only notion of time is its ticks, each of
which arrives some time after the node asked for it; that is enough to know when to ask again.
"""

from collections.abc import Iterable, Sequence
from typing import get_args

from cubepath.agents.free.config import HALT_S, FreeProcessConfig
from cubepath.agents.free.mover import Mover, Pace, State
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
from cubepath.protocol.wire.nodes import BatchNode, Effect, End, Ignore, Listen, Timer
from cubepath.protocol.wire.outgoing_log import OutgoingLog

TICK_S_MIN, TICK_S_MAX = 0.002, 0.25
_SWEEP_S = 1.0
"""How often tiles that nobody needs are looked for."""


class FreeHostNode(BatchNode):
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
                pace=Pace(config.speeds.get(module, 0.0), config.jitter),
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
        self._news: set[Site] = set()
        """Places of which something new is known; with `_all_news` any place may be one."""
        self._all_news = False
        self._needs: dict[int, frozenset[str]] = {}
        """The tiles that each module needs."""
        self._due: dict[int, None] = dict.fromkeys(self.movers)
        self.superseded = False
        """Whether another process has entered for a module of this one, which ends it."""

    @property
    def state(self) -> State:
        """Return the state of its modules that is last in the order of `State`."""
        states = {mover.state for mover in self.movers.values()}
        return next(state for state in reversed(get_args(State)) if state in states)

    def start(self) -> list[Effect]:
        """Listen, and let every module enter."""
        listen = Listen(heard_by_process(self._config.run, self._config.process))
        return [listen, *self._go_on()]

    def receive_all(self, messages: Sequence[tuple[str, bytes]]) -> list[Effect]:
        """Take messages, and let the modules act once on all that is known then.

        Anything else has no effect except that it is counted.
        """
        effects: list[Effect] = []
        for key, data in messages:
            match read_free(self._config.run, key, data):
                case TileUpdate() as shows:
                    self._take(shows)
                case Replies(process=process) as replies if process == self._config.process:
                    for part in replies.parts:
                        self._take_reply(part)
                case RetransmitRange() as asked:
                    effects += self._outgoing.retransmit(asked)
                case Go(phase="stop"):
                    return [Timer(None), End()]
                case Go(phase="over", round=order):
                    self._halt(order)
                case Go(phase="sense"):
                    self._halt(None)
                case _:
                    self.refused += 1
        return effects + self._go_on()

    def _halt(self, order: int | None) -> None:
        """Halt all modules, or let them continue."""
        halted = order is not None
        for module, mover in self.movers.items():
            mover.halted = halted
            self._due[module] = None
        self._order = order
        # A coordinator that halts all and is not heard of again stops nobody for long.
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
        self._all_news |= now_whole
        for place in changed:
            known = self.sensing.place(place)
            if known.module in self.movers and known.site is not None:
                self.movers[known.module].taken_to(known.site, known.module_version)
        self._news.update(changed)

    def _take_reply(self, part: Decision | Entered) -> None:
        module = part.occupant.module if isinstance(part, Entered) else part.module
        mover = self.movers.get(module)
        if mover is None:
            self.refused += 1
            return
        if isinstance(part, Entered):
            mover.entered(part, self._now_s)
        else:
            mover.decided(part, self._now_s)
            self.superseded |= mover.state == "superseded"
        self._due[module] = None

    def _go_on(self) -> list[Effect]:
        if self.superseded:
            return [Timer(None), End()]
        self._wake()
        if not self._due and self._now_s < min(self.sensing.next_s, self._swept_s + _SWEEP_S):
            return [] if self._ends_s < float("inf") else self._timer()
        effects: list[Effect] = []
        asks: dict[int, list[Attempt | EnterRequest | TileQuery]] = {}
        turns: list[Turn] = []
        due, self._due = self._due, {}
        for module in sorted(due):
            mover = self.movers[module]
            for keeper, part in mover.step(self._now_s, self.sensing):
                asks.setdefault(keeper, []).append(part)
            turns += mover.turns
            mover.turns = []
        effects += self._need(due)
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

    def _wake(self) -> None:
        """Let the modules choose again that sense anything new."""
        if self._news or self._all_news:
            for module, mover in self.movers.items():
                if self._all_news or not mover.near.isdisjoint(self._news):
                    mover.dirty = True
                    self._due[module] = None
            self._news, self._all_news = set(), False

    def _need(self, due: Iterable[int]) -> list[Effect]:
        """Listen to the tiles that the modules need; `due` are those that may have moved."""
        needs = {module: self.movers[module].needs for module in due}
        if needs.items() <= self._needs.items() and self._now_s < self._swept_s + _SWEEP_S:
            return []
        self._needs |= needs
        self._swept_s = self._now_s
        tiles = frozenset[str]().union(*self._needs.values())
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
