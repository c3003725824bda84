"""What crosses from room to room is offered by the room it comes from; nobody goes by a face."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest

from faces import FOR_USERS, ROOT, Source, offered, room_of, rooms, sources

TOOLS = ("cubepath.protocol.compiled", "cubepath.protocol.faces")
"""Of no room: what every room may use."""


def imports(source: Source, tree: ast.AST) -> Iterator[tuple[int, str, str]]:
    """Yield line, module and name of each import of the project, those inside functions too."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            above = source.module.split(".")[: -node.level] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            if module.split(".")[0] == "cubepath":
                yield from ((node.lineno, module, alias.name) for alias in node.names)
        elif isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "cubepath":
                    yield node.lineno, alias.name, ""


def wrong(source: Source, tree: ast.AST) -> Iterator[str]:
    """Yield the imports of a module that go past what the other room offers, with their lines."""
    own = room_of(source.module)
    for line, module, name in imports(source, tree):
        where = f"{source.path.relative_to(ROOT)}:{line}"
        whole = f"{module}.{name}" if f"{module}.{name}" in sources() else module
        room = room_of(whole)
        if whole in sources() and sources()[whole].is_face:
            yield f"{where}: {name or whole} from the face {whole}: name the module that defines it"
        elif module in TOOLS or (room == own and name):
            continue
        elif room is None or whole != module or not name:
            yield f"{where}: {whole} as a whole: name what is needed of it"
        elif offered(room).get(name) != module:
            yield f"{where}: {name} of {module}, which {room} does not offer"


def inside() -> list[Source]:
    """Return the modules of all rooms, without their faces."""
    return [
        each for each in sources().values() if room_of(each.module) is not None and not each.is_face
    ]


@pytest.mark.slow
def test_what_crosses_from_room_to_room_is_offered() -> None:
    """A name that a module takes from another room is on that room's face, and of that module."""
    assert len(inside()) > 100
    assert [found for source in inside() for found in wrong(source, source.tree)] == []


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("from cubepath.protocol.core.actions import _rebuild", "does not offer"),
        ("from cubepath.protocol.core.system import Action", "does not offer"),
        ("def f():\n    from cubepath.agents.local.module import Inbox", "does not offer"),
        ("if TYPE_CHECKING:\n    from cubepath.agents.rules.tswap import TSWAP", "does not offer"),
        ("from cubepath.protocol.core import Action", "from the face"),
        ("from cubepath.protocol import Action", "from the face"),
        ("from cubepath.coordinator.search import improve", "from the face"),
        ("from cubepath.protocol.core import actions", "as a whole"),
        ("import cubepath.protocol.core.actions", "as a whole"),
        ("import cubepath.coordinator.search.exact", "as a whole"),
        ("from ...protocol.core.actions import _rebuild", "does not offer"),
    ],
)
def test_each_way_past_a_face_is_seen(line: str, why: str) -> None:
    """The test above would find it, with the file and the line."""
    source = sources()["cubepath.coordinator.search.exact"]
    (found,) = wrong(source, ast.parse(line))
    assert f"search/exact.py:{line.count(chr(10)) + 1}: " in found
    assert why in found


@pytest.mark.parametrize(
    "line",
    [
        "from cubepath.protocol.core.actions import Action, commute",
        "from cubepath.coordinator.search.transitions import _Row",
        "from cubepath.coordinator.search import windows",
        "from cubepath.protocol.compiled import compiled",
        "import numpy as np",
    ],
)
def test_what_is_offered_or_of_the_same_room_is_left_alone(line: str) -> None:
    """A name of a face by its module, anything of one's own room, and what is of no room."""
    assert not list(wrong(sources()["cubepath.coordinator.search.exact"], ast.parse(line)))


def test_faces_offer_what_is_their_own() -> None:
    """A room offers names of its own modules; a large room offers what its rooms offer."""
    for room in rooms():
        assert {room_of(module) for module in offered(room).values()} <= {room}
        large = room.rpartition(".")[0]
        assert {name for name, of in offered(large).items() if of == room} <= offered(room).keys()


@pytest.mark.slow
def test_a_room_offers_no_more_than_is_taken() -> None:
    """What neither another room nor a user takes from a room is its own, and not on its face."""
    taken = {
        (module, name)
        for source in inside()
        for _, module, name in imports(source, source.tree)
        if room_of(module) != room_of(source.module)
    }
    spare = [
        f"{room}: {name}"
        for room in rooms()
        if room not in FOR_USERS
        for name, module in offered(room).items()
        if (module, name) not in taken and offered(room.rpartition(".")[0]).get(name) != room
    ]
    assert spare == []
