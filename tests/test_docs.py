"""What the README and the docs show is true: every block runs, or is what comes of running one."""

import ast
import inspect
import re
import sys
import textwrap
from itertools import pairwise
from pathlib import Path

import pytest

from cubepath.agents import Choice, InitialKnowledge, RuleType, View, parallel_env
from cubepath.coordinator.plugins import COMMANDS
from cubepath.protocol import Action, Move
from cubepath.protocol.scenes.registry import all_families
from marked import some
from pasted import Desk, blocks

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


LEFT_OUT = {
    "pip install -e . && ": "the tests run with the project installed",
    "pip install -e '.[test]' && python -m pytest\n": "these are the tests",
    "cubepath paper ": "takes ten seconds and more; tests/coordinator/theory/paper",
}
"""Pieces of shell that are not run, and why."""
LONG = {
    "README",
    "experiments",
    "commuting",
    "extending",
    "first-rule",
    "first-run",
    "free-clock",
    "hosts",
    "messages",
    "planners",
    "policies",
    "programs",
    "recordings",
    "replay",
    "robots",
    "running",
    "schedules",
    "security",
    "simulation",
    "testing",
    "viewers",
}
"""Pages that take seconds."""
SHOWN = {
    "from sb3_contrib import MaskablePPO": "takes torch; tests/agents/environments/test_sb3.py",
    "cubepath sweep docs/studies/price.toml -o price": "takes minutes; tests/test_studies.py",
    "cubepath sweep docs/studies/free-clock.toml -o free": "takes minutes; tests/test_studies.py",
    "python docs/studies/flip_diameter.py 5..13 --all -o docs/studies/flip-diameter.json": "takes"
    " minutes; tests/test_findings.py",
    "python docs/studies/hexagon_shapes.py 1..12 -o docs/studies/hexagon-shapes.json   # no seed:"
    " nothing is drawn": "takes minutes; tests/test_findings.py",
    "python docs/studies/torsion.py -o docs/studies/torsion.json   # some minutes; nothing is"
    " drawn at random": "takes minutes; tests/test_findings.py",
    "pip install -e '.[proofs]'": "before a study that takes hours; tests/test_findings.py",
    "cubepath run hex:n=12 --listen tcp/127.0.0.1:17447 --wait-for 1": "one terminal of three",
    "cubepath log record --connect tcp/127.0.0.1:17447 -o outside.mcap": "the others",
    "cubepath log record --connect tcp/127.0.0.1:17447 --snapshot 30 -o last.mcap": "until"
    " interrupted",
    "cubepath view --connect tcp/127.0.0.1:17447": "follows a run in another terminal",
    "planner | cubepath shorten - --system hex:n=12 -o - | robot": "programs of the reader's own",
}
"""First lines of blocks that are only shown, and why."""


def paste_all(page: Path, folder: Path) -> None:
    """Paste a page into a folder; AssertionError names the first block that is not true."""
    desk = Desk(folder, LEFT_OUT, SHOWN)
    for block in blocks(page):
        try:
            desk.paste(block)
        except Exception as error:
            raise AssertionError(f"{page.name}:{block.line}: {error}") from error
    assert not desk.unread, f"{page.name}: nobody reads {sorted(desk.unread)}"


