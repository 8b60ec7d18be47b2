"""Counts of `python -m tests.shape`, on a package of which each line is known."""

from pathlib import Path

from tests.shape import KINDS, importers, lines_by_kind, shape
from tests.source import PACKAGE, reads_the_source

TEXT = '''"""One sentence."""

import ast

# A comment.
SIZE = 3  # code
"""Of an attribute."""


def _helper() -> int:
    """Return it."""
    return SIZE


print(_helper(), ast)
'''


def test_each_line_is_of_one_kind(tmp_path: Path) -> None:
    path = tmp_path / "one.py"
    path.write_text(TEXT)
    kinds = [*lines_by_kind(path).values()]
    assert {kind: kinds.count(kind) for kind in kinds} == {"docstring": 3, "import": 1, "comment": 1, "code": 4}


def test_a_package_is_counted(tmp_path: Path) -> None:
    package = tmp_path / "a_package"
    package.mkdir()
    (package / "__init__.py").write_text("")
    (package / "one.py").write_text(TEXT)
    (package / "two.py").write_text("from a_package.one import SIZE\n" + "print(SIZE)\n" * 700)
    found = shape(package)
    assert (found["files"], found["lines"]) == (3, 716)
    assert (found["files above 600 lines"], found["files of 40 code lines or fewer"]) == (1, 1)
    assert (found["modules with one importer"], found["private functions called once"]) == (1, 1)
    assert importers(package) == {"a_package.one": 1}


@reads_the_source
def test_the_package_keeps_to_decision_0050() -> None:
    found = shape()
    # Five are left for what a person adds: an element, an integrator or an estimator is a file of its own.
    assert found["files"] <= 385
    assert found["files above 600 lines"] == 0
    assert 120 <= found["median lines of a file"] <= 250
    assert found["files of 40 code lines or fewer"] <= 40
    assert all((PACKAGE / kind).is_dir() for kind in KINDS)
