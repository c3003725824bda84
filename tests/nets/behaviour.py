"""Take a snapshot of what the command line does, and compare two of them; see README.md."""

from __future__ import annotations

import argparse
import base64
import concurrent.futures
import hashlib
import io
import json
import os
import re
import resource
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from difflib import unified_diff
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from PIL import Image, ImageSequence

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(__file__).with_name("cases.toml")
HOME = Path(tempfile.gettempdir()) / f"cubepath-behaviour-{os.getuid()}"
"""Keeps compiled functions and the fonts of matplotlib between cases and takes."""
COMMAND = [sys.executable, "-m", "cubepath.coordinator"]
SECONDS = 180
"""How long a step may take."""
PLACES = [ROOT, ROOT / "logs/golden", ROOT / "tests/data/imports", ROOT / "tests/data/agv"]
"""Where the files that cases name are."""

VARYING = [
    (re.escape(str(ROOT)), "<REPO>"),
    (re.escape(sys.prefix), "<VENV>"),
    (re.escape(str(HOME)), "<HOME>"),
    (r"<REPO>/(protocol|agents|coordinator)/cubepath/[\w/]+\.py(:\d+)?", "<SOURCE>"),
    (tempfile.gettempdir() + r"/cubepath-[\w./-]*", "<TMP>"),
    (r"(tcp|tls)/127\.0\.0\.1:(?!0\b|\d\b)\d+", r"\1/127.0.0.1:<PORT>"),
    (r"(127\.0\.0\.1|localhost):(?!\d\b)\d{4,5}", r"\1:<PORT>"),
    (r"\b20\d\d-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:?\d\d)?", "<TIME>"),
    (r"\b20\d{6}T\d{6,12}\b", "<TIME>"),
    (r"\b1[678]\d{17}\b", "<NS>"),
    (r"\brun [0-9a-f]{12}\b", "run <RUN>"),
    (r'("run(_id)?": ?)"[0-9a-f]{12}"', r'\1"<RUN>"'),
    (r"\bcubepath/[0-9a-f]{12}\b", "cubepath/<RUN>"),
    (r"(?m)^(run +)[0-9a-f]{12}$", r"\1<RUN>"),
    (r"(http://127\.0\.0\.1:<PORT>/)[\w-]{20,}", r"\1<TOKEN>"),
    (r"(?m)^cubepath: waiting for .*\n|^ +compile [\d.]+ s\n", ""),
    (r"(?i)\b(pid|process id) \d+", r"\1 <PID>"),
    (r'("(?:\w+_)?(?:seconds|secs|took|elapsed|wall_s|time_s|duration_s)": ?)[-\d.e]+', r"\1<S>"),
    (r"(?m)^((?:time|took|wall|wall time) +).*$", r"\1<S>"),
    (r"\b\d+(\.\d+)? (s|ms|min)\b(?! for)|\b\d+\.\d+s\b", "<S>"),
    (r"\b\d+(\.\d+)?(e[+-]\d+)? ?(k|M)?B/s\b|\b\d+(\.\d+)? ?\w+/s\b", "<RATE>"),
    (r"(?m)^(size +)\d+ bytes", r"\1<N> bytes"),
    (r'("seeds_per_second": ?)[\d.]+', r"\1<RATE>"),
    (r'("parent_sha256": ?)"[0-9a-f]{64}"', r'\1"<SUM>"'),
    (r"(?m)^(parent_sha256 +)[0-9a-f]{64}$", r"\1<SUM>"),
    (r'("bytes": ?)\d+(?=, "message_bytes")', r"\1<N>"),
    (r"(?m)^(  (?:cubepath|python|eclipse-zenoh|mcap|pettingzoo|numpy|platform) +).*$", r"\1<V>"),
    (r'("(?:cubepath|python|eclipse-zenoh|mcap|pettingzoo|numpy|platform)": ?)"[^"]*"', r'\1"<V>"'),
    (r"(?m)^(checksum +)[0-9a-f]{64}$", r"\1<SUM>"),
    (r'("checksum": ?)"[0-9a-f]{64}"', r'\1"<SUM>"'),
]
"""What changes from take to take, and what stands for it."""
TABLED = [(re.compile(pattern), stands) for pattern, stands in VARYING]


