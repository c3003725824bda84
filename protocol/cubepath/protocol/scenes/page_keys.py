"""The keys of a page, and numbers that are arithmetic over them."""

import ast
import operator
import re
from collections.abc import Callable, Mapping
from keyword import iskeyword
from typing import Any

import msgspec

from cubepath.protocol.core.errors import InputError
from cubepath.protocol.core.parsing import Keys, all_values, converted, given_values
from cubepath.protocol.scenes.registry import whole

NUMBER_MAX = 10**18 - 1
"""The greatest value of a key without `most`, the greatest seed."""
_LONGEST = 200
_WRITTEN = re.compile(r"(?:[\s()+*/%-]|[^\W\d]\w*+|\d++(?!\w))*+")
_OPERATORS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.FloorDiv: operator.floordiv,
    ast.Mod: operator.mod,
}
SCENE = "scene"
"""The key that chooses among the scenes of a page."""


class PageKey(msgspec.Struct, forbid_unknown_fields=True):
    """The table of a key."""

    default: int
    least: int = 0
    most: int = NUMBER_MAX
    help: str = ""


def page_keys(table: Mapping[str, Any]) -> dict[str, PageKey]:
    """Return the keys in the table ``[keys]``; a number alone is a default."""
    keys: dict[str, PageKey] = {}
    for name, value in table.items():
        if not name.isidentifier() or iskeyword(name) or name == SCENE:
            raise InputError(f"keys: {name!r}: expected a name of letters that is not reserved")
        table = value if isinstance(value, dict) else {"default": value}
        key = keys[name] = converted(table, PageKey, f"keys: {name}")
        if not key.least <= key.default <= key.most:
            raise InputError(
                f"keys: {name}: default: expected {key.least} to {key.most}, found {key.default}"
            )
    return keys


def as_keys(keys: Mapping[str, PageKey], scenes: Mapping[str, object]) -> Keys:
    """Return the keys with their defaults and a line on each, `scene` among them if need be."""
    found = {name: (str(key.default), key.help) for name, key in keys.items()}
    if scenes:
        found[SCENE] = (next(iter(scenes)), "one of " + ", ".join(scenes))
    return found


def key_values(
    keys: Mapping[str, PageKey], scenes: Mapping[str, object], given: str
) -> tuple[dict[str, int], str]:
    """Return the values of the keys, given ones or defaults, and the scene; empty if none."""
    known = as_keys(keys, scenes)
    values = all_values(given_values(given, known, "keys"), known)
    chosen = values.get(SCENE, "")
    if scenes and chosen not in scenes:
        raise InputError(f"scene={chosen}: expected one of {', '.join(scenes)}")
    return {
        name: whole(values, name, least=key.least, most=key.most) for name, key in keys.items()
    }, chosen


def number_of(value: object, values: Mapping[str, int], what: str) -> int:
    """Return a whole number: itself, or the arithmetic that a text is; InputError begins `what`.

    >>> number_of("2*n - 1", {"n": 4}, "line")
    7
    """
    if type(value) is int:
        return value
    if isinstance(value, str) and len(value) <= _LONGEST and _WRITTEN.fullmatch(value):
        try:
            return _evaluated(ast.parse(value.strip(), mode="eval").body, values)
        except (SyntaxError, ValueError, ZeroDivisionError, MemoryError, RecursionError):
            pass
    known = f" over {', '.join(values)}" if values else ""
    raise InputError(
        f"{what}: expected a whole number or arithmetic{known} with + - * // %, found {value!r}"
    )


def _evaluated(tree: ast.expr, values: Mapping[str, int]) -> int:
    match tree:
        case ast.Constant(value=int(number)) if type(number) is int:
            return number
        case ast.Name(id=name) if name in values:
            return values[name]
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return -_evaluated(inner, values)
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _OPERATORS:
            return _OPERATORS[type(sign)](_evaluated(left, values), _evaluated(right, values))
        case _:
            raise ValueError


def with_numbers(value: object, values: Mapping[str, int], what: str) -> object:
    """Return lists in lists with the numbers that their texts are."""
    if isinstance(value, list):
        return [with_numbers(item, values, what) for item in value]
    return number_of(value, values, what) if isinstance(value, str) else value
