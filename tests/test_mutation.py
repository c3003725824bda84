"""The mutation tester: what it changes, what it leaves alone, and what it says of a sample."""

import ast
import re
import subprocess
import sys
from importlib.util import find_spec
from textwrap import dedent

import pytest

from marked import all_but
from mutants import ROOT, module_name, mutations_of
from mutation import MIRRORED, fixed_mutants, located
from mutators import mutations

ACTIONS = "protocol/cubepath/protocol/core/actions.py"
HEAP = "coordinator/cubepath/coordinator/normal_form/heap.py"
DEALING = "agents/cubepath/agents/processes/dealing.py"


def changes(source: str) -> list[tuple[str, str]]:
    """Return what each mutation of a source text turns into what."""
    return [(each.before, each.after) for each in mutations(ast.parse(dedent(source)))]


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("a < b", ["a <= b", "a >= b"]),
        ("a is None", ["a is not None"]),
        ("a < b == c", ["a <= b == c", "a >= b == c", "a < b != c"]),
        ("a - b", ["a + b", "a", "b"]),
        ("a and b or c", ["(a and b) and c", "c", "a and b", "a or b", "b", "a"]),
        ("not a", ["a"]),
        ("a if b else c", ["c if b else a"]),
        ("7", ["8", "6"]),
        ("True", ["False"]),
        ("a == 'x'", ["a != 'x'", "'x?'"]),
        ("f(a, b, k=c)", ["f(a, b)", "f(b, a, k=c)"]),
        ("f(*a, b)", []),
        ("f(strict=True)", []),
        ("min(a, b)", ["max(a, b)"]),
        ("sorted(a, key=b)", ["sorted(a)", "list(a)"]),
        ("a[b:]", [":"]),
        ("[a for a in b if c]", ["[a for a in b]"]),
    ],
)
def test_an_expression_is_changed_in_every_way(source: str, expected: list[str]) -> None:
    """Operators, operands, numbers, conditions, arguments: each change by itself, in order."""
    assert [after for _, after in changes(f"x = {source}")] == expected


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("f()", [("f()", "pass")]),
        ("a += b", [("a += b", "pass"), ("a += b", "a -= b")]),
        ("a.b = c", [("a.b = c", "pass")]),
        ("a = b", []),
        ("if a:\n  a = b", [("if a:", "if not a:")]),
        ("raise E('in words', 3)", [("raise E('in words', 3)", "pass")]),
        ("for a in b:\n  break", [("break", "continue")]),
        ("def f(a):\n  return a", [("return a", "return None")]),
        ("def f(a):\n  a = b", [("a = b", "pass")]),
    ],
)
def test_a_statement_is_dropped_or_turned_round(
    source: str, expected: list[tuple[str, str]]
) -> None:
    """What a statement does is left out; the condition of one with a body is negated."""
    assert changes(source) == expected


def test_what_only_people_and_type_checkers_read_is_left_alone() -> None:
    """Nothing of this is changed, for no test could tell."""
    source = """
        '''What it is for.'''
        from a import b
        Alias: TypeAlias = tuple[1, 2]
        if TYPE_CHECKING:
            import c
        __slots__ = ("a", 1)

        @cache(size=3)
        def f(a: A[1]) -> B[2]:
            '''What it does.'''
            field: C[3]
            x = f"{a + 1} is too long"
            raise AssertionError("never")

        class Record(msgspec.Struct, frozen=True):
            number: int
    """
    assert changes(source) == []


@pytest.mark.thorough
@pytest.mark.parametrize("file", MIRRORED)
def test_every_mutation_is_another_program(file: str) -> None:
    """Applied to a tree of its own it changes the code, and what comes out can be compiled."""
    source = (ROOT / file).read_text()
    same = ast.unparse(ast.parse(source))
    for number in range(0, len(mutations_of(file)), 60):
        tree = ast.parse(source)
        mutations(tree)[number].apply()
        assert ast.unparse(tree) != same
        compile(tree, file, "exec")


def test_every_file_and_its_tests_are_there() -> None:
    """The table names files that can be imported, and tests that can be run."""
    for file, tests in MIRRORED.items():
        spec = find_spec(module_name(file))
        assert spec is not None
        assert spec.origin is not None
        assert (ROOT / file).samefile(spec.origin)
        assert all((ROOT / each).is_file() for each in tests)


def test_a_change_is_in_the_function_around_it() -> None:
    """By its qualified name, without those of the file; in none at the top of a file."""
    source = "x = 1\nclass A:\n  y = 2\n  def f(self):\n    def g():\n      return 3\n"
    found = mutations(ast.parse(source))
    assert list(dict.fromkeys(each.function for each in found)) == ["", "A", "A.f.g"]


@pytest.mark.thorough
def test_each_mutant_of_the_fixed_list_has_one_place() -> None:
    """Rename it in the list together with its function, and what it finds can be compared."""
    wanted = fixed_mutants()
    assert set(wanted) == set(located(wanted).values())
    assert len(wanted) == len(set(wanted))


@pytest.mark.thorough
@pytest.mark.parametrize("file", all_but([ACTIONS, HEAP], {HEAP}))
def test_a_sample_is_found_and_no_file_is_touched(file: str) -> None:
    """The same report for the same seed: how many are found, by file, and what survives."""
    before = (ROOT / file).read_bytes()
    command = [sys.executable, "tests/mutation.py", "--only", file, "--sample", "3"]
    reports = []
    for processes in ("1", "2"):
        done = subprocess.run(
            [*command, "-n", processes], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert done.returncode in (0, 1), done.stderr
        reports.append(done.stdout)
    assert reports[0] == reports[1]
    first, *survivors, last = reports[0].splitlines()
    found = 3 - len(survivors)
    assert first == f"{found:4} of    3 found  {file}"
    assert all(line.startswith(f"{file}:") and "  ->  " in line for line in survivors)
    assert last.startswith(f"{found} of 3 mutants found, ")
    assert found >= 2
    assert (ROOT / file).read_bytes() == before


@pytest.mark.thorough
def test_the_simulator_finds_mutants_before_the_tests_do() -> None:
    """What its seeds find is counted with how many it took; what is left is for the tests."""
    command = [sys.executable, "tests/mutation.py", "--only", DEALING, "--sample", "4"]
    done = subprocess.run(
        [*command, "--seeds", "2"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 1), done.stderr
    first, *survivors, _ = done.stdout.splitlines()
    by_seeds = r"(\d) by seeds \(mean (\d\.\d), median [\d.]+\), (\d) by tests only"
    line = re.fullmatch(rf" +(\d) of    4 found  {DEALING}: {by_seeds}", first)
    assert line is not None, first
    found, simulated, tested = int(line[1]), int(line[2]), int(line[4])
    assert found == simulated + tested == 4 - len(survivors)
    assert simulated >= 1
    assert tested >= 1
    assert 1 <= float(line[3]) <= 2