def normal(text: str, work: Path) -> str:
    """Return a text with what varies replaced."""
    text = text.replace(str(work), "<WORK>").replace("\r", "\n")
    for pattern, stands in TABLED:
        text = pattern.sub(stands, text)
    return text


def masked(text: str) -> str:
    """Return the kinds of lines of a text: without numbers, digests and repetitions."""
    text = re.sub(r"[0-9a-f]{12,}", "#", text)
    text = re.sub(r"-?\b\d+(\.\d+)?\b", "#", text)
    text = re.sub(r"# problems\b", "# problem", text)
    text = re.sub(r'("goal_reached": )(true|false)|(?m:^(goal +)(not )?reached)', r"\1\3#", text)
    text = re.sub(r"(\[[#, ]*\](, ?)?)+|#(, ?#)+", "#...", text)
    return "\n".join(sorted({line.rstrip() for line in text.splitlines()}))


def digest(data: bytes) -> str:
    """Return a short hash."""
    return hashlib.sha256(data).hexdigest()[:20]


# Files, each in a form that shows what is in it.


def mcap_lines(path: Path, *, loose: bool) -> Iterator[str]:
    """Yield what a recording holds, topic by topic; if loose, only which kinds there are."""
    with path.open("rb") as stream:
        yield from dict.fromkeys(
            record_blocks(make_reader(stream), loose=loose, whole=path.stem == "schemas")
        )
        stream.seek(0)
        topics: dict[str, list[str]] = {}
        for schema_of, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            kind = "" if schema_of is None else schema_of.name
            lines = topics.setdefault(f"{channel.topic} {channel.message_encoding} {kind}", [])
            text = channel.message_encoding == "json"
            body = message.data.decode() if text else f"{len(message.data)} {digest(message.data)}"
            lines.append(f"@{message.log_time} {body}")
    if loose:
        topics = {re.sub(r"_?\d+\b", "", topic): [] for topic in topics}
        topics.pop("halted/process json cubepath.rest", None)
    for topic in sorted(topics):
        yield f"--- topic {topic}"
        yield from topics[topic]


def record_blocks(reader: McapReader, *, loose: bool, whole: bool) -> Iterator[str]:
    """Yield what else is in a recording; much of it stands there twice, first and last."""
    summary = reader.get_summary()
    yield f"profile {reader.get_header().profile}"
    schemas = [] if summary is None else list(summary.schemas.values())
    for schema in sorted(schemas, key=lambda each: each.name):
        yield f"--- schema {schema.name} {schema.encoding}"
        if whole:
            yield schema.data.decode()
    for each in reader.iter_attachments():
        text = each.data.decode(errors="replace")
        text = re.sub(r"\n(?=[\s\]])\s*", " ", text)  # lists of TOML have many lines
        yield f"--- attachment {each.name} {each.media_type}\n{text}"
    for record in reader.iter_metadata():
        lines = [f"--- metadata {record.name}"]
        for key, told in record.metadata.items():
            if loose and record.name != "cubepath":
                lines.append(f'"{key}"')
                continue
            lines.append(f'"{key}": {told}' if told.startswith("{") else f'"{key}": "{told}"')
        yield "\n".join(lines)


def picture_lines(data: bytes) -> Iterator[str]:
    """Yield size and pixels of each frame."""
    with Image.open(io.BytesIO(data)) as image:
        for frame in ImageSequence.Iterator(image):
            pixels = frame.convert("RGBA")
            time_ms = frame.info.get("duration", "")
            yield f"{pixels.width}x{pixels.height} {time_ms} {digest(pixels.tobytes())}"


def unpacked(text: str) -> Any:
    """Return the document of a page: JSON, and behind it the arrays that it names."""
    whole = zlib.decompress(base64.b64decode(text))
    length = int.from_bytes(whole[:8], "little")
    body = whole[8 + length :]

    def back(found: dict[str, Any]) -> Any:
        if found.keys() != {"array", "at", "length"}:
            return found
        kind = np.dtype(f"<{found['array']}")
        return np.frombuffer(body, kind, count=found["length"], offset=found["at"]).tolist()

    return json.loads(whole[8 : 8 + length], object_hook=back)


