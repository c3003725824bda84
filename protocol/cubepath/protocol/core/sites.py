"""Sites: the hashable places of a workspace, their JSON form, canonical order and key chunks.

A site is a number, a text or a tuple of sites: a lattice cell ``(q, r)``, a lattice edge ``(x, y,
axis)``, a graph vertex ``"dock"``, a labelled place ``((x, y), 3)``.

`Ordinals` numbers things in order of first use: so sites become integers and bits.
"""

from collections.abc import Hashable, Iterable
from itertools import chain
from typing import TYPE_CHECKING, Any, TypeVar, cast

import msgspec

from cubepath.protocol.core.errors import InputError

Thing = TypeVar("Thing", bound=Hashable)
if TYPE_CHECKING:
    Site = Hashable
    """What can be on or off: a number, a text, or a tuple of sites."""
else:
    # msgspec checks what `site_hook` returns, for which an abstract class takes as long as the rest
    # of decoding a site.
    Site = object

_encode = msgspec.json.Encoder().encode


DEPTH_MAX = 64
"""How deeply the lists of a site may be nested: far below Python's recursion limit."""


def site_from_json(value: object, deep: int = DEPTH_MAX) -> Site:
    """Return the site that a JSON value stands for: lists become tuples, up to `deep` levels.

    Raises InputError for objects, booleans and null, which name no place, and for lists nested
    deeper. In Python True equals 1, in JSON it does not.

    >>> site_from_json([[0, 1], "x"])
    ((0, 1), 'x')
    """
    if isinstance(value, list | tuple):
        if not deep:
            raise InputError(f"a site is lists in lists {DEPTH_MAX} deep at most, found more")
        for item in value:
            if type(item) is not int:
                break
        else:  # a cell, as nearly always: a call for each number would take thrice as long
            return tuple(value)
        return tuple([site_from_json(item, deep - 1) for item in value])
    if isinstance(value, float) and value.is_integer():
        return int(value)  # 1.0 and 1 are one site, so they need one text
    if isinstance(value, str | int | float) and not isinstance(value, bool):
        return value
    found = site_text(value) if value is None or isinstance(value, bool) else repr(value)
    raise InputError(f"a site is a JSON number, string or list, found {found}")


def site_hook(kind: type, value: object) -> Site:
    """Decode a field of type `Site`: the ``dec_hook`` of every decoder of structs with sites.

    Raises ValueError, which msgspec reports with the place of the field.
    """
    if type(value) is int:
        return value
    if type(value) is list:
        for item in value:
            if type(item) is not int:
                break
        else:  # as in `site_from_json`, without one more call for each site of a recording
            return tuple(value)
    if kind is not Site:
        raise NotImplementedError(f"no field of type {kind} can be decoded")
    try:
        return site_from_json(value)
    except InputError as error:
        raise ValueError(str(error)) from None


def sites_from_json(values: Iterable[object]) -> tuple[Site, ...]:
    """Return the sites that JSON values stand for; errors as `site_from_json`."""
    return tuple(site_from_json(value) for value in values)


def to_json(value: object) -> Any:
    """Return a site, or nested tuples of sites, in JSON form: tuples become lists."""
    if isinstance(value, tuple):
        return [to_json(item) for item in value]
    return value


def site_text(site: Site) -> str:
    """Return the compact JSON text of a site; equal sites have equal texts.

    >>> place: Site = (1, 2)
    >>> site_text(place)
    '[1,2]'
    """
    return _encode(site).decode()


def in_order(sites: Iterable[Thing]) -> tuple[Thing, ...]:
    """Return sites, or pairs of sites, in canonical order, which depends on their content alone.

    >>> in_order({(1, 0), (0, 2), (0, 1)})
    ((0, 1), (0, 2), (1, 0))
    """
    found: tuple[Any, ...] = tuple(sites)
    if len(found) < 2:
        return found
    return tuple(sorted(found) if _alike(found) else sorted(found, key=_order))


def _alike(sites: Iterable[Site]) -> bool:
    """Return whether Python's own order of these sites is the canonical one.

    It is if all are numbers, or all texts, or all tuples whose items are again alike.
    """
    kinds = set(map(type, sites))
    while kinds == {tuple}:
        sites = tuple(chain.from_iterable(cast("Iterable[tuple[Site, ...]]", sites)))
        kinds = set(map(type, sites))
    return kinds in ({int}, {str})


def _order(site: Site) -> tuple[object, ...]:
    # Numbers sort as numbers, so a lattice is in order row by row, not as text ("10" < "9").
    if isinstance(site, tuple):
        return (2, tuple(_order(item) for item in site))
    if isinstance(site, str):
        return (1, site)
    return (0, site)


class Ordinals(dict[Thing, int]):
    """The numbers of things, from 0 in the order in which they are first looked up.

    Equal things share a number. `get` and `in` assign no numbers.

    >>> numbers = Ordinals[str]()
    >>> numbers["b"], numbers["a"], numbers["b"], list(numbers), "c" in numbers
    (0, 1, 0, ['b', 'a'], False)
    """

    def __missing__(self, thing: Thing) -> int:
        """Assign the next number to a thing."""
        number = self[thing] = len(self)
        return number
