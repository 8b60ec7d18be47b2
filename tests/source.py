"""The modules of the package as syntax trees, parsed once a process: several tests read all of them."""

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "haptic_fieldbus"

reads_the_source = pytest.mark.xdist_group("source")
"""Mark of a test that reads the whole package; tests with it run in one process, which parses once for all."""


@cache
def tree_of(path: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def nodes_of(path: Path) -> tuple[ast.AST, ...]:
    """Return all nodes of a file in the order of `ast.walk`."""
    return tuple(ast.walk(tree_of(path)))


def modules() -> list[Path]:
    """Return the files of the package, sorted."""
    return sorted(PACKAGE.rglob("*.py"))
