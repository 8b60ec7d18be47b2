"""Small changes to a module: operators swapped, numbers changed, conditions negated, statements removed.

Constants that have a name are also changed by a factor: four times as large and a quarter, and by a fifth where a
decision states the value.

Texts are left alone (docstrings, messages, f-strings, and all that is raised, except that raising itself is removed),
and so are annotations and decorators. A value that is returned is changed only to one that its type allows.
"""

import ast
import builtins
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

SWAPS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.BitXor: ast.BitOr,
    ast.LShift: ast.RShift,
    ast.RShift: ast.LShift,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
FACTORS = (("constant × 4", "(4 * ({}))"), ("constant ÷ 4", "(type({0})(({0}) / 4))"))
FIFTHS = (("constant × 1.2", "(type({0})(1.2 * ({0})))"), ("constant × 0.8", "(type({0})(0.8 * ({0})))"))
STATED = {
    "haptic_fieldbus/planning/limits.py": (
        "AGE_SHARE",
        "SOON_SHARE",
        "PULSE_SHARE",
        "ENERGY_LIMIT",
        "START_SHARE",
        "LARGEST_MISSING_SHARE",
        "GAP_SHARE",
    ),
    "haptic_fieldbus/planning/sign_probe.py": ("GROWTH",),
    "haptic_fieldbus/cycle/gaps.py": ("WINDOW",),
}
"""Constants whose value a decision states as a bound: for these a fifth more or less matters too."""
LEFT_ALONE = {"annotation", "returns", "decorator_list"}
"""Fields of nodes in which nothing is changed."""


@dataclass(frozen=True)
class Mutant:
    """One change to one file: the bytes from `start` to `end` become `text`."""

    file: str
    line: int
    kind: str
    start: int
    end: int
    text: str
    first: int
    last: int
    """Lines of the statement: tests that reach one of them reach the mutant."""
    at_import: bool
    """Whether the line is run as the module is imported, and not by a call."""
    constant: str = ""
    """Name of the constant that is changed by a factor."""

    @property
    def room(self) -> str:
        return self.file.split("/")[1]

    def apply(self, source: bytes) -> bytes:
        return source[: self.start] + self.text.encode() + source[self.end :]


def chosen(project: Path, rooms: tuple[str, ...], count: int, seed: int) -> list[Mutant]:
    """So many mutants, evenly spread over all lines of the rooms that can be changed."""
    random = Random(seed)
    lines: dict[tuple[str, int], list[Mutant]] = {}
    for room in rooms:
        for path in sorted((project / "haptic_fieldbus" / room).glob("**/*.py")):
            for mutant in mutants(path.relative_to(project).as_posix(), path.read_bytes()):
                lines.setdefault((mutant.file, mutant.line), []).append(mutant)
    places, offset = list(lines), random.random()
    return [random.choice(lines[places[int((each + offset) * len(places) / count)]]) for each in range(count)]


def chosen_constants(project: Path, rooms: tuple[str, ...], count: int, seed: int) -> list[Mutant]:
    """So many changes of named constants by a factor; all of them, when there are no more."""
    every = [
        mutant
        for room in rooms
        for path in sorted((project / "haptic_fieldbus" / room).glob("**/*.py"))
        for mutant in scaled(path.relative_to(project).as_posix(), path.read_bytes())
    ]
    return Random(seed).sample(every, min(count, len(every)))


def scaled(file: str, source: bytes) -> Iterator[Mutant]:
    """Every quantity of one module by each factor: named constants, and floating-point numbers inside of functions.

    Bit masks, indices and addresses are no quantities; zero stays zero.
    """
    starts = _starts(source)
    for node, statement, function in _nodes(ast.parse(source), None, None):
        for value, factors, name in _quantities(file, source, node, function):
            for kind, form in factors:
                change = kind, value, form.format(ast.unparse(value))
                yield _mutant(file, starts, change, statement, at_import=function is None, constant=name)


def _quantities(
    file: str, source: bytes, node: ast.AST, function: ast.FunctionDef | None
) -> Iterator[tuple[ast.expr, tuple[tuple[str, str], ...], str]]:
    """Parts of a node that are a quantity: the value, the factors to try, and its name if it has one."""
    match node:
        case ast.Assign(targets=[ast.Name(id=name)], value=value) if name.isupper() and _is_quantity(source, value):
            yield value, FACTORS + (FIFTHS if name in STATED.get(file, ()) else ()), name
        case ast.Constant(value=float() as number) if number and function is not None:
            yield node, FACTORS, ""


def _is_quantity(source: bytes, value: ast.expr) -> bool:
    """Whether a value is made of numbers alone, none of them written in another base than ten."""
    parts = [part for part in ast.walk(value) if not isinstance(part, (ast.operator, ast.unaryop))]
    plain = all(isinstance(part, (ast.Constant, ast.BinOp, ast.UnaryOp)) for part in parts)
    numbers = [part.value for part in parts if isinstance(part, ast.Constant)]
    written = ast.get_source_segment(source.decode(), value) or ""
    is_number = all(isinstance(number, (int, float)) and not isinstance(number, bool) for number in numbers)
    return plain and is_number and any(numbers) and "0x" not in written and "<<" not in written