def html_lines(text: str) -> Iterator[str]:
    """Yield a page with its documents and pictures decoded, and hashes of its code."""
    for part in re.split(r"(<(?:script|style)[^>]*>.*?</(?:script|style)>)", text, flags=re.DOTALL):
        opening, _, content = part.partition(">")
        content = content.rpartition("<")[0].strip()
        if opening.startswith(("<script", "<style")):
            try:
                for key, value in unpacked(content).items():
                    yield f"{opening}> {json.dumps(key)}: {json.dumps(value)}"
            except (ValueError, zlib.error, AttributeError):
                yield f"{opening}> {len(content)} {digest(content.encode())}"
        else:
            yield from re.sub(
                r"data:image/(png|gif);base64,([\w+/=]+)",
                lambda found: " ".join(picture_lines(base64.b64decode(found[2]))),
                part,
            ).splitlines()


def npz_lines(path: Path) -> Iterator[str]:
    """Yield each array of a file of numpy."""
    with np.load(path, allow_pickle=False) as arrays:
        for name in sorted(arrays.files):
            array = arrays[name]
            text = name in {"sites", "names", "move_names"} and array.dtype == np.uint8
            told = array.tobytes().decode() if text else json.dumps(array.tolist())
            yield f"{name} {array.dtype} {list(array.shape)} {told}"


def parquet_lines(path: Path) -> Iterator[str]:
    """Yield types and rows of a table."""
    from pyarrow import parquet

    table: Any = parquet.ParquetFile(path).read()
    yield from str(table.schema.remove_metadata()).splitlines()
    yield from sorted(json.dumps(row, default=str) for row in table.to_pylist())


def svg_lines(path: Path) -> Iterator[str]:
    """Yield a hash of a drawing, whose paths are in any order, and the comments in it."""
    text = re.sub(r"<dc:date>.*?</dc:date>|\b[pm][0-9a-f]{10}\b", "", path.read_text())
    lines = text.splitlines()
    yield f"{len(lines)} lines {digest(chr(10).join(sorted(lines)).encode())}"
    yield from (line.strip() for line in lines if line.lstrip().startswith("<!-- "))


READERS: dict[str, Callable[[Path], Iterable[str]]] = {
    ".crt": lambda _: ["a certificate"],
    ".gif": lambda path: picture_lines(path.read_bytes()),
    ".html": lambda path: html_lines(path.read_text()),
    ".key": lambda _: ["a key"],
    ".mcap": lambda path: mcap_lines(path, loose=False),
    ".npz": npz_lines,
    ".parquet": parquet_lines,
    ".png": lambda path: picture_lines(path.read_bytes()),
    ".svg": svg_lines,
}


def canonical(path: Path, *, loose: bool) -> list[str]:
    """Return the lines that show what is in a file."""
    data = path.read_bytes()
    told = "not text" if loose else f"{len(data)} bytes {digest(data)}"
    try:
        if loose and path.suffix == ".mcap":
            return list(mcap_lines(path, loose=True))
        if path.suffix in READERS:
            return list(READERS[path.suffix](path))
        text = data.decode()
    except UnicodeError:
        return [told]
    except (OSError, EOFError, ValueError, McapError) as error:
        return [f"{told} {type(error).__name__}"]
    return [told] if "\0" in text else (masked(text) if loose else text).splitlines()


# Cases, and how one is run.


@dataclass(frozen=True)
class Case:
    """Steps that are run one after the other in a new folder."""

    name: str
    steps: list[str]
    loose: bool


def cases(only: str = "") -> list[Case]:
    """Return the cases of the table whose names match."""
    table = tomllib.loads(TABLE.read_text())
    found: list[Case] = []
    for section in ("cases", "loose", "refused"):
        for name, steps in table[section].items():
            lines = [steps] if isinstance(steps, str) else steps
            prefix = "refused-" if section == "refused" else ""
            found.append(Case(prefix + name, lines, section == "loose"))
    for command in table["help"]:
        name = f"help-{command or 'all'}".replace(" ", "-")
        found += [Case(name, [f"{command} --help"], loose=False)]
    names = Counter(case.name for case in found)
    if twice := [name for name, number in names.items() if number > 1]:
        raise SystemExit(f"two cases have one name: {', '.join(twice)}")
    return [case for case in found if re.search(only, case.name)]


