"""Public names of `haptic_fieldbus` are written down, exist, and are the ones that type checkers see."""

import ast
import inspect
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus import errors
from tests.cases import every

SOURCE = ast.parse(Path(haptic_fieldbus.__file__).read_text(encoding="utf-8"))
FOR_TYPES = next(node for node in SOURCE.body if isinstance(node, ast.If))
TYPED = {alias.name: node.module for node in FOR_TYPES.body if isinstance(node, ast.ImportFrom) for alias in node.names}
"""The module of each name as type checkers read it."""


@every("name", haptic_fieldbus.__all__)
def test_every_public_name_is_the_one_that_type_checkers_see(name: str) -> None:
    module = TYPED[name]
    assert module is not None
    assert getattr(haptic_fieldbus, name) is getattr(sys.modules[module], name)


def test_type_checkers_see_no_other_names() -> None:
    assert set(TYPED) == set(haptic_fieldbus.__all__)
    assert len(set(haptic_fieldbus.__all__)) == len(haptic_fieldbus.__all__)


def test_dir_shows_the_public_names_and_no_others() -> None:
    assert set(dir(haptic_fieldbus)) == set(haptic_fieldbus.__all__)


def test_all_errors_are_public() -> None:
    classes = inspect.getmembers(errors, inspect.isclass)
    raised = {name for name, each in classes if issubclass(each, errors.HapticFieldbusError)}
    assert raised == {name for name in haptic_fieldbus.__all__ if name.endswith("Error")}


def test_a_star_import_brings_them_and_an_unknown_name_is_told() -> None:
    scope: dict[str, object] = {}
    exec("from haptic_fieldbus import *", scope)
    assert scope.keys() - {"__builtins__"} == set(haptic_fieldbus.__all__)
    unknown = "walk"
    with pytest.raises(AttributeError, match="no attribute 'walk'"):
        getattr(haptic_fieldbus, unknown)


def test_importing_the_package_imports_nothing_of_it_and_nothing_from_elsewhere() -> None:
    program = (
        "import sys; before = set(sys.modules); import haptic_fieldbus; dir(haptic_fieldbus)\n"
        "print(*sorted({name for name in sys.modules.keys() - before"
        " if name.partition('.')[0] not in sys.stdlib_module_names}))"
    )
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert shown.stdout.split() == ["haptic_fieldbus"]


def listing_modules() -> list[str]:
    """Modules of the package that say what they offer by `__all__`."""
    root = Path(haptic_fieldbus.__file__).parent
    files = [path for path in sorted(root.rglob("*.py")) if "\n__all__ = " in path.read_text(encoding="utf-8")]
    parts = [path.relative_to(root.parent).with_suffix("").parts for path in files]
    return [".".join(part for part in module if part != "__init__") for module in parts]


@pytest.mark.parametrize("module", listing_modules())
def test_what_a_module_lists_it_has(module: str) -> None:
    offering = import_module(module)
    assert [name for name in offering.__all__ if not hasattr(offering, name)] == []
