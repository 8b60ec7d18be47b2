"""Oracles of report cases share no code with what they judge: each imports numpy, `math` and other oracles alone."""

import ast
from pathlib import Path

import pytest

import haptic_fieldbus.study.cases.oracles as oracles

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


def test_every_import_is_seen() -> None:
    text = "import a.b\nfrom .c import d\ndef f():\n    from e import g\n"
    assert imported(text) == {"a.b", ".c", "e"}