@dataclass
class Playing:
    """One case while it is run."""

    case: Case
    work: Path
    files: dict[str, str]
    port: int
    given: dict[str, str] = field(default_factory=dict[str, str])
    behind: list[tuple[int, subprocess.Popen[bytes]]] = field(
        default_factory=list[tuple[int, "subprocess.Popen[bytes]"]]
    )
    parts: dict[int, list[str]] = field(default_factory=dict[int, list[str]])

    def environment(self) -> dict[str, str]:
        """Return what every case finds around it."""
        return {
            "PATH": f"{Path(sys.executable).parent}:/usr/bin:/bin",
            "HOME": str(HOME),
            "COLUMNS": "1000",
            "CUBEPATH_PROGRESS": "0",
            "LC_ALL": "C.UTF-8",
            "MPLBACKEND": "Agg",
            "NO_COLOR": "1",
            "PYTHONDONTWRITEBYTECODE": "1",
            "TZ": "UTC",
        }

    def run(self) -> str:
        """Run all steps, and return the text of the case."""
        try:
            for number, step in enumerate(self.case.steps, 1):
                self.step(number, step)
            self.wait()
        finally:
            for _, process in self.behind:
                process.kill()
                process.wait()
        lines = [line for number in sorted(self.parts) for line in self.parts[number]]
        for path in sorted(self.work.rglob("*")):
            name = path.relative_to(self.work).as_posix()
            cache = {".pytest_cache", "__pycache__", ".hypothesis"} & set(path.parts)
            if path.is_file() and not cache and self.given.get(name) != digest(path.read_bytes()):
                lines.append(f"=== file {normal(name, self.work)}")
                text = "\n".join(canonical(path, loose=self.case.loose))
                lines += normal(text, self.work).splitlines()
        return "\n".join(lines) + "\n"

    def step(self, number: int, step: str) -> None:
        """Run one step."""
        words = shlex.split(step.replace("{port}", str(self.port)))
        words = [self.provided(word) for word in words]
        if words and words[0].startswith(":") and words[0] != ":python":
            self.verb(words[0], words[1:])
            return
        behind = words[:1] == ["&"]
        words = words[behind:]
        reads = Path(os.devnull)
        if len(words) > 1 and words[-2] == "<":
            words, reads = words[:-2], self.work / words[-1]
        command = [sys.executable, *words[1:]] if words[:1] == [":python"] else [*COMMAND, *words]
        self.parts[number] = [f"$ {step}"]
        with (
            reads.open("rb") as source,
            self.beside(number, "stdout").open("wb") as out,
            self.beside(number, "stderr").open("wb") as err,
        ):
            process = subprocess.Popen(
                command,
                cwd=self.work,
                env=self.environment(),
                stdin=source,
                stdout=out,
                stderr=err,
                start_new_session=True,
            )
        if behind:
            self.behind.append((number, process))
        else:
            self.ended(number, process)

    def ended(self, number: int, process: subprocess.Popen[bytes]) -> None:
        """Note how a step ended, and what it printed."""
        try:
            code = str(process.wait(SECONDS))
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            code = "none: it was ended after a time"
        lines = [f"=== step {number}: exit code {code}"]
        for stream in ("stdout", "stderr"):
            text = self.beside(number, stream).read_bytes().decode(errors="backslashreplace")
            text = normal(text, self.work)
            lines += [f"--- {stream}", *(masked(text) if self.case.loose else text).splitlines()]
        self.parts[number] = [lines[0], *self.parts[number], *lines[1:]]

    def beside(self, number: int, stream: str) -> Path:
        """Return the file that a step prints to."""
        return self.work.with_name(f"{number}.{stream}")

    def wait(self) -> None:
        """Wait for what runs in the background."""
        while self.behind:
            number, process = self.behind.pop(0)
            self.ended(number, process)

    def provided(self, word: str) -> str:
        """Put the file that ``@NAME`` means into the folder; return what the word is there."""
        return re.sub(r"(?:^|(?<==))@([\w./-]+)", lambda found: self.put(found[1]), word)

    def put(self, source: str) -> str:
        """Put a file of the table or the repository into the folder; return its name there."""
        there = self.work / source.rpartition("/")[2]
        if not there.exists():
            if source in self.files:
                there.write_text(self.files[source])
            else:
                found = next(place / source for place in PLACES if (place / source).exists())
                (shutil.copytree if found.is_dir() else shutil.copy)(found, there)
            for path in [there, *there.rglob("*")]:
                if path.is_file():
                    self.note(path)
        return there.name

    def note(self, path: Path) -> None:
        """Note that a file is not a command's."""
        self.given[path.relative_to(self.work).as_posix()] = digest(path.read_bytes())

    def verb(self, verb: str, words: list[str]) -> None:
        """Do what no command does: ``:truncate FILE SHARE OUT`` and so on."""
        if verb == ":wait":
            self.wait()
        elif verb == ":interrupt":
            for _, process in self.behind:
                process.send_signal(signal.SIGINT)
            self.wait()
        elif verb == ":listening":
            self.until(self.listens)
        elif verb == ":until":
            self.until(lambda: words[0] in self.beside(self.behind[-1][0], "stderr").read_text())
        elif verb == ":folder":
            (self.work / words[0]).mkdir()
        elif verb == ":touch":
            (self.work / words[0]).touch()
            self.note(self.work / words[0])
        elif verb == ":provide":
            pass  # the files of the words are there now
        else:
            data = (self.work / words[0]).read_bytes()
            if verb == ":replace":
                assert words[1].encode() in data, f"{self.case.name}: no {words[1]} in {words[0]}"
                data = data.replace(words[1].encode(), words[2].encode(), 1)
            else:
                place = int(len(data) * float(words[1]))
                tail = b"" if verb == ":truncate" else data[place + 1 :]
                data = data[:place] + (bytes([data[place] ^ 255]) if tail else b"") + tail
            (self.work / words[-1]).write_bytes(data)
            self.note(self.work / words[-1])

    def listens(self) -> bool:
        """Return whether something listens at the port of the case."""
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    @staticmethod
    def until(holds: Callable[[], bool]) -> None:
        """Wait until something holds."""
        deadline = time.monotonic() + SECONDS / 3
        while not holds() and time.monotonic() < deadline:
            time.sleep(0.05)


