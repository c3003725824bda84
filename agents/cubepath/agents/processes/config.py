"""The configuration of a module process. The fleet and the simulator create it in the same way."""

import msgspec

from cubepath.agents.rules.schedule import RecordedChoices
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.wire.credentials import GUEST, Credentials

OUTSIDE = "outside"
"""Instead of a rule's name: the modules are driven from outside, by `Acts` messages."""


class ProcessConfig(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The configuration of a module process."""

    endpoint: str
    run: str
    process: int
    modules: list[int]
    processes: list[list[int]]
    """The modules of every process: which process speaks for which module."""
    scene: str
    """The scene as TOML text: processes share no files."""
    rule: str
    seed: int
    hesitate: float
    note_length: int
    schedule: dict[int, dict[int, GeneratorPlacement]] | None = None
    """By module its own moves of a schedule, by round; the rule follows when that is over."""
    recorded: RecordedChoices | None = None
    """What its modules chose in a run in the recording, and choose again until that is over."""
    credentials: Credentials = GUEST
    """By what it shows who it is; a process elsewhere has its own."""
