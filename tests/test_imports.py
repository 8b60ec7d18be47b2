"""No module of the package imports itself, by whatever way round."""

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "haptic_fieldbus"
MODULE = re.compile(r"haptic_fieldbus(?:\.\w+)+")


def imports() -> dict[str, set[str]]:
    """What each module imports: at its top, in a function, or for its types alone."""
    graph = grimp.build_graph("haptic_fieldbus", exclude_type_checking_imports=False, cache_dir=None)
    return {module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules}


def loaded_by_name(modules: set[str]) -> Iterator[tuple[str, str]]:
    """Who loads a module by its name in a table, such as `scenes.registry`, and which."""
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        if "import_module(" not in text:
            continue
        own = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                name = node.value.partition(":")[0]
                if MODULE.fullmatch(name) and name in modules:
                    yield own, name


def test_no_module_imports_itself_by_any_way_round() -> None:
    found = imports()
    for module, name in loaded_by_name(set(found)):
        found[module].add(name)
    try:
        TopologicalSorter(found).prepare()
    except CycleError as cycle:
        pytest.fail(" → ".join(reversed(cycle.args[1])))