def free_port(taken: set[int]) -> int:
    """Return a port that no other case has."""
    while True:
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = int(probe.getsockname()[1])
        if port not in taken:
            taken.add(port)
            return port


def take(folder: Path, only: str, number: int) -> int:
    """Run the cases, and write a file for each."""
    folder.mkdir(parents=True, exist_ok=True)
    HOME.mkdir(exist_ok=True)
    files: dict[str, str] = tomllib.loads(TABLE.read_text())["files"]
    wanted = cases(only)
    lock = threading.Lock()
    ports: set[int] = set()
    done = 0
    began = time.monotonic()

    def play(case: Case) -> None:
        nonlocal done
        start = time.monotonic()
        work = Path(tempfile.mkdtemp(prefix="behaviour-")) / "work"
        try:
            with lock:
                port = free_port(ports)
            work.mkdir()
            text = Playing(case, work, files, port).run()
        except Exception as error:  # noqa: BLE001 - the other cases go on
            text = f"=== the case cannot be run: {type(error).__name__}: {error}\n"
        finally:
            shutil.rmtree(work.parent, ignore_errors=True)
        (folder / f"{case.name}.txt").write_text(text)
        with lock:
            done += 1
            took = time.monotonic() - start
            print(f"[{done}/{len(wanted)}] {case.name} {took:.1f} s", file=sys.stderr, flush=True)

    with concurrent.futures.ThreadPoolExecutor(number) as pool:
        list(pool.map(play, wanted))
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    took = f"{time.monotonic() - began:.0f} s, {spent.ru_utime + spent.ru_stime:.0f} s of processor"
    print(f"{len(wanted)} cases in {took}", file=sys.stderr)
    return 0


# Comparing.


