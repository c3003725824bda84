"""The file of a proof of optimality: it comes back as it was, and any change of it is refused."""

import re
import zlib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import given, strategies as st

from cubepath.protocol.core.actions import Action
from cubepath.protocol.core.catalogue import GeneratorPlacement
from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.file_forms import form_of
from cubepath.protocol.path_files.optimality_proofs import (
    FIRST_LINE,
    Group,
    Ladder,
    OptimalityProof,
    read_proof,
    write_proof,
)
from cubepath.protocol.path_files.proof_blocks import LOG_BYTES

STEP = Action([1, (2, "x"), "f"], [1, (2, "x")], [1], [(2, "x")], free=["f"])
GUARDED = Action([1, 2, 3, 4], [1, 2], [1], [2], guards=[(3, 4)])


def small(log: bytes = b"a\x02\x05\x00") -> OptimalityProof:
    return OptimalityProof(
        system=None,
        start=[1, "f"],
        goal=[(2, "x")],
        refuted=1,
        cubes=2,
        solver="some solver",
        moves=[STEP, GUARDED],
        sites=[1, (2, "x"), "f", 2, 3, 4],
        variables=np.array([[0, 1, 2], [1, 3, 1], [2, 0, 1]], dtype=np.int32),
        ladders=[Ladder(1, 2, "stay", [3, 4])],
        groups=[Group("at most one", [0, 1])],
        log=[log],
        schedule=[[0], [], [1, 0]],
    )


def fields(proof: OptimalityProof) -> dict[str, object]:
    found = {name: getattr(proof, name) for name in OptimalityProof.__slots__}
    found["variables"] = proof.variables.tolist()
    found["log"] = b"".join(proof.log)
    return {
        name: list(value) if isinstance(value, tuple) else value for name, value in found.items()
    }


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("proofs") / "small.proof"
    write_proof(path, small())
    return path.read_bytes()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    """Every field comes back, own moves with free sites and guards too, and is written alike."""
    path = tmp_path / "a.proof"
    write_proof(path, small())
    found = read_proof(path)
    assert fields(found) == fields(small())
    assert list(found.moves) == [STEP, GUARDED]
    assert form_of(path).name == "proof"
    write_proof(tmp_path / "b.proof", found)
    assert (tmp_path / "b.proof").read_bytes() == path.read_bytes()


def test_moves_of_a_system_are_names(tmp_path: Path) -> None:
    """With a system a move is a generator and a place, whose lists are tuples again."""
    named = [GeneratorPlacement("slide", (0, (1, 2)))]
    write_proof(tmp_path / "a.proof", replace(small(), system="[hex]", moves=named))
    assert list(read_proof(tmp_path / "a.proof").moves) == named


def test_a_long_log_streams_in_blocks(tmp_path: Path) -> None:
    """A log in many pieces becomes blocks of a MiB at most, and can be read twice."""
    pieces = [bytes([number]) * 300_001 for number in range(11)]
    proof = replace(small(), log=iter(pieces))
    write_proof(tmp_path / "a.proof", proof)
    found = read_proof(tmp_path / "a.proof").log
    sizes = [len(piece) for piece in found]
    assert max(sizes) == LOG_BYTES
    assert len(sizes) == 4
    assert b"".join(found) == b"".join(pieces)


def blocks(data: bytes) -> list[tuple[str, int, bytes]]:
    """Return the blocks of a file: name, place and payload."""
    found, at = [], len(FIRST_LINE)
    while head := re.match(rb"([a-z]+) (\d+) [0-9a-f]{8}\n", data[at:]):
        begin = at + head.end()
        found.append((head[1].decode(), at, data[begin : begin + int(head[2])]))
        at = begin + int(head[2]) + 1
    return found


def changed(data: bytes, place: int, value: int) -> bytes:
    return data[:place] + bytes([value]) + data[place + 1 :]


def refusal(path: Path, data: bytes) -> str:
    path.write_bytes(data)
    with pytest.raises(CubepathError) as caught:
        read_proof(path)
    return str(caught.value)


def says_where(said: str, data: bytes, place: int) -> bool:
    """Return whether a refusal names the block that holds a byte, and where that begins."""
    if place < len(FIRST_LINE):
        return "no proof" in said
    name, at = "end", data.rindex(b"\nend ") + 1
    if place < at:
        name, at = next((name, at) for name, at, _ in reversed(blocks(data)) if at <= place)
    found = re.search(r"block ([a-z ]+), byte (\d+):", said)
    return found is not None and name in found[1].split(" or ") and found[2] == str(at)