def _starts(source: bytes) -> list[int]:
    """At which octet each line begins."""
    starts = [0]
    for line in source.split(b"\n"):
        starts.append(starts[-1] + len(line) + 1)
    return starts


def _mutant(
    file: str,
    starts: list[int],
    change: tuple[str, ast.expr | ast.stmt, str],
    statement: ast.stmt,
    *,
    at_import: bool,
    constant: str = "",
) -> Mutant:
    """The mutant of a change: its kind, what is replaced in this statement, and by what text."""
    kind, target, text = change
    first, last = _lines(statement, target)
    return Mutant(
        file=file,
        line=target.lineno,
        kind=kind,
        start=starts[target.lineno - 1] + target.col_offset,
        end=starts[(target.end_lineno or 0) - 1] + (target.end_col_offset or 0),
        text=text,
        first=first,
        last=last,
        at_import=at_import,
        constant=constant,
    )


def mutants(file: str, source: bytes) -> Iterator[Mutant]:
    """Every change that is known of one module."""
    starts = _starts(source)
    for node, statement, function in _nodes(ast.parse(source), None, None):
        for change in [*_changes(node), *_returned(node, function)]:
            yield _mutant(file, starts, change, statement, at_import=function is None)


def _nodes(
    node: ast.AST, statement: ast.stmt | None, function: ast.FunctionDef | None
) -> Iterator[tuple[ast.AST, ast.stmt, ast.FunctionDef | None]]:
    """Nodes that may be changed, with the statement of each and the function whose call runs it."""
    if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
        return
    statement = node if isinstance(node, ast.stmt) else statement
    if statement is not None:
        yield node, statement, function
    if isinstance(node, ast.Raise):
        return
    for name, value in ast.iter_fields(node):
        inside = node if isinstance(node, ast.FunctionDef) and name == "body" else function
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and name not in LEFT_ALONE:
                yield from _nodes(child, statement, inside)


def _changes(node: ast.AST) -> Iterator[tuple[str, ast.expr | ast.stmt, str]]:
    """Kinds of change that a node allows: the kind, what is replaced, and by what text."""
    match node:
        case ast.Compare():
            for place, operator in enumerate(node.ops):
                changed = copy.deepcopy(node)
                changed.ops[place] = _swapped(operator)
                yield "comparison", node, f"({ast.unparse(changed)})"
        case ast.BinOp() if type(node.op) in SWAPS and not _is_union(node):
            changed_operation = ast.BinOp(node.left, _swapped(node.op), node.right)
            yield "arithmetic", node, f"({ast.unparse(changed_operation)})"
        case ast.BoolOp():
            yield "and, or", node, f"({ast.unparse(ast.BoolOp(_swapped(node.op), node.values))})"
        case ast.UnaryOp(op=ast.Not() | ast.USub()):
            yield "sign or not", node, f"({ast.unparse(node.operand)})"
        case ast.Constant(value=bool()):
            yield "constant", node, str(not node.value)
        case ast.Constant(value=int() | float() as number):
            yield "constant", node, f"{number + 1!r}"
        case ast.If() | ast.While() | ast.IfExp():
            yield "condition", node.test, f"(not ({ast.unparse(node.test)}))"
        case ast.comprehension():
            for condition in node.ifs:
                yield "condition", condition, f"(not ({ast.unparse(condition)}))"
        case ast.Raise() | ast.Delete() | ast.Break() | ast.Continue() | ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield "statement removed", node, "pass"
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield "statement removed", node, "pass"


def _returned(node: ast.AST, function: ast.FunctionDef | None) -> Iterator[tuple[str, ast.stmt, str]]:
    """Changes of what is returned by a function of two outcomes."""
    if (
        isinstance(node, ast.Return)
        and node.value is not None
        and function is not None
        and function.returns is not None
    ):
        returns, value = ast.unparse(function.returns), ast.unparse(node.value)
        if returns == "bool":
            yield "return value", node, f"return not ({value})"
        elif returns.endswith("| None") and value != "None":
            yield "return value", node, "return None"


def _swapped(operator: ast.AST) -> Any:
    return SWAPS[type(operator)]()


def _is_union(node: ast.BinOp) -> bool:
    """Whether it is a type, which nothing can be instead."""
    sides = {ast.unparse(side) for side in (node.left, node.right)}
    return isinstance(node.op, ast.BitOr) and any(side[:1].isupper() or side in dir(builtins) for side in sides)


def _lines(statement: ast.stmt, target: ast.expr | ast.stmt) -> tuple[int, int]:
    """Of a statement that holds others its first lines only, and those of what is changed."""
    body = getattr(statement, "body", None)
    last = max(body[0].lineno - 1, statement.lineno) if isinstance(body, list) else statement.end_lineno or 0
    return min(statement.lineno, target.lineno), max(last, target.end_lineno or 0)
