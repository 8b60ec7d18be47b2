"""Oracles of report cases share no code with what they judge: each imports numpy, `math` and other oracles alone."""

import ast
from pathlib import Path

import pytest

from haptic_fieldbus.study import oracles

ROOM = Path(oracles.__file__).parent
NUMBERS = {"math", "numpy", "numpy.typing", "decimal"}
"""What an oracle computes with; `decimal` has more digits than `math`."""
WORDS = {"collections.abc", "dataclasses", "functools", "typing"}
"""What computes nothing."""


def imported(text: str) -> set[str]:
    """Modules that are imported anywhere, also inside of functions."""
    nodes = list(ast.walk(ast.parse(text)))
    plain = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    return plain | {f"{'.' * node.level}{node.module}" for node in nodes if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize("path", sorted(ROOM.glob("**/*.py")), ids=lambda path: path.stem)
def test_an_oracle_imports_numpy_and_math_and_other_oracles_alone(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    others = {each for each in imported(text) if not each.startswith(f"{oracles.__name__}.")}
    assert others <= NUMBERS | WORDS
    assert "__import__" not in text
    assert "importlib" not in text


def borrowed(text: str) -> dict[str, set[str]]:
    """What the bodies of functions named `…_by_hand` use of the package, other than oracles."""
    tree = ast.parse(text)
    foreign = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("haptic_fieldbus.")
        for alias in node.names
        if not f"{node.module}.{alias.name}.".startswith(f"{oracles.__name__}.")
    }
    by_hand = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.endswith("_by_hand")]
    return {
        function.name: {
            each.id for line in function.body for each in ast.walk(line) if isinstance(each, ast.Name)
        } & foreign
        for function in by_hand
    }  # fmt: skip


def test_what_a_case_computes_by_hand_uses_oracles_alone() -> None:
    found = [borrowed(path.read_text(encoding="utf-8")) for path in ROOM.with_name("cases").glob("*.py")]
    assert sum(map(len, found)) > 5
    assert [each for functions in found for each in functions.items() if each[1]] == []


def test_what_is_borrowed_is_seen() -> None:
    text = "from haptic_fieldbus.margins import a, b\nfrom haptic_fieldbus.study.oracles import c\n"
    assert borrowed(text + "def _by_hand(x: b):\n    return a(x) + c(x)\n") == {"_by_hand": {"a"}}


def test_every_import_is_seen() -> None:
    text = "import a.b\nfrom .c import d\ndef f():\n    from e import g\n"
    assert imported(text) == {"a.b", ".c", "e"}
