"""Usage errors: one line that says what was meant, with exit code 2 and nothing done."""

from __future__ import annotations

from pathlib import Path

import pytest

from cubepath.coordinator.commands.main import main

Capture = pytest.CaptureFixture[str]
RATE = (
    "rounds or levels a second such as 10, times as fast as it was such as 2x, both at least"
    " 0.00001, or max"
)
SECONDS = "a number of seconds, 0 or more"


def refused(capsys: Capture, *arguments: str) -> str:
    """Return the one line in which a command is refused."""
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2
    told = capsys.readouterr()
    assert (told.out, told.err.count("\n")) == ("", 1)
    return told.err.removeprefix("cubepath: ").rstrip()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("shortn moves.jsonl", "unknown command 'shortn' (did you mean 'shorten'?), expected one"),
        ("--versoin", "unknown option --versoin (did you mean '--version'?)"),
        ("shorten m.jsonl --sytem hex", "unknown option --sytem (did you mean '--system'?)"),
        ("shorten --sytem=hex", "unknown option --sytem (did you mean '--system'?)"),
        ("shorten m.jsonl --expl", "unknown option --expl (did you mean '--explain'?)"),
        ("shorten m.jsonl --dura a=1", "unknown option --dura (did you mean '--duration'?)"),
        ("log info a.mcap -x", "unknown option -x;"),
        ("system list --zzz", "unknown option --zzz; see 'cubepath system list --help'"),
        ("system list more", "unexpected argument 'more'; see 'cubepath system list --help'"),
        ("shorten", "the following arguments are required: INPUT; see 'cubepath shorten --help'"),
        ("run --seed", "argument --seed: expected one argument; see 'cubepath run --help'"),
        ("improve a --following maf", "argument --following: unknown value 'maf' (did you mean "),
    ],
)
def test_words_that_are_not_known(line: str, message: str, capsys: Capture) -> None:
    """Commands and options are told with the nearest one; no option is shortened."""
    told = refused(capsys, *line.split())
    assert told.startswith(message)
    assert told.endswith("--help'")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("run --seed -1", "--seed: expected a whole number of at least 0, found '-1'"),
        ("run --seed 1.5", "--seed: expected a whole number of at least 0, found '1.5'"),
        ("run --processes -2", "--processes: expected a whole number of at least 0, found '-2'"),
        ("run --max-rounds x", "--max-rounds: expected a whole number of at least 0, found 'x'"),
        ("run --hesitate 1", "--hesitate: expected a number from 0 to less than 1, found '1'"),
        ("run --hesitate nan", "--hesitate: expected a number from 0 to less than 1, found 'nan'"),
        ("run --hesitate=-0.1", "--hesitate: expected a number from 0 to less than 1"),
        ("improve a --seconds 1 --seed -3", "--seed: expected a whole number of at least 0"),
        ("improve a --max-states -1", "--max-states: expected a whole number of at least 0"),
        *(
            (f"shorten a --improve={time}", f"--improve: expected {SECONDS}, found '{time}'")
            for time in ("x", "nan", "-1", "inf")
        ),
        *(
            (f"view a --fps={rate}", f"--fps: expected a number from 0.01 to 50, found '{rate}'")
            for rate in ("x", "nan", "0", "50.5", "inf")
        ),
        ("complex hex --max-states 0", "--max-states: expected a whole number of at least 1"),
        *(
            (
                f"replay a --rate={rate}",
                f"--rate: expected {RATE}, found '{rate}'",
            )
            for rate in ("inf", "nan", "0", "-1", "1e999", "fast", "1e-300", "1e-12")
        ),
    ],
)
def test_numbers_out_of_their_bounds(line: str, message: str, capsys: Capture) -> None:
    """The option, what was found, and what was expected."""
    assert refused(capsys, *line.split()).startswith(f"argument {message}")


@pytest.mark.parametrize(
    ("words", "name"),
    [
        *((words, "LOG") for words in ("log info", "verify", "replay")),
        *((words, "INPUT") for words in ("shorten", "convert", "view")),
        ("shorten a --convert", "OUTPUT"),
        ("run --schedule", "--schedule"),
        ("run --log", "--log"),
        *((f"shorten a {option}", option) for option in ("--with", "--certificate", "--durations")),
        *((f"verify a {option}", option) for option in ("--of", "--cubes", "--recover")),
        *((f"{words} -o", "-o/--output") for words in ("shorten a", "view a", "complex hex")),
    ],
)
def test_an_empty_name_of_a_file(words: str, name: str, capsys: Capture) -> None:
    """It is no file, and not the folder where the command runs either."""
    told = refused(capsys, *words.split(), "", *(["b"] if words == "convert" else []))
    assert told.startswith(f"argument {name}: expected a file, found ''; see 'cubepath ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", ""], "unknown system '', expected one of hex"),
        (["complex", ""], "unknown system '', expected one of hex"),
        (["run", "hxe"], "unknown system 'hxe' (did you mean 'hex'?), expected one of"),
        (["run", "--rule", ""], "unknown rule '', expected one of"),
        (["run", "--rule", "chian"], "unknown rule 'chian' (did you mean 'chain'?), expected"),
        (
            ["complex", "agv:grpah=K5"],
            "agv:grpah=K5: cannot read 'grpah=K5' (did you mean 'graph'",
        ),
        (
            ["shorten", "moves", "--format", "mapflog"],
            "unknown format 'mapflog' (did you mean 'mapf-log'?), expected one of",
        ),
    ],
)
def test_names_that_are_not_known(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    """Systems, their keys, rules and formats are told with the nearest one; nothing is written."""
    monkeypatch.chdir(tmp_path)
    Path("moves").write_text("")
    assert main(arguments) == 2
    told = capsys.readouterr()
    assert told.err.startswith(f"cubepath: {message}")
    assert (told.out, told.err.count("\n")) == ("", 1)
    assert [path.name for path in tmp_path.iterdir()] == ["moves"]


def test_no_command_asks_for_help(capsys: Capture) -> None:
    """The commands with a line on each, as --help says them."""
    assert main([]) == 0
    told = capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--help"])
    assert told == capsys.readouterr().out
    assert "shorten a path to its normal cube path" in told
