"""Each planted bug, alone, fails the cases of the report and the tests that the list names."""

import json
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.study.cases import CASES
from tests.checkouts import PROJECT, Checkout, copied
from tests.study.planted import PLANTED, Planted

BUGS = pytest.mark.parametrize("name", PLANTED)
BROKEN = ("ImportError", "NameError", "SyntaxError", "ERROR: not found", "INTERNALERROR")
JUDGED = """
import json, sys
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.page.stability import run_case
found = {name: run_case(CASES[name], True)[0] for name in sys.argv[1:]}
print(json.dumps({name: (result.passed, result.oracle, result.measured) for name, result in found.items()}))
"""


@pytest.fixture(scope="module")
def checkout(tmp_path_factory: pytest.TempPathFactory) -> Checkout:
    return copied(tmp_path_factory.mktemp("planted") / "copy")


def judged(checkout: Checkout, *cases: str) -> dict[str, tuple[bool, str, str]]:
    """Result of each case there: whether it passed, by which oracle, and what it measured."""
    done = checkout.call(sys.executable, "-c", JUDGED, *cases)
    assert done.returncode == 0, done.stderr
    found: dict[str, tuple[bool, str, str]] = json.loads(done.stdout)
    return found


def all_of(bugs: dict[str, Planted], part: str) -> list[str]:
    return sorted({name for bug in bugs.values() for name in getattr(bug, part)})


@BUGS
def test_a_bug_has_its_place_and_what_notices_it(name: str) -> None:
    bug = PLANTED[name]
    bug.changed((PROJECT / bug.file).read_text(encoding="utf-8"))
    assert bug.cases
    assert bug.tests
    assert set(bug.cases) <= set(CASES)
    for test in bug.tests:
        file, _, function = test.partition("::")
        assert f"def {function.rpartition('::')[2]}(" in (PROJECT / file).read_text(encoding="utf-8")


@pytest.mark.thorough("two processes for each bug")
@BUGS
def test_a_bug_fails_its_cases_and_its_tests(name: str, checkout: Checkout) -> None:
    bug = PLANTED[name]
    whole = bug.apply(checkout.folder)
    try:
        found = judged(checkout, *bug.cases)
        tried = {test: checkout.test("-x", test) for test in bug.tests}
    finally:
        Path(checkout.folder / bug.file).write_text(whole, encoding="utf-8")
    for case, (passed, oracle, measured) in found.items():
        assert not passed, f"{case} passes with the bug: {measured}"
        assert oracle != "none", f"{case} raises instead of judging: {measured}"
    for test, done in tried.items():
        said = done.stdout + done.stderr
        assert "\nFAILED " in said, f"{test} passes with the bug: {said}"
        assert not any(sign in said for sign in BROKEN), said


@pytest.mark.thorough("all these cases and tests, without any bug")
def test_without_a_bug_all_of_them_pass(checkout: Checkout) -> None:
    found = judged(checkout, *all_of(PLANTED, "cases"))
    assert [case for case, (passed, *_) in found.items() if not passed] == []
    done = checkout.test(*all_of(PLANTED, "tests"))
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_place_that_is_not_there_once_is_told() -> None:
    bug = PLANTED["coupled spread doubled"]
    for text in ("", 2 * bug.text):
        with pytest.raises(ValueError, match="has its place"):
            bug.changed(text)
