"""Options that are declared once, as fields of a dataclass with bounds and a description.

A field of type ``Annotated[float, Meta(ge=0, lt=1, description="...")]`` is checked here, and
becomes an option of the command line where a command asks for it.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from types import NoneType
from typing import (
    Annotated,
    Any,
    Literal,
    SupportsFloat,
    SupportsIndex,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from msgspec import Meta

from cubepath.protocol.core.errors import InputError, OptionError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.parsing import Keys

_O = TypeVar("_O")


def whole_number(
    name: str, found: object, least: int | None = None, most: int | None = None
) -> int:
    """Return a whole number; InputError if it is none, less than `least` or more than `most`."""
    expected = "a whole number" if least is None else f"{least} or more"
    expected = expected if most is None else f"{least} to {most}"
    if isinstance(found, bool) or not isinstance(found, SupportsIndex):
        raise InputError(f"{name}={found!r}: expected {expected}")
    number = found.__index__()
    if (least is not None and number < least) or (most is not None and number > most):
        raise InputError(f"{name}={number}: expected {expected}")
    return number


def real_number(name: str, found: object) -> float:
    """Return a number, which may be infinite or none; InputError if it is of another type."""
    if isinstance(found, bool) or not isinstance(found, SupportsFloat):
        raise InputError(f"{name}={found!r}: expected a number")
    return float(found)


def seconds(name: str, found: object, most: float = math.inf) -> float:
    """Return a time in seconds; InputError if it is none, less than 0, or more than `most`."""
    value = real_number(name, found)
    if not 0 <= value <= most:
        expected = "0 or more seconds" if most == math.inf else f"0 to {most:g} seconds"
        raise InputError(f"{name}={value:g}: expected {expected}")
    return value


def known_name(what: str, name: object, known: Iterable[str]) -> str:
    """Return a name that is known; InputError with the nearest one if it is not.

    The error begins with `what`, such as ``phase=``.
    """
    names = list(known)
    if isinstance(name, str) and name in names:
        return name
    near = did_you_mean(name, names) if isinstance(name, str) else ""
    raise InputError(f"{what}{name}: expected one of {', '.join(names) or 'none'}{near}")


def function(name: str, found: object) -> None:
    """Check that something can be called; InputError if not."""
    if not callable(found):
        raise InputError(f"{name}={found!r}: expected a function")


@dataclass(frozen=True, slots=True)
class OptionField:
    """A field that is an option."""

    name: str
    kind: type
    """`int`, `float`, `bool`, `str` or `Path`."""
    meta: Meta
    choices: tuple[str, ...] = ()
    """The values that a text can have; any if there are none."""
    may_be_none: bool = False

    @property
    def key(self) -> str:
        """Return its name in messages: as on the command line, without hyphens before it."""
        return self.name.replace("_", "-")

    @property
    def expected(self) -> str:
        """Return its bounds in words."""
        meta = self.meta
        if meta.ge is not None and meta.le is not None:
            return f"{meta.ge:.12g} to {meta.le:.12g}"
        if meta.ge is not None and meta.lt is None:
            return f"{meta.ge:.12g} or more"
        bounds = {"at least": meta.ge, "more than": meta.gt, "at most": meta.le}
        bounds["less than"] = meta.lt
        return " and ".join(f"{word} {at:.12g}" for word, at in bounds.items() if at is not None)

    def fits(self, value: float) -> bool:
        """Return whether a number is within the bounds."""
        meta = self.meta
        return (
            not math.isnan(value)
            and (meta.ge is None or value >= meta.ge)
            and (meta.gt is None or value > meta.gt)
            and (meta.le is None or value <= meta.le)
            and (meta.lt is None or value < meta.lt)
        )

    def check(self, value: object, key: str | None = None) -> None:
        """Check a value from Python; OptionError, by the name `key`, if it does not fit."""
        key = key or self.key
        if value is None and self.may_be_none:
            return
        if self.kind in {int, float}:
            number = (whole_number if self.kind is int else real_number)(key, value)
            if not self.fits(number):
                raise OptionError(f"{key}={number:g}: expected {self.expected}")
        elif self.choices:
            if value not in self.choices:
                near = did_you_mean(str(value), self.choices)
                expected = ", ".join(self.choices)
                raise OptionError(f"{key}={value}{near}: expected one of {expected}")
        elif not isinstance(value, self.kind):
            expected = {Path: "a path", bool: "true or false"}.get(self.kind, "a text")
            raise OptionError(f"{key}={value!r}: expected {expected}")


@cache
def option_fields(struct: type) -> Mapping[str, OptionField]:
    """Return the fields of a dataclass that are options, by their names."""
    hints = get_type_hints(struct, include_extras=True)
    found = {name: _field(name, hint) for name, hint in hints.items()}
    return {name: field for name, field in found.items() if field is not None}


def _field(name: str, hint: Any) -> OptionField | None:
    kinds = get_args(hint) if get_origin(hint) is not Annotated else (hint,)
    for each in kinds:
        if get_origin(each) is Annotated:
            kind, *others = get_args(each)
            metas = [meta for meta in others if isinstance(meta, Meta)]
            choices = get_args(kind) if get_origin(kind) is Literal else ()
            if metas:
                kind = str if choices else kind
                return OptionField(name, kind, metas[0], choices, NoneType in kinds)
    return None


def check_options(options: Any) -> None:
    """Check all options among the fields of a dataclass; InputError for the first wrong one."""
    struct: type = type(options)
    for name, field in option_fields(struct).items():
        field.check(getattr(options, name))


def keys_of(struct: type) -> Keys:
    """Return the options of a dataclass as keys that a name may have, with their defaults."""
    defaults = {field.name: field.default for field in fields(struct)}
    return {
        name.rstrip("_"): (str(defaults[name]), field.meta.description or "")
        for name, field in option_fields(struct).items()
    }


def options_from_values(struct: type[_O], values: Mapping[str, str]) -> _O:
    """Return the dataclass whose numbers have these values; InputError names a wrong one."""
    found: dict[str, float] = {}
    kind: type = struct
    for name, field in option_fields(kind).items():
        key = name.rstrip("_")
        try:
            found[name] = field.kind(values[key])
            field.check(found[name], key)
        except ValueError:
            what = "a whole number" if field.kind is int else "a number"
            raise InputError(f"{key}={values[key]}: expected {what}, {field.expected}") from None
        except OptionError as error:
            raise InputError(str(error)) from None
    return struct(**found)
