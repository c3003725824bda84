"""A player that you pause, step and move from Python while others listen; and a whole replay.

The messages of module processes travel through a router from one session to another, under their
original keys but a new run id, and a fresh coordinator gathers them. Without rounds, the messages
of keepers are put back too. Anything else that is connected to the router receives them as well.
"""

import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Self, TypeAlias, Unpack

from cubepath.coordinator.playback import machine
from cubepath.coordinator.playback.key_session import session_of
from cubepath.coordinator.playback.replay_comparison import ReplayResult
from cubepath.coordinator.playback.replay_session import PlayOptions
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.input_files import Source
from cubepath.protocol.core.options import seconds
from cubepath.protocol.recordings.recording import Recording, recording_of

_OVER = "the replay is over: expected another Player(...) for another replay"
_LOOK_S = 0.1
_Answers: TypeAlias = SimpleQueue[machine.PlayerStatus | ReplayResult | str]


class Player:
    """A recording put back on zenoh under control, as a context manager.

    It begins paused, before the first message. An order has been carried out when its call returns:
    the messages of a step have been put. `play` returns at once, and `wait` when all is played; it
    can be moved and played again after that. Orders over zenoh and those from Python take their
    turns.

    >>> with Player("logs/golden/hex-5.mcap", topics=["reports"]) as player:
    ...     player.step("round").round
    ...     player.seek("12").message
    ...     status = player.play()
    ...     player.wait().rounds_compared
    2
    237
    19
    >>> status.messages
    578
    """

    def __init__(
        self, recording: Recording | Source, *, hold: bool = True, **options: Unpack[PlayOptions]
    ) -> None:
        """Check the options, which are those of `PlayOptions`; InputError if one is wrong.

        Nothing is started yet. `paused` is true unless it is given. Without `hold` it is over when
        all is played, unless it is paused there.
        """
        self._hold = hold
        given = PlayOptions(**options)
        given.setdefault("paused", True)
        self._playing = session_of(recording_of(recording), given)
        self._thread = threading.Thread(target=self._run, name="cubepath-player", daemon=True)
        self._error: BaseException | None = None
        self._over = threading.Event()
        self._replayed: ReplayResult | None = None
        self._entered = False

    @property
    def run(self) -> str:
        """Return the name of the run in keys: ``cubepath/RUN/...``."""
        return self._playing.run

    @property
    def endpoint(self) -> str:
        """Return where to listen: ``cubepath.protocol.open_client(endpoint)``."""
        return self._playing.endpoint

    def __enter__(self) -> Self:
        """Start the router and the player; CheckError if it was entered before."""
        if self._entered:
            raise CheckError(_OVER)
        self._entered = True
        self._playing.__enter__()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop, and leave nothing behind; nothing if that has been done."""
        if self._thread.is_alive():
            self._playing.ask(machine.PendingOrder(machine.Order("stop"), lambda _: None))
            self._thread.join()

    def _run(self) -> None:
        try:
            self._playing.play(hold=self._hold)
            self._replayed = self._playing.result()
        except BaseException as error:  # noqa: BLE001 - raised where somebody waits for it
            self._error = error
        finally:
            self._over.set()
            self._playing.refuse_all(_OVER)
            self._playing.__exit__()

    # Orders.

    def play(self) -> machine.PlayerStatus:
        """Play on from where it stands; returns at once."""
        return self.order("play")

    def pause(self) -> machine.PlayerStatus:
        """Put nothing more."""
        return self.order("pause")

    def toggle(self) -> machine.PlayerStatus:
        """Pause if it plays, and play on if it is paused."""
        return self.order("toggle")

    def step(self, unit: machine.Unit = "message", count: int = 1) -> machine.PlayerStatus:
        """Put the next messages, or all up to the end of a round or level, and pause there."""
        return self.order("step", unit=unit, count=count)

    def back(self, unit: machine.Unit = "message", count: int = 1) -> machine.PlayerStatus:
        """Go back by messages, or to where the round of the last message began, and pause."""
        return self.order("back", unit=unit, count=count)

    def seek(self, to: int | str) -> machine.PlayerStatus:
        """Go to where a round, level or time begins: 12, "12", "3.5s". It plays on if it did."""
        return self.order("seek", to=str(to))

    def rate(self, rate: float | str) -> machine.PlayerStatus:
        """Play at another rate from now on: 10 rounds or levels a second, "2x", "max"."""
        return self.order("rate", rate=str(rate))

    def stop(self) -> machine.PlayerStatus:
        """End the replay."""
        return self.order("stop")

    @property
    def position(self) -> machine.PlayerStatus:
        """Return where it stands."""
        return self.order("status")

    def order(self, name: str, **given: object) -> machine.PlayerStatus:
        """Give an order by its name in keys, and return where it stands when it was carried out.

        InputError if that cannot be, CheckError if the replay is over, and what has ended it.
        """
        order = machine.read_order(name, given)
        found = self._ask(
            lambda answers: machine.PendingOrder(order, answers.put, answers.put), None
        )
        if isinstance(found, machine.PlayerStatus):
            return found
        raise CheckError(_OVER)

    def wait(self, timeout_s: float | None = None) -> ReplayResult:
        """Wait until all is played, or it was stopped; return the result up to then.

        CheckError if it is not within the time. If the player is paused, this waits until
        somebody plays on.
        """
        limit = None if timeout_s is None else seconds("timeout_s", timeout_s)

        def asked(answers: _Answers) -> machine.PendingOrder:
            return machine.PendingOrder(
                machine.Order("status"),
                lambda _: answers.put(self._playing.result()),
                answers.put,
                at_end=True,
            )

        found = self._ask(asked, limit)
        if isinstance(found, ReplayResult):
            return found
        if self._replayed is None:
            raise CheckError(_OVER)
        return self._replayed

    @property
    def over(self) -> bool:
        """Whether it was stopped, or has ended by itself."""
        return self._over.is_set()

    def _ask(
        self, asked: Callable[[_Answers], machine.PendingOrder], limit: float | None
    ) -> machine.PlayerStatus | ReplayResult | None:
        """Return the answer, or None if the replay is over."""
        if not self._entered:
            raise CheckError("the player has not begun: expected 'with Player(...) as player:'")
        answers: _Answers = SimpleQueue()
        deadline = None if limit is None else time.monotonic() + limit
        self._playing.ask(asked(answers))
        while True:
            over = self._over.is_set()
            try:
                found = answers.get(timeout=_LOOK_S)
            except Empty:
                if deadline is not None and time.monotonic() >= deadline:
                    state = self.position.state
                    raise CheckError(
                        f"the replay has not ended within {limit:g} s: it is {state}"
                    ) from None
                if not over:
                    continue
                found = _OVER
            break
        if found == _OVER and self._error is not None:
            raise self._error
        if isinstance(found, str) and found != _OVER:
            raise InputError(found)
        return None if isinstance(found, str) else found


Announce = Callable[[str, str], object]
"""Called with the endpoint and the run id before the first message is put."""


def replay(
    recording: Recording | Source,
    *,
    announce: Announce | None = None,
    **options: Unpack[PlayOptions],
) -> ReplayResult:
    """Put the messages of modules back on zenoh, gather them from there, and compare the results.

    The options are those of `PlayOptions`. Without them all is played once, as fast as possible,
    and compared; of a part what can be compared is. InputError for bad options and malformed
    messages, and if a path is no recording; CheckError if reports contradict each other or messages
    do not arrive.

    >>> found = replay("logs/golden/hex-5.mcap")
    >>> found.same, found.rounds, found.moves
    (True, 29, 28)
    >>> replay("logs/golden/hex-5.mcap", begin=3, until=12).result
    'the same as recorded in 10 rounds; not compared: rounds 1 to 2, 13 to 29, cubes, summary'
    """
    recording = recording_of(recording)
    with session_of(recording, options) as playing:
        if announce is not None:
            announce(playing.endpoint, playing.run)
        playing.play()
        return playing.result()
