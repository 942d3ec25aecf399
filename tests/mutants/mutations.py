"""The small changes to a source file that its tests ought to notice."""

import ast
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass

_COMPARE: dict[type, type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
_ARITHMETIC: dict[type, type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult,
    ast.FloorDiv: ast.Mult, ast.Pow: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift,
    ast.BitAnd: ast.BitOr, ast.BitOr: ast.BitAnd,
}  # fmt: skip
_FUNCTIONS = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum",
              "any": "all", "all": "any", "floor": "ceil", "sin": "cos", "cos": "sin"}  # fmt: skip
_WORDS_ONLY = {"log", "_log", "logger", "print", "warnings"}  # what is said, not what is done


@dataclass(frozen=True)
class Mutant:
    """One change: bytes ``start`` to ``end`` of the file at ``path`` become ``after``."""

    path: str
    scope: str  # the function's __qualname__, "" at module level
    line: int
    before: str
    after: str
    start: int
    end: int
    nth: int = 0  # which of the same changes in the same scope

    @property
    def name(self) -> str:
        """What stays the same when lines move: file, function, change."""
        nth = f" #{self.nth + 1}" if self.nth else ""
        return f"{self.path}:{self.scope or '-'}: {self.before} -> {self.after}{nth}"

    def apply(self, source: bytes) -> bytes:
        """The changed file."""
        return source[: self.start] + self.after.encode() + source[self.end :]


def mutants_of(path: str, source: bytes) -> list[Mutant]:
    """Every mutant of one file."""
    starts = [0]
    for row in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))
    found, seen = [], Counter[tuple[str, str, str]]()
    for prefix, node, after in _changes(ast.parse(source), ""):
        scope = prefix.removesuffix(".<locals>.").removesuffix(".")
        start = starts[node.lineno - 1] + node.col_offset
        end = starts[(node.end_lineno or 0) - 1] + (node.end_col_offset or 0)
        before = " ".join(source[start:end].decode().split())
        nth = seen[scope, before, after]
        seen[scope, before, after] += 1
        found.append(Mutant(path, scope, node.lineno, before, after, start, end, nth))
    return found


def _changes(node: ast.AST, prefix: str) -> Iterator[tuple[str, ast.expr | ast.stmt, str]]:
    if isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom) or _is_talk(node):
        return
    if isinstance(node, ast.expr | ast.stmt):
        for after in _replacements(node):
            if after != ast.unparse(node):  # two equal arguments are the same the other way round
                yield prefix, node, after
    inner = prefix
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        inside = ".<locals>." if isinstance(node, ast.FunctionDef) else "."
        inner = f"{prefix}{node.name}{inside}"
    for field, value in ast.iter_fields(node):
        if field in ("annotation", "returns", "decorator_list", "exc"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _changes(child, inner)


def _is_talk(node: ast.AST) -> bool:
    """Is this a string by itself, a line for a log, or the guard of a script?"""
    if isinstance(node, ast.If):
        return "__name__" in ast.unparse(node.test)
    if not isinstance(node, ast.Expr):
        return False
    called = node.value.func if isinstance(node.value, ast.Call) else node.value
    while isinstance(called, ast.Attribute):
        called = called.value
    return isinstance(called, ast.Constant) or (
        isinstance(called, ast.Name) and called.id in _WORDS_ONLY
    )


def _replacements(node: ast.expr | ast.stmt) -> Iterator[str]:
    match node:
        case ast.Raise() | ast.Expr(value=ast.Call()):
            yield "pass"
        case ast.Assign(targets=[ast.Attribute()]) | ast.AugAssign(target=ast.Attribute()):
            yield "pass"
        case ast.Return(value=ast.expr() as value) if not isinstance(value, ast.Constant):
            yield "return None"
        case ast.Compare(left, ops, rights):
            for i, op in enumerate(ops):
                others = [*ops[:i], _COMPARE[type(op)](), *ops[i + 1 :]]
                yield f"({ast.unparse(ast.Compare(left, others, rights))})"
        case ast.BoolOp(op, values):
            other = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield f"({ast.unparse(ast.BoolOp(other, values))})"
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield f"({ast.unparse(operand)})"
        case ast.BinOp(left, op, right) if type(op) in _ARITHMETIC and not _is_text(left, right):
            yield f"({ast.unparse(ast.BinOp(left, _ARITHMETIC[type(op)](), right))})"
        case ast.Constant(value=bool() as truth):
            yield str(not truth)
        case ast.Constant(value=int() as number):
            yield str(number + 1)
        case ast.Constant(value=float() as number):
            yield repr(number * 2 if number else 1.0)
        case ast.Dict(keys, values) if len(values) > 1:
            swapped = ast.Dict(keys, [values[1], values[0], *values[2:]])
            yield ast.unparse(swapped)
        case ast.Call(func, args, keywords):
            yield from _other_calls(func, args, keywords)


_EITHER_WAY = {"min", "max", "minimum", "maximum", "hypot", "dist", "isclose", "clip"}


def _other_calls(
    func: ast.expr, args: list[ast.expr], keywords: list[ast.keyword]
) -> Iterator[str]:
    name = func.attr if isinstance(func, ast.Attribute) else getattr(func, "id", "")
    starred = any(isinstance(each, ast.Starred) for each in args[:2])
    if len(args) > 1 and not starred and name not in _EITHER_WAY:
        yield ast.unparse(ast.Call(func, [args[1], args[0], *args[2:]], keywords))
    if isinstance(func, ast.Name) and func.id in _FUNCTIONS:
        yield ast.unparse(ast.Call(ast.Name(_FUNCTIONS[func.id]), args, keywords))
    if isinstance(func, ast.Attribute) and func.attr in _FUNCTIONS:
        other = ast.Attribute(func.value, _FUNCTIONS[func.attr])
        yield ast.unparse(ast.Call(other, args, keywords))


def _is_text(*sides: ast.expr) -> bool:
    """Does one side hold a string: a path, a format, a text put together?"""
    return any(
        isinstance(side, ast.JoinedStr)
        or (isinstance(side, ast.Constant) and isinstance(side.value, str))
        for side in sides
    )