@given(data=st.data())
def test_a_changed_byte_is_refused_with_its_place(
    data: st.DataObject, written: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """Whatever byte becomes whatever else, the refusal names its block and where that begins."""
    place = data.draw(st.integers(0, len(written) - 1))
    value = data.draw(st.integers(0, 255).filter(lambda value: value != written[place]))
    path = tmp_path_factory.getbasetemp() / "changed.proof"
    said = refusal(path, changed(written, place, value))
    assert says_where(said, written, place)


@pytest.mark.nightly
def test_every_changed_byte_is_refused(written: bytes, tmp_path: Path) -> None:
    """All bytes of a small proof, each with all its bits flipped one by one."""
    for place in range(len(written)):
        for bit in range(8):
            data = changed(written, place, written[place] ^ 1 << bit)
            assert says_where(refusal(tmp_path / "a.proof", data), written, place)


def test_cuts_and_additions_are_refused(written: bytes, tmp_path: Path) -> None:
    """A file cut off anywhere is refused, and one with more bytes at its end."""
    for size in range(0, len(written), 7):
        refusal(tmp_path / "a.proof", written[:size])
    assert "more bytes follow" in refusal(tmp_path / "a.proof", written + b"\n")


def made_anew(parts: list[tuple[str, bytes]]) -> bytes:
    """Return a file of these blocks with checksums that hold; contents are not yet compressed."""
    data = FIRST_LINE
    for name, content in parts:
        payload = zstandard.ZstdCompressor().compress(content)
        head = f"{name} {len(payload)} ".encode()
        data += b"%s%08x\n%s\n" % (head, zlib.crc32(head + payload), payload)
    return data + f"end {len(parts)} {sha256(data).hexdigest()}\n".encode()


def contents(data: bytes) -> list[tuple[str, bytes]]:
    return [
        (name, zstandard.ZstdDecompressor().decompress(payload))
        for name, _, payload in blocks(data)
    ]


def test_blocks_stand_once_and_in_their_order(written: bytes, tmp_path: Path) -> None:
    """A block left out, twice or at another place is refused, though checksums hold."""
    parts = contents(written)
    names = "statement moves sites variables ladders groups log schedule"
    assert [name for name, _ in parts] == names.split()
    assert written[: len(FIRST_LINE)] == made_anew(parts)[: len(FIRST_LINE)]
    for number, part in enumerate(parts):
        without, twice = (
            parts[:number] + parts[number + 1 :],
            [*parts[:number], part, *parts[number:]],
        )
        if part[0] != "log":
            assert "byte" in refusal(tmp_path / "a.proof", made_anew(without))
            assert "byte" in refusal(tmp_path / "a.proof", made_anew(twice))
        elif number + 1 < len(parts):
            swapped = [*parts[:number], parts[number + 1], part]
            assert "block end" in refusal(tmp_path / "a.proof", made_anew(swapped))


@pytest.mark.parametrize(
    ("block", "content", "why"),
    [
        ("statement", b"{}", "missing required field"),
        ("statement", b"[", "byte"),
        ("moves", b'[{"support":[1],"trace":[2],"before":[],"after":[]}]', "not in the support"),
        ("moves", b'[{"support":[1],"trace":[1],"before":[],"after":[1],"after":[1]}]', "twice"),
        ("sites", b"[null]", "a site is"),
        ("sites", b"[1, [2, true]]", "found true"),
        ("moves", b'[{"support":[1],"trace":[true],"before":[],"after":[1]}]', "found true"),
        ("variables", b"1234567", "expected 12 for each"),
        ("ladders", b'[[0,0,"up",[1,2]]]', "up"),
        ("groups", b'[["at most one",[-1]]]', ">= 0"),
        # With names: older versions of pytest make one of all the bytes.
        pytest.param("log", b"a" * (LOG_BYTES + 1), "bytes at most", id="a long log"),
        pytest.param(
            "groups", bytes((1 << 27) + 1), "134217729 bytes, expected 134217728", id="long groups"
        ),
        ("schedule", b"[[99999999999]]", "expected"),
    ],
)
def test_malformed_contents_are_refused(
    block: str, content: bytes, why: str, written: bytes, tmp_path: Path
) -> None:
    """With checksums that hold, what a block holds must still be of its form."""
    parts = [(name, content if name == block else old) for name, old in contents(written)]
    said = refusal(tmp_path / "a.proof", made_anew(parts))
    assert f"block {block}, byte" in said
    assert why in said.lower()


def test_a_key_twice_is_refused(written: bytes, tmp_path: Path) -> None:
    """Of two keys in the statement it is not the last that silently counts."""
    (name, text), *rest = contents(written)
    doubled = text.replace(b"{", b'{"refuted":9,', 1)
    assert msgspec.json.decode(doubled)["refuted"] == 1
    assert "twice" in refusal(tmp_path / "a.proof", made_anew([(name, doubled), *rest]))


def test_a_false_length_takes_no_memory(written: bytes, tmp_path: Path) -> None:
    """A length beyond the end of the file is refused before anything of it is read."""
    (_, at, payload), *_ = blocks(written)
    data = written[:at] + written[at:].replace(b" %d " % len(payload), b" 9999999999 ", 1)
    assert "are to follow, the file has" in refusal(tmp_path / "a.proof", data)


def test_no_file_and_other_files_are_wrong_use(tmp_path: Path) -> None:
    """What is no proof at all is wrong input; a damaged proof is a check that failed."""
    with pytest.raises(InputError, match="No such file"):
        read_proof(tmp_path / "none.proof")
    (tmp_path / "a.proof").write_bytes(b"{}")
    with pytest.raises(InputError, match="no proof"):
        read_proof(tmp_path / "a.proof")
    (tmp_path / "a.proof").write_bytes(FIRST_LINE)
    with pytest.raises(CheckError, match="block statement, byte 17: it is missing"):
        read_proof(tmp_path / "a.proof")
