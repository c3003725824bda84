"""Small changes of a module's syntax tree, each of which some test should notice.

What nobody runs, or only people read, is left alone: docstrings, annotations, type aliases,
imports, blocks for type checkers, decorators, texts, and what an error says. An assertion that
something cannot happen is not taken out either, a zip stays strict, and a struct frozen, which type
checkers see to.
"""

import ast
from collections import Counter
from collections.abc import Callable, Iterator
from copy import copy
from dataclasses import dataclass
from functools import singledispatch
from typing import TypeVar

Node = TypeVar("Node", bound=ast.AST)

_COMPARED: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
_COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Add,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
}
_CALLED = {"min": "max", "max": "min", "any": "all", "all": "any", "sorted": "list"}
_SYMMETRIC = {"min", "max"}
_UNTOUCHED_FIELDS = {"annotation", "returns", "decorator_list", "type_params", "ctx", "op", "ops"}


@dataclass(frozen=True, slots=True)
class Mutation:
    """A change at a line, in words; `apply` makes it in the tree that it was found in."""

    function: str
    """The qualified name of what it is in, as ``Heap.push``; empty outside of all."""
    line: int
    before: str
    after: str
    apply: Callable[[], None]


def mutations(tree: ast.Module) -> list[Mutation]:
    """Return all changes of a module, in the order of its syntax tree; none leaves it as it is."""
    return [
        Mutation(name, node.lineno, _head(node), _head(other), _put(parent, field, at, other))
        for name, parent, field, at, node in _places(tree, "")
        for other in _changed(node, parent)
        if ast.dump(other) != ast.dump(node)
    ]


def _head(node: ast.AST) -> str:
    """Return the code of a node; of a statement with a body the first line."""
    return ast.unparse(node).partition("\n")[0]


_Place = tuple[str, ast.AST, str, int | None, ast.expr | ast.stmt]
"""A node with where it hangs: the function, its parent, the field of that, the index in a list."""


def _put(parent: ast.AST, field: str, at: int | None, node: ast.AST) -> Callable[[], None]:
    def put() -> None:
        if at is None:
            setattr(parent, field, node)
        else:
            getattr(parent, field)[at] = node
        ast.fix_missing_locations(parent)

    return put


