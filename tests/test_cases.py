"""The decorator that runs many cases as one test."""

import inspect

import pytest

from tests.cases import every


def test_each_case_is_run_with_the_fixtures_of_the_test() -> None:
    seen: list[tuple[str, int, str]] = []

    @every(("left", "right"), [(1, "a"), pytest.param(2, "b", id="second")])
    def subject(folder: str, left: int, right: str) -> None:
        seen.append((folder, left, right))

    assert list(inspect.signature(subject).parameters) == ["folder"]
    subject(folder="here")
    assert seen == [("here", 1, "a"), ("here", 2, "b")]


def test_stacked_decorators_run_the_product() -> None:
    seen: list[tuple[int, str]] = []

    @every("number", [1, 2])
    @every("letter", "ab")
    def subject(number: int, letter: str) -> None:
        seen.append((number, letter))

    subject()
    assert seen == [(1, "a"), (1, "b"), (2, "a"), (2, "b")]


@every("wrong", [(3,), (1, 3)])
def test_every_case_that_fails_is_named_and_the_others_are_run(wrong: tuple[int, ...]) -> None:
    seen: list[int] = []

    @every("number", [1, 2, 3], ids=lambda number: f"number {number}")
    def subject(number: int) -> None:
        seen.append(number)
        assert number not in wrong

    with pytest.raises((AssertionError, ExceptionGroup)) as caught:
        subject()
    failures = caught.value.exceptions if isinstance(caught.value, ExceptionGroup) else (caught.value,)
    assert [error.__notes__[-1] for error in failures] == [f"case: number {number}" for number in wrong]
    assert seen == [1, 2, 3]


def test_no_case_is_refused() -> None:
    with pytest.raises(ValueError, match="no case of name"):
        every("name", [])


def test_a_case_with_a_mark_is_refused() -> None:
    with pytest.raises(ValueError, match="no marks of its own"):
        every("name", [pytest.param(1, marks=pytest.mark.thorough("slow"))])
