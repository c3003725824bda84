"""Options that are declared once, as fields of a dataclass with bounds and a description.

A field of type ``Annotated[float, Meta(ge=0, lt=1, description="...")]`` is checked here, and
becomes an option of the command line where a command asks for it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from msgspec import Meta

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.formatting import did_you_mean
from cubepath.protocol.core.given import real_number, whole_number


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
            return f"{meta.ge:g} to {meta.le:g}"
        if meta.ge is not None and meta.lt is None:
            return f"{meta.ge:g} or more"
        bounds = {"at least": meta.ge, "more than": meta.gt, "at most": meta.le}
        bounds["less than"] = meta.lt
        return " and ".join(f"{word} {at:g}" for word, at in bounds.items() if at is not None)

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

    def check(self, value: object) -> None:
        """Check a value from Python; InputError if it is none for this option."""
        if value is None and self.may_be_none:
            return
        if self.kind in {int, float}:
            number = (whole_number if self.kind is int else real_number)(self.key, value)
            if not self.fits(number):
                raise InputError(f"{self.key}={number:g}: expected {self.expected}")
        elif self.choices:
            if value not in self.choices:
                near = did_you_mean(str(value), self.choices)
                expected = ", ".join(self.choices)
                raise InputError(f"{self.key}={value}{near}: expected one of {expected}")
        elif not isinstance(value, self.kind):
            expected = {Path: "a path", bool: "true or false"}.get(self.kind, "a text")
            raise InputError(f"{self.key}={value!r}: expected {expected}")


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
