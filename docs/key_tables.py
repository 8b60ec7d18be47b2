"""Keys of a file as pages of docs/reference show them: value, default and meaning of each, as their dataclass says."""

import ast
import inspect
import re
import textwrap
from dataclasses import MISSING, Field, is_dataclass
from itertools import pairwise
from typing import Any, get_type_hints

from haptic_fieldbus.documents import schema_of
from haptic_fieldbus.documents.expected import Expectation
from haptic_fieldbus.drive.rig_units import measured_by, units_of
from haptic_fieldbus.numerals import exactly


def meanings(schema: type) -> dict[str, str]:
    """Return the text below each field of a dataclass, as its source has it, and of those that it inherits."""
    found: dict[str, str] = {}
    for owner in reversed([each for each in schema.__mro__ if is_dataclass(each)]):
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(owner))).body
        statements = body.body if isinstance(body, ast.ClassDef) else []
        for statement, text in pairwise(statements):
            match statement, text:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(meaning))):
                    found[name] = of_a_file(meaning)
    return found


def of_a_file(text: str) -> str:
    """Return the text for a value of a file: a file has no None, it omits the key."""
    text = re.sub(r"(^|\. )None:", r"\1If omitted:", " ".join(text.split()))
    return text.replace("None:", "if omitted:")


def value(schema: type, name: str) -> str:
    """Return the permitted values of a key, in the words of its error messages, with the unit."""
    measured = measured_by(get_type_hints(schema, include_extras=True)[name])
    words = Expectation(schema_of(schema)).describe((name,), {})
    return words if measured is None else f"{words}, in {units_of(measured)}"


def default(field: "Field[Any]") -> str:
    if field.default is MISSING:
        return "required" if field.default_factory is MISSING else "none"
    if isinstance(field.default, bool):
        return f"`{str(field.default).lower()}`"
    if isinstance(field.default, float | int):
        return exactly(field.default)
    return "none" if field.default in (None, ()) else f'`"{field.default}"`'
