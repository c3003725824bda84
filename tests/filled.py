"""Structs with a value other than its default in each field, made from the types of the fields."""

from collections.abc import Callable
from importlib import import_module
from itertools import count
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from mutants import ROOT, SEARCHED, module_name

TEXT = "text "
"""How all texts begin that are made."""
S = TypeVar("S", bound=msgspec.Struct)


def all_structs() -> list[type[msgspec.Struct]]:
    """Return every struct that the source defines, in the order of files."""
    found: list[type[msgspec.Struct]] = []
    for room in SEARCHED:
        for path in sorted((ROOT / room).rglob("*.py")):
            if "msgspec.Struct" not in path.read_text():
                continue
            module = import_module(module_name(str(path.relative_to(ROOT))))
            found += [
                each
                for each in vars(module).values()
                if isinstance(each, type)
                and issubclass(each, msgspec.Struct)
                and each.__module__ == module.__name__
            ]
    return found


def filled(struct: type[S], **given: object) -> S:
    """Return a struct in which no two numbers or texts are the same; lists have each kind of item.

    What is `given` has this value in the fields of that name, if there are any.

    >>> from cubepath.protocol.wire.messages import Presence
    >>> filled(Presence)
    Presence(round=1, module=2, site=[3, 'text 4'])
    """
    made: S = _Filler().values(inspect.type_info(struct))[0]
    known = {name: value for name, value in given.items() if name in struct.__struct_fields__}
    return msgspec.structs.replace(made, **known)


class _Filler:
    def __init__(self) -> None:
        self._numbers = count(1)

    def values(self, kind: Any) -> list[Any]:
        """Return a value of each kind that a type allows, none of them None, false or empty."""
        return _VALUES[type(kind)](self, kind)

    def object(self, kind: Any) -> list[Any]:
        fields = {field.name: self.values(field.type)[0] for field in kind.fields}
        return [kind.cls(**fields)]

    def alternatives(self, kind: Any) -> list[Any]:
        return [value for each in kind.types for value in self.values(each)]

    def text(self) -> str:
        return f"{TEXT}{self.number()}"

    def number(self) -> int:
        return next(self._numbers)


_VALUES: dict[type[inspect.Type], Callable[[_Filler, Any], list[Any]]] = {
    inspect.NoneType: lambda _, __: [],
    inspect.BoolType: lambda _, __: [True],
    inspect.IntType: lambda filler, _: [filler.number()],
    inspect.FloatType: lambda filler, kind: [
        filler.number() + 0.5 if kind.le is None else kind.le / (filler.number() + 0.5)
    ],
    inspect.StrType: lambda filler, _: [filler.text()],
    inspect.BytesType: lambda filler, _: [filler.text().encode()],
    inspect.LiteralType: lambda _, kind: [kind.values[-1]],
    inspect.AnyType: lambda filler, _: [[filler.number(), filler.text()]],
    inspect.CustomType: lambda filler, _: [(filler.number(), filler.text())],  # a site
    inspect.RawType: lambda _, __: [msgspec.Raw(b"1")],
    inspect.ListType: lambda filler, kind: [filler.values(kind.item_type)],
    inspect.VarTupleType: lambda filler, kind: [tuple(filler.values(kind.item_type))],
    inspect.TupleType: lambda filler, kind: [
        tuple(filler.values(each)[0] for each in kind.item_types)
    ],
    inspect.DictType: lambda filler, kind: [
        {filler.values(kind.key_type)[0]: filler.values(kind.value_type)[0]}
    ],
    inspect.UnionType: _Filler.alternatives,
    inspect.StructType: _Filler.object,
    inspect.NamedTupleType: _Filler.object,
}
"""How values of a type are made."""
