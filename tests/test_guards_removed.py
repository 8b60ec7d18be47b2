"""Each guard removed in turn makes a test fail that passes with it."""

from pathlib import Path

import pytest

from tests.cases import every
from tests.checkouts import PROJECT, Checkout, copied
from tests.guards import GUARDS

FAILED = ("\nFAILED ", "ERROR at setup of", "running/ending.py:")
BROKEN = ("ImportError", "NameError", "SyntaxError", "ERROR: not found")
FEW = ("speed",)


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Checkout:
    return copied(tmp_path_factory.mktemp("guards") / "copy")


@every("name", GUARDS)
def test_a_guard_stands_where_the_list_says(name: str) -> None:
    guard = GUARDS[name]
    assert (PROJECT / guard.file).read_text(encoding="utf-8").count(guard.text) == 1
    for test in guard.tests:
        file, _, function = test.partition("::")
        assert f"def {function.rpartition('::')[2]}(" in (PROJECT / file).read_text(encoding="utf-8")


@pytest.mark.thorough("starts a process for each guard", quick=FEW)
@pytest.mark.parametrize("name", GUARDS)
def test_without_a_guard_its_tests_fail(name: str, checkout: Checkout) -> None:
    guard = GUARDS[name]
    path = checkout.folder / guard.file
    whole = path.read_text(encoding="utf-8")
    path.write_text(whole.replace(guard.text, guard.instead), encoding="utf-8")
    try:
        tried = checkout.test("-x", *guard.tests)
    finally:
        path.write_text(whole, encoding="utf-8")
    said = tried.stdout + tried.stderr
    assert any(sign in said for sign in FAILED), said
    assert not any(sign in said for sign in BROKEN), said


def test_the_copy_is_what_it_is_a_copy_of(checkout: Checkout) -> None:
    for guard in GUARDS.values():
        assert Path(checkout.folder / guard.file).read_bytes() == (PROJECT / guard.file).read_bytes()
