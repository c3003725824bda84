"""Certificates: proofs that a schedule is a shortest one in the class of its path.

This is the format, in files and in recordings; see docs/schedules.md. Certificates are built and
checked in the coordinator, by modules that share only this one.
"""

from pathlib import Path

import msgspec

from cubepath.protocol.core.errors import InputError, errors_at
from cubepath.protocol.core.input_files import Source, opened
from cubepath.protocol.core.parsing import check_keys
from cubepath.protocol.core.sites import Site, site_hook
from cubepath.protocol.path_files.moves import write_lines

FORMAT = "cubepath-certificate-1"
SUFFIX = ".certificate.json"
"""The certificate of a cubes file ``NAME.jsonl`` lies beside it, as ``NAME`` with this suffix."""


class Certificate(
    msgspec.Struct,
    frozen=True,
    omit_defaults=True,
    forbid_unknown_fields=True,
    tag_field="format",
    tag=FORMAT,
):
    """A proof, by the places of moves in the input: the first move is move 1.

    `moves` is how many there are. `cancelled` holds the pairs that undo each other, each as
    (earlier, later) and all in increasing order of the later. `cubes` holds the moves that remain,
    cube by cube: the schedule. `chain` has one move of each cube, and no two neighbours in it
    commute. `end` holds the sites that are on at the end, None where nobody knows the start.
    """

    moves: int
    cancelled: list[tuple[int, int]]
    cubes: list[list[int]]
    chain: list[int]
    end: list[Site] | None = None


class _Other(msgspec.Struct, tag_field="format", tag=""):
    """No format at all: where there is only one struct, msgspec lets its tag be left out."""


_decoder: msgspec.json.Decoder[Certificate | _Other] = msgspec.json.Decoder(
    Certificate | _Other, dec_hook=site_hook
)


def certificate_from_json(text: bytes) -> Certificate:
    """Return the certificate in a JSON text; InputError says what is wrong in it, and where."""
    try:
        found = _decoder.decode(text)
        if isinstance(found, _Other):
            raise InputError(f"no {FORMAT}: its format is empty")
        check_keys(text, 5 + (found.end is not None), where="line ")
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"no {FORMAT}: {error}") from None
    return found


def read_certificate(source: Source) -> Certificate:
    """Read a certificate; InputError, with the file, if it cannot be read or is none.

    >>> step = Action([1, 2], [1, 2], [1], [2])
    >>> write_certificate("proof.json", certificate_of([step, step]))
    >>> found = read_certificate("proof.json")
    >>> found.moves, found.cancelled
    (2, [(1, 2)])
    """
    with opened(source) as file:
        text = file.whole()
    with errors_at(str(file.path)):
        return certificate_from_json(text)


def write_certificate(path: Path | str, certificate: Certificate) -> None:
    """Write a certificate, as one line; the file is complete afterwards, or unchanged.

    Raises InputError if it cannot be written.

    >>> left, right = Action([1, 2], [1, 2], [1], [2]), Action([2, 3], [2, 3], [2], [3])
    >>> write_certificate("proof.json", certificate_of([left, right], start={1}))
    >>> read_certificate("proof.json").chain
    [1, 2]
    """
    write_lines(path, [certificate])


def companion(cubes: Path) -> Path:
    """Return the path of the certificate beside a cubes file.

    >>> companion(Path("plans/cubes.jsonl")).name
    'cubes.certificate.json'
    """
    return cubes.with_name(cubes.stem + SUFFIX)