@pytest.mark.few(2)
@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    some(PAGES, [page for page in PAGES if page.stem not in LONG]),
    ids=lambda page: page.stem,
)
def test_what_a_page_shows_is_what_comes_when_it_is_pasted(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pasted in order into one folder, every block runs, is read, or is the output that comes."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    paste_all(page, tmp_path)
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(tmp_path):
            del sys.modules[name]


def test_no_excuse_is_left_over() -> None:
    """Each piece that is left out or only shown stands on some page."""
    texts = [block.text for page in PAGES for block in blocks(page)]
    firsts = {text.partition("\n")[0] for text in texts}
    assert all(any(piece in text for text in texts) for piece in LEFT_OUT)
    assert firsts >= SHOWN.keys()


@pytest.mark.parametrize(
    ("page", "reason"),
    [
        ("```json\n{}\n```", "neither a file nor an output"),
        ("```toml settings.toml\n```", "nobody reads"),
        ("```\nls\n```", "neither a file nor an output"),
        ("```python\n1 / 0\n```", "division by zero"),
        ("```sh\nprintf 'no such' >&2; false\n```", "no such"),
        ("```sh\necho one\n```\n```text ->\ntwo\n```", "one"),
        ("```console\n$ echo one; false\none\n$ echo $?\n0\n```", "1"),
        ("```python\nprint(1)\n```\n```json ->\n2\n```", "1$"),
        ("- item\n\n  ```json ->\n  []\n  ```", "Expecting value"),
    ],
)
def test_a_block_that_is_not_true_is_found(page: str, reason: str, tmp_path: Path) -> None:
    """A block that nobody runs or reads, that fails, or that shows something else is refused."""
    path = tmp_path / "page.md"
    path.write_text(f"# Page\n\n{page}\n")
    (tmp_path / "desk").mkdir()
    with pytest.raises(AssertionError, match=reason):
        paste_all(path, tmp_path / "desk")


def anchors_of(page: Path) -> set[str]:
    """Return the anchors of a page's headings."""
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", each.lower()).replace(" ", "-") for each in headings}


@pytest.mark.parametrize("page", sorted({*PAGES, *ROOT.glob("*.md")}), ids=lambda page: page.stem)
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link and picture is a file of the repository, and has the heading."""
    links = r"([\w-]+\.md)?\]\((?!http)([^)#]*)#?([^)]*)\)"
    for named, target, anchor in re.findall(links, page.read_text()):
        there = page.parent / target if target else page
        assert there.exists(), target
        assert named in ("", there.name), f"{named} leads to {target}"
        assert not anchor or anchor in anchors_of(there), f"{target}#{anchor}"


def test_what_contributors_are_sent_to_is_there() -> None:
    """Every file and folder that CONTRIBUTING and the page of the architecture name exists."""
    large = [ROOT / room / "cubepath" for room in ("protocol", "agents", "coordinator")]
    rooms = [room for top in large for room in top.glob("*") if room.is_dir()]
    known = [ROOT, ROOT / "docs", *large, *rooms]
    for page in (ROOT / "CONTRIBUTING.md", ROOT / "docs" / "architecture.md"):
        named = re.findall(r"`([\w/.*-]+(?:\.py|\.toml|/[\w*-]+))`", page.read_text())
        assert len(named) > 3
        for name in named:
            assert any(list(place.glob(name)) for place in known), f"{page.name}: {name}"


def test_every_system_and_command_is_on_its_page() -> None:
    """The table of instances.md has all systems, and that of commands.md all commands."""
    text = (ROOT / "docs" / "instances.md").read_text()
    assert set(all_families()) <= set(re.findall(r"^\| `([\w-]+)` \|", text, re.MULTILINE))
    rows = re.findall(
        r"^\| .* \| (`.*`) \|", (ROOT / "docs" / "commands.md").read_text(), re.MULTILINE
    )
    named = set(re.findall(r"[a-z]+", " ".join(rows)))
    assert {word for leaf in COMMANDS for word in leaf.split()} <= named


def in_docstrings(kind: type) -> set[str]:
    """Return the names of a class that have a docstring of their own, or stand in that of it."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    found = set(re.findall(r"`(\w+)`", ast.get_docstring(tree) or ""))
    for statement, following in pairwise([*tree.body, ast.Pass()]):
        if isinstance(statement, ast.FunctionDef) and ast.get_docstring(statement):
            found.add(statement.name)
        elif isinstance(statement, ast.AnnAssign) and isinstance(following, ast.Expr):
            found.add(ast.unparse(statement.target))
    return found


@pytest.mark.parametrize(
    ("kind", "prefix"),
    [
        (RuleType, ""),
        (InitialKnowledge, ""),
        (View, ""),
        (Choice, ""),
        (Move, "move."),
        (Action, "action."),
    ],
)
def test_all_that_a_rule_has_is_explained(kind: type, prefix: str) -> None:
    """Each name that a rule's values offer has a docstring, or is in a table of the page."""
    rows = re.findall(r"^\| (.*?) \|", (ROOT / "docs" / "extending.md").read_text(), re.MULTILINE)
    told = set(re.findall(r"`([\w.]+)[`(]", " ".join(rows)))
    told |= {f"{prefix}{name}" for name in in_docstrings(kind)}
    assert {f"{prefix}{name}" for name in dir(kind) if not name.startswith("_")} <= told


def test_the_environment_of_the_readme() -> None:
    """The constructor that the README names makes an environment."""
    assert parallel_env("hex:n=7").possible_agents[-1] == "module_6"
