"""Fuzz the nodes, the judge and the readers, guided by what code the junk comes to.

With cubepath and atheris (``pip install atheris``) installed: ``python tests/fuzz.py
[-max_total_time=60] [FOLDER]``; all options are libFuzzer's, and FOLDER keeps what was found worth
trying. An input decides what is told to whom, and how real messages and files are changed. What is
raised and should not be ends it: libFuzzer keeps the input as a file, which is tried again by
``python tests/fuzz.py FILE``.
"""

from __future__ import annotations

import sys
from importlib import import_module
from random import Random
from typing import Any

try:
    atheris: Any = import_module("atheris")
except ModuleNotFoundError:
    sys.exit("fuzz.py: needs atheris: pip install atheris")

with atheris.instrument_imports(include=["cubepath"]):
    from samples.driven import CASES, Driven, fate
    from tampering.fuzzed_files import FILES, refusal
    from tampering.junk import Junk


class Guided(Random):
    """Draws from bytes as long as there are any, then always the least."""

    def __init__(self, data: bytes) -> None:
        super().__init__(0)
        self._left = data

    def getrandbits(self, k: int, /) -> int:
        size = (k + 7) // 8
        some, self._left = self._left[:size], self._left[size:]
        return int.from_bytes(some, "little") & ((1 << k) - 1)

    def random(self) -> float:
        return self.getrandbits(53) / (1 << 53)


def one_input(data: bytes) -> None:
    """Read a changed file, or play two rounds and tell junk in between."""
    random = Guided(data)
    if random.randrange(2):
        refusal(random.choice(FILES), random)
        return
    driven = Driven(*random.choice(CASES))
    junk = Junk(random)

    def intruder() -> list[tuple[int, str, bytes]]:
        for key, heard in driven.put[-3:]:
            junk.heard(key, heard)
        who = random.randrange(-1, len(driven.nodes))
        return [(who, *junk.one()) for _ in range(random.randrange(3))]

    fate(driven, 2, intruder)


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
