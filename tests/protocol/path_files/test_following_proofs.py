"""The file of a proof about vehicles: it comes back as it was, and any change of it is refused."""

import zlib
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
import zstandard

from cubepath.protocol.core.errors import CheckError, CubepathError, InputError
from cubepath.protocol.file_forms import form_of
from cubepath.protocol.path_files.following import (
    FIRST_LINE,
    FollowingProof,
    read_following_proof,
    write_following_proof,
)

PROOF = FollowingProof(
    rule="cgshop",
    starts=[(0, 0), (2, 0)],
    ends=[(1, 0), (3, 0)],
    vertices=[(0, 0), (1, 0), (2, 0), (3, 0)],
    edges=[(0, 1), (1, 2), (2, 3)],
    refuted=0,
    solver="some solver",
    variables=np.array([[0, 0, 0, 0], [1, 0, 1, 0], [2, 1, 3, 4]], dtype=np.int32),
    log=[b"a\x02", b"\x00"],
    schedule=[[(0, 1), (1, 3)], []],
)


def fields(proof: FollowingProof) -> dict[str, object]:
    found: dict[str, object] = {name: getattr(proof, name) for name in FollowingProof.__slots__}
    return found | {"variables": proof.variables.tolist(), "log": b"".join(proof.log)}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_following_proof(tmp_path / "a.proof", PROOF)
    return tmp_path / "a.proof"


def test_what_is_written_is_read(path: Path) -> None:
    """Every field comes back, and it is no proof about cubes."""
    assert fields(read_following_proof(path)) == fields(PROOF)
    assert form_of(path).name == "following proof"


def test_every_changed_byte_is_refused(path: Path) -> None:
    """Each byte, with one of its bits flipped, and every file that is cut off."""
    data = path.read_bytes()
    for place in range(len(data)):
        changed = bytearray(data)
        changed[place] ^= 1 << place % 8
        for other in (bytes(changed), data[:place]):
            path.write_bytes(other)
            with pytest.raises(CubepathError) as caught:
                read_following_proof(path)
            told = str(caught.value)
            assert "byte" in told or place <= len(FIRST_LINE)


@pytest.mark.parametrize(
    ("block", "content", "why"),
    [
        ("statement", b"{}", "missing required field"),
        (
            "statement",
            b'{"rule":"mapf","rule":"mapf","starts":[],"ends":[],"standing":"proved","refuted":0,"solver":""}',
            "twice",
        ),
        ("vertices", b"[[0]]", "length 2"),
        ("edges", b"[[0,-1]]", ">= 0"),
        ("variables", b"1234567", "expected 16 for each"),
        ("schedule", b"[[[0,1,2]]]", "length 2"),
    ],
)
def test_malformed_contents_are_refused(path: Path, block: str, content: bytes, why: str) -> None:
    """With checksums that hold, what a block holds must still be of its form."""
    data, count = FIRST_LINE, 0
    rest = path.read_bytes()[len(FIRST_LINE) :]
    while not rest.startswith(b"end "):
        line, rest = rest.split(b"\n", 1)
        name, size = line.split()[0].decode(), int(line.split()[1])
        payload, rest = rest[:size], rest[size + 1 :]
        if name == block:
            payload = zstandard.ZstdCompressor().compress(content)
        head = f"{name} {len(payload)} ".encode()
        data += b"%s%08x\n%s\n" % (head, zlib.crc32(head + payload), payload)
        count += 1
    path.write_bytes(data + f"end {count} {sha256(data).hexdigest()}\n".encode())
    with pytest.raises(CheckError) as caught:
        read_following_proof(path)
    assert f"block {block}, byte" in str(caught.value)
    assert why in str(caught.value).lower()


def test_a_long_log_comes_back_in_pieces(path: Path) -> None:
    """However its pieces were cut when it was written."""
    log = [bytes([number]) * 400_001 for number in range(6)]
    write_following_proof(path, replace(PROOF, log=iter(log)))
    found = read_following_proof(path).log
    assert b"".join(found) == b"".join(log)
    assert len(list(found)) == 3


def test_other_files_are_wrong_use(tmp_path: Path) -> None:
    """What is no such proof at all is wrong input."""
    (tmp_path / "a.proof").write_bytes(b"cubepath proof 1\n")
    with pytest.raises(InputError, match="no proof: expected"):
        read_following_proof(tmp_path / "a.proof")
    with pytest.raises(InputError, match="No such file"):
        read_following_proof(tmp_path / "none.proof")