def _places(parent: ast.AST, function: str) -> Iterator[_Place]:
    """Yield the statements and expressions below a node, without what is left alone."""
    if isinstance(parent, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        function = f"{function}.{parent.name}" if function else parent.name
    for field, value in ast.iter_fields(parent):
        if field in _UNTOUCHED_FIELDS:
            continue
        nodes = value if isinstance(value, list) else [value]
        for at, node in enumerate(nodes):
            if not isinstance(node, ast.AST) or _is_left_alone(node):
                continue
            if isinstance(node, ast.expr | ast.stmt):
                yield function, parent, field, at if isinstance(value, list) else None, node
            if not isinstance(node, ast.Raise):
                yield from _places(node, function)


def _is_left_alone(node: ast.AST) -> bool:
    match node:
        case (
            ast.Import()
            | ast.ImportFrom()
            | ast.JoinedStr()
            | ast.Expr(value=ast.Constant())
            | ast.AnnAssign(annotation=ast.Name(id="TypeAlias"))
            | ast.AnnAssign(value=None)
            | ast.Assign(targets=[ast.Name(id="__slots__" | "__all__")])
            | ast.If(test=ast.Name(id="TYPE_CHECKING"))
            | ast.Raise(exc=ast.Call(func=ast.Name(id="AssertionError")))
            | ast.keyword(arg="strict" | "frozen")
        ):
            return True
        case _:
            return False


@singledispatch
def _changed(node: ast.AST, parent: ast.AST) -> Iterator[ast.AST]:
    """Yield what a node may be replaced by: nothing, unless its kind is registered below."""
    del node, parent
    yield from ()


@_changed.register
def _(node: ast.Expr | ast.Delete | ast.Raise, _: ast.AST) -> Iterator[ast.AST]:
    yield _nothing(node)


@_changed.register
def _(node: ast.AugAssign, _: ast.AST) -> Iterator[ast.AST]:
    yield _nothing(node)
    other = _COMPUTED.get(type(node.op))
    if other is not None:
        yield _with(node, op=other())


@_changed.register
def _(node: ast.Assign, parent: ast.AST) -> Iterator[ast.AST]:
    match node.targets:
        case [ast.Attribute() | ast.Subscript()]:
            yield _nothing(node)
        case [ast.Name(id=name)] if _bound_again(parent, name):
            yield _nothing(node)
        case _:
            pass


@_changed.register
def _(node: ast.Return, _: ast.AST) -> Iterator[ast.AST]:
    match node.value:
        case None | ast.Constant(value=None):
            pass
        case _:
            yield _with(node, value=ast.Constant(None))


@_changed.register
def _(node: ast.Continue, _: ast.AST) -> Iterator[ast.AST]:
    yield ast.copy_location(ast.Break(), node)


@_changed.register
def _(node: ast.Break, _: ast.AST) -> Iterator[ast.AST]:
    yield ast.copy_location(ast.Continue(), node)


@_changed.register
def _(node: ast.If | ast.While, _: ast.AST) -> Iterator[ast.AST]:
    match node.test:
        case ast.UnaryOp(op=ast.Not()) | ast.Compare(ops=[_]):
            pass  # such a condition is turned round by itself
        case test:
            yield _with(node, test=ast.UnaryOp(ast.Not(), test))


@_changed.register
def _(node: ast.Compare, _: ast.AST) -> Iterator[ast.AST]:
    for at, operator in enumerate(node.ops):
        for other in _COMPARED[type(operator)]:
            yield _with(node, ops=[*node.ops[:at], other(), *node.ops[at + 1 :]])


@_changed.register
def _(node: ast.BinOp, _: ast.AST) -> Iterator[ast.AST]:
    other = _COMPUTED.get(type(node.op))
    if other is not None:
        yield _with(node, op=other())
    yield node.left
    yield node.right


@_changed.register
def _(node: ast.BoolOp, _: ast.AST) -> Iterator[ast.AST]:
    yield _with(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
    for at in range(len(node.values)):
        rest = [*node.values[:at], *node.values[at + 1 :]]
        yield rest[0] if len(rest) == 1 else _with(node, values=rest)


@_changed.register
def _(node: ast.UnaryOp, _: ast.AST) -> Iterator[ast.AST]:
    yield node.operand


@_changed.register
def _(node: ast.IfExp, _: ast.AST) -> Iterator[ast.AST]:
    yield _with(node, body=node.orelse, orelse=node.body)


@_changed.register
def _(node: ast.Constant, parent: ast.AST) -> Iterator[ast.AST]:
    match node.value:
        case bool(value):
            yield _with(node, value=not value)
        case int(value):
            yield _with(node, value=value + 1)
            yield _with(node, value=value - 1)
        case str(value) if isinstance(parent, ast.Compare | ast.Subscript):
            yield _with(node, value=f"{value}?")
        case _:
            pass


@_changed.register
def _(node: ast.Call, _: ast.AST) -> Iterator[ast.AST]:
    keywords, arguments = node.keywords, node.args
    for at, keyword in enumerate(keywords):
        if keyword.arg not in {None, "strict"}:
            yield _with(node, keywords=[*keywords[:at], *keywords[at + 1 :]])
    called = node.func.id if isinstance(node.func, ast.Name) else ""
    starred = any(isinstance(each, ast.Starred) for each in arguments[:2])
    if len(arguments) > 1 and not starred and called not in _SYMMETRIC:
        yield _with(node, args=[arguments[1], arguments[0], *arguments[2:]])
    if called in _CALLED:
        kept = [] if called == "sorted" else keywords  # a list takes no key to sort by
        yield _with(node, func=_with(node.func, id=_CALLED[called]), keywords=kept)


@_changed.register
def _(node: ast.Slice, _: ast.AST) -> Iterator[ast.AST]:
    if node.lower is not None:
        yield _with(node, lower=None)
    if node.upper is not None:
        yield _with(node, upper=None)


@_changed.register
def _(
    node: ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp, _: ast.AST
) -> Iterator[ast.AST]:
    for at, loop in enumerate(node.generators):
        for place in range(len(loop.ifs)):
            other = _with(loop, ifs=[*loop.ifs[:place], *loop.ifs[place + 1 :]])
            yield _with(node, generators=[*node.generators[:at], other, *node.generators[at + 1 :]])


def _nothing(node: ast.stmt) -> ast.Pass:
    return ast.copy_location(ast.Pass(), node)


def _bound_again(parent: ast.AST, name: str) -> bool:
    """Tell whether a name is bound more than once below a node, so that one can be left out."""
    bound = Counter(
        each.arg if isinstance(each, ast.arg) else each.id
        for each in ast.walk(parent)
        if isinstance(each, ast.arg)
        or (isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store))
    )
    return bound[name] > 1


def _with(node: Node, **fields: object) -> Node:
    """Return a shallow copy of a node with other fields."""
    other = copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other
