"""A rule that looks at the frames of its callers in three ways, and uses none."""

import inspect
import sys
from types import FrameType

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        frames: list[FrameType | None] = [inspect.currentframe(), sys._getframe(1)]
        try:
            raise KeyError
        except KeyError as error:
            if error.__traceback__ is not None:
                frames.append(error.__traceback__.tb_frame)
        return int(view.mask.nonzero()[0][len(frames) - 3])

    return choose


RULE = RuleType("frames-looked-at", "looks only", "a test", lambda _: True, make)
