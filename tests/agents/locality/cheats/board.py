"""A rule whose modules meet in a file."""

from pathlib import Path

from cubepath.agents import InitialKnowledge, Rule, RuleType, View


def make(knowledge: InitialKnowledge) -> Rule:
    def choose(view: View) -> int:
        board = Path("board.txt")
        with board.open("a") as stream:
            stream.write(".")
        legal = view.mask.nonzero()[0]
        return int(legal[len(board.read_text()) % len(legal)])

    return choose


RULE = RuleType("board", "by a file", "a test", lambda _: True, make)