@dataclass(frozen=True)
class Words:
    """How to say today's words in those of the other take."""

    keys: dict[str, str]
    values: dict[str, str]
    words: dict[str, str]
    text: dict[str, str]
    both: dict[str, str]

    @classmethod
    def read(cls, path: Path | None) -> Words:
        """Read the tables of a JSON file."""
        found: dict[str, dict[str, str]] = {} if path is None else json.loads(path.read_text())
        names = ("keys", "values", "words", "text", "both")
        if unknown := found.keys() - set(names):
            raise SystemExit(f"{path}: unknown tables {sorted(unknown)}, expected {names}")
        return cls(**{name: found.get(name, {}) for name in names})

    def back(self, text: str) -> str:
        """Return a text of the newer take in the words of the older."""

        def quoted(found: re.Match[str]) -> str:
            word, colon = found[1], found[2] or ""
            if colon:
                return f'"{self.keys.get(word, word)}"{colon}'
            return f'"{self.topic(word)}"'

        if self.keys or self.values:
            text = re.sub(r'"((?:[^"\\\n]|\\.)*)"(\s*:)?', quoted, text)
            text = re.sub(r"(?m)^(--- topic )(\S+)", lambda at: at[1] + self.topic(at[2]), text)
        for word, older in self.words.items():
            text = re.sub(rf"(?<![\w-]){re.escape(word)}(?![\w-])", older, text)
        for pattern, older in self.text.items():
            text = re.sub(pattern, older, text)
        return text

    def topic(self, word: str) -> str:
        """Return a value; of a topic ``KIND/SENDER`` the kind may be in the table."""
        kind, slash, sender = word.partition("/")
        return self.values.get(word, f"{self.values.get(kind, kind)}{slash}{sender}")

    def agreed(self, text: str) -> str:
        """Return a text without what is not to be compared, in an order without words."""
        for pattern, stands in self.both.items():
            text = re.sub(pattern, stands, text)
        return arranged(text, spaces=bool(self.words or self.text))


def arranged(text: str, *, spaces: bool) -> str:
    """Return the text of a case without its command lines, files and topics by their names."""
    if spaces:
        text = re.sub(r"(?<=\S) {2,}", "  ", text)
    text = re.sub(r"(?m)^\$ .*\n", "", text)
    steps: list[str] = []
    files: list[str] = []
    for section in re.split(r"(?m)^(?==== )", text):
        if section.startswith("=== file "):
            head, *blocks = re.split(r"(?m)^(?=--- )", section)
            files.append("".join([head, *sorted(blocks)]))
        else:
            steps.append(section)
    return "".join(steps + sorted(files))


def compare(older: Path, newer: Path, words: Words, *, summary: bool, only: str) -> int:
    """Print in what two takes differ; return 1 if they do."""
    sides = [
        {path.stem: path for path in sorted(folder.glob("*.txt")) if re.search(only, path.stem)}
        for folder in (older, newer)
    ]
    for name in sorted(sides[0].keys() ^ sides[1].keys()):
        print(f"{name}: only in {older if name in sides[0] else newer}")
    same = differs = reordered = 0
    for name in sorted(sides[0].keys() & sides[1].keys()):
        before = words.agreed(sides[0][name].read_text())
        after = words.agreed(words.back(sides[1][name].read_text()))
        if before == after:
            same += 1
            continue
        old, new = before.splitlines(), after.splitlines()
        moved = sorted(old) == sorted(new)
        reordered += moved
        differs += not moved
        print(f"{name}: {'the same lines in another order' if moved else 'differs'}")
        if not summary:
            print("\n".join(shortened(unified_diff(old, new, "A", "B", n=1, lineterm=""))))
    missing = len(sides[0].keys() ^ sides[1].keys())
    print(f"{same} equal, {differs} differ, {reordered} in another order, {missing} in one only")
    return int(bool(differs or reordered or missing))


def shortened(lines: Iterable[str]) -> Iterator[str]:
    """Yield lines, of which long ones keep their beginning and a hash."""
    for line in lines:
        yield line if len(line) <= 600 else f"{line[:580]} ... {digest(line.encode())}"


def main() -> int:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True, dest="command")
    taking = commands.add_parser("take", help="run the cases of cases.toml")
    taking.add_argument("folder", type=Path)
    taking.add_argument("--only", default="", metavar="REGEX")
    taking.add_argument("-n", type=int, default=2, help="cases at one time")
    comparing = commands.add_parser("compare", help="show in what two takes differ")
    comparing.add_argument("older", type=Path)
    comparing.add_argument("newer", type=Path)
    comparing.add_argument("--words", type=Path, help="JSON: tables of newer words and older ones")
    comparing.add_argument("--summary", action="store_true", help="only names and numbers")
    comparing.add_argument("--only", default="", metavar="REGEX")
    options: Any = parser.parse_args()
    if options.command == "take":
        return take(options.folder, options.only, options.n)
    words = Words.read(options.words)
    return compare(options.older, options.newer, words, summary=options.summary, only=options.only)


if __name__ == "__main__":
    sys.exit(main())
