"""Counts what says whether the package is few full files or many small ones: `python -m tests.shape [folder]`.

A line is one of five: blank, comment, docstring (those of attributes too), import, or code. A kind that is one file
each (an element, an integrator, an estimator, a drive mode) and `__init__.py` are not counted among the small files.
"""

import ast
import statistics
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from tests.source import PACKAGE, nodes_of

KINDS = ("scenes", "numerics/integrators", "numerics/estimators", "sim/drive/modes")
"""Folders in which each kind is a file of its own."""
SMALL, LARGE = 40, 600
"""Code lines of a small file, and lines of one that is too large."""


def lines_of(node: ast.AST) -> range:
    """Return the line numbers that a node takes."""
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)  # type: ignore[attr-defined]


def is_text(node: ast.AST) -> bool:
    """Return whether a statement is a text alone, which documents what stands before it."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def lines_by_kind(path: Path) -> dict[int, str]:
    """Return what each line of a file is that is not blank."""
    lines = {number: line.strip() for number, line in enumerate(path.read_text().splitlines(), 1) if line.strip()}
    kinds = {number: "comment" if line.startswith("#") else "code" for number, line in lines.items()}
    # Texts come before what is made of them: `ast.walk` goes from a statement to its parts.
    for node in reversed(nodes_of(path)):
        kind = kind_of(node)
        if kind:
            kinds.update((number, kind) for number in lines_of(node) if number in kinds)
    return kinds


def kind_of(node: ast.AST) -> str:
    """Return what the lines of a node are where it decides that, else nothing; a text with a # in it is no comment."""
    if is_text(node):
        return "docstring"
    if isinstance(node, ast.Import | ast.ImportFrom):
        return "import"
    return "code" if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""


def called_once(paths: Iterable[Path]) -> int:
    """Return how many private functions and methods are named once beside their definition."""
    named: Counter[str] = Counter()
    defined: Counter[str] = Counter()
    for node in (inner for path in paths for inner in nodes_of(path)):
        if isinstance(node, ast.FunctionDef) and node.name.startswith("_") and not node.name.startswith("__"):
            defined[node.name] += 1
        elif isinstance(node, ast.Attribute | ast.Name):
            named[node.attr if isinstance(node, ast.Attribute) else node.id] += 1
    return sum(count for name, count in defined.items() if named[name] == count)


def importers(package: Path) -> Counter[str]:
    """Return how many modules of the package import each other one."""
    found: Counter[str] = Counter()
    for path in package.rglob("*.py"):
        names = set()
        for node in nodes_of(path):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(package.name):
                home = package.joinpath(*(node.module or "").split(".")[1:])
                modules = [each.name for each in node.names if (home / f"{each.name}.py").exists()]
                names |= {f"{node.module}.{each}" for each in modules} or {node.module or ""}
        found.update(names)
    return found


def shape(package: Path = PACKAGE) -> dict[str, float]:
    """Return the counts by what they count."""
    paths = sorted(package.rglob("*.py"))
    kinds = {path: Counter(lines_by_kind(path).values()) for path in paths}
    lengths = {path: len(path.read_text().splitlines()) for path in paths}
    chapters = [path for path in paths if path.name != "__init__.py"]
    parts = [package / each for each in KINDS]
    small = [path for path in chapters if kinds[path]["code"] <= SMALL and path.parent not in parts]
    every = sum(kinds.values(), Counter())
    filled = sum(every.values())
    return {
        "files": len(paths),
        "lines": sum(lengths.values()),
        "median lines of a file": statistics.median(lengths[path] for path in chapters),
        f"files above {LARGE} lines": sum(length > LARGE for length in lengths.values()),
        f"files of {SMALL} code lines or fewer": len(small),
        "modules with one importer": sum(count == 1 for count in importers(package).values()),
        "private functions called once": called_once(paths),
        "code lines": every["code"],
        "docstring and comment lines": every["docstring"] + every["comment"],
        "share of them, %": round(100.0 * (every["docstring"] + every["comment"]) / filled, 1),
        "import lines": every["import"],
        "share of imports, %": round(100.0 * every["import"] / sum(lengths.values()), 1),
    }


def main() -> None:
    """Print the counts of a package, of this one unless told."""
    package = Path(sys.argv[1]).resolve() if sys.argv[1:] else PACKAGE
    for what, count in shape(package).items():
        print(f"{what:<36}{count:>10,}")


if __name__ == "__main__":
    main()
