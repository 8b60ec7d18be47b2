"""Numbers for people: what a function makes of them, and that no text has another style."""

import math
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.numerals import (
    DIGITS,
    GIVEN_DIGITS,
    MORE,
    PLAIN_BELOW,
    PLAIN_FROM,
    OutputRow,
    exactly,
    in_unit,
    lines_of,
    object_of,
    percent,
    rounded,
    rounded_down,
    rounded_limit,
    shortened,
)
from tests.cases import every
from tests.number_style import strange_numbers

PROJECT = Path(__file__).resolve().parents[1]
GOLDEN_TEXTS = sorted((PROJECT / "tests" / "golden").rglob("*.txt"))
DOCUMENTS = sorted(
    path for path in PROJECT.rglob("*.md") if not any(part.startswith(".") for part in path.relative_to(PROJECT).parts)
)

FINITE = st.floats(-1e300, 1e300)
PLAIN = st.floats(PLAIN_FROM, 0.99 * PLAIN_BELOW)
DIGIT_COUNTS = st.integers(1, 15)


@given(FINITE, DIGIT_COUNTS)
def test_a_number_is_read_back_within_its_digits(value: float, digits: int) -> None:
    assert float(rounded(value, digits)) == pytest.approx(value, rel=0.501 * 10.0 ** (1 - digits), abs=5e-324)


@given(FINITE)
def test_what_somebody_gave_is_read_back(value: float) -> None:
    given_back = float(f"{value:.{GIVEN_DIGITS}g}")
    assert float(exactly(given_back)) == given_back


@given(PLAIN)
def test_two_digits_are_never_above_and_within_a_tenth(value: float) -> None:
    found = rounded_down(value)
    assert 0.9 * value <= found <= value * (1.0 + 1e-12)
    assert len(f"{found:e}".partition("e")[0].rstrip("0").replace(".", "")) <= 2
    assert rounded_down(found) == found


@given(FINITE, FINITE, DIGIT_COUNTS)
def test_the_larger_of_two_numbers_never_reads_as_the_smaller(one: float, other: float, digits: int) -> None:
    low, high = sorted((one, other))
    assert float(rounded(low, digits)) <= float(rounded(high, digits))


@given(PLAIN, DIGIT_COUNTS, st.sampled_from((-1, 1)))
def test_in_the_plain_range_there_are_digits_and_a_point(value: float, digits: int, sign: int) -> None:
    text = rounded(sign * value, digits)
    assert re.fullmatch(r"-?\d+(\.\d*[1-9])?", text) or abs(float(text)) >= PLAIN_BELOW


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"), (-0.0, "0"), (3370.4, "3370"), (-0.0071, "-0.0071"), (33704.0, "33700"), (1690.0, "1690"),
        (999_999.0, "1e6"), (999_499.0, "999000"), (1e-4, "0.0001"), (0.00009999, "0.0001"), (1.234e-5, "1.23e-5"),
        (1.2e-11, "1.2e-11"), (-4.0e7, "-4e7"), (math.inf, "inf"), (-math.inf, "-inf"), (math.nan, "nan"),
    ],
)  # fmt: skip
def test_a_computed_number_has_three_digits(value: float, text: str) -> None:
    assert DIGITS == 3
    assert rounded(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(1000.0, "1000"), (0.1 + 0.2, "0.3"), (1e3 * 0.0003, "0.3"), (1234.5678, "1234.5678"), (5, "5")]
)
def test_a_given_number_has_the_digits_that_were_given(value: float, text: str) -> None:
    assert exactly(value) == text


def test_a_limit_is_told_finer_than_what_was_measured() -> None:
    assert (rounded_limit(3368.4), rounded(3368.4)) == ("3368", "3370")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0, "N", "0 N"), (0.412, "N", "0.412 N"), (3.04e-4, "N", "0.304 mN"), (-0.0071, "N", "-7.1 mN"),
        (12.0, "N", "12 N"),
        (3.07e-6, "m", "3.07 µm"), (1.22e-5, "m", "12.2 µm"), (2.5e-9, "J", "2.5 nJ"), (4e-5, "kg·m²", "4e-5 kg·m²"),
    ],
)  # fmt: skip
def test_a_small_quantity_has_a_prefix(value: float, unit: str, text: str) -> None:
    assert in_unit(value, unit) == text


@pytest.mark.parametrize(
    ("share", "text"), [(0.272, "27 %"), (0.00412, "0.41 %"), (1.534, "153 %"), (0.0, "0 %"), (math.nan, "nan %")]
)
def test_a_share_is_told_in_percent(share: float, text: str) -> None:
    assert percent(share) == text


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("1.69e+03 N/m, 4e-05 kg", ["9e+03", "4e-05"]), ("1 492 N/m", ["1 492"]), ("10,000 periods", ["10,000"]),
        ("\u22127 mN", ["\u22127"]), ("3370 N/m, 4e-5, 1e6, -7 mN, 1, 255, node 1, 400 Hz", []), ("h²·φ − 1", []),
    ],
)  # fmt: skip
def test_other_styles_are_found(text: str, found: list[str]) -> None:
    assert strange_numbers(text) == found


@every("path", [*GOLDEN_TEXTS, *DOCUMENTS], ids=lambda path: str(path.relative_to(PROJECT)))
def test_no_text_has_numbers_in_another_style(path: Path) -> None:
    assert strange_numbers(path.read_text(encoding="utf-8"), is_prose=path in DOCUMENTS) == []


ROWS = (
    OutputRow("scene", ["wall"], "scene", "wall"),
    OutputRow(key="rate_hz", value=1000.0),
    OutputRow("result", ["10 periods"], "cycles", 10),
    OutputRow("result", ["no trip", "10 mm deep"]),
    OutputRow("warning"),
    OutputRow("verdict", ["felt"]),
)


def test_a_text_has_the_lines_of_the_rows_that_have_words() -> None:
    shown = [
        ("scene", "wall"),
        ("result", "10 periods"),
        ("result", "no trip"),
        ("", "10 mm deep"),
        ("verdict", "felt"),
    ]
    assert lines_of(ROWS) == shown


def test_a_label_may_be_told_once() -> None:
    assert [label for label, _ in lines_of(ROWS, once=True)] == ["scene", "result", "", "", "verdict"]


def test_an_object_has_the_rows_with_a_key_the_ordered_ones_first() -> None:
    assert list(object_of(ROWS, ("cycles", "unknown")).items()) == [
        ("cycles", 10), ("scene", "wall"), ("rate_hz", 1000.0)
    ]  # fmt: skip


def test_lines_are_made_when_they_are_drawn() -> None:
    refused = (str(1 // number) for number in (0,))
    assert object_of([OutputRow("limits", refused, "limits", [])]) == {"limits": []}


WORDS = st.lists(st.sampled_from(["wall", "600 N/m", "0.0125 rad", "a" * 60, "-12.5", "x1"]), min_size=1, max_size=30)


@given(words=WORDS, separator=st.sampled_from(["; ", ", ", " "]), width=st.integers(40, 120))
def test_a_cut_keeps_whole_numbers_and_says_that_there_is_more(words: list[str], separator: str, width: int) -> None:
    text = separator.join(words)
    told = shortened(text, width)
    assert len(told) <= width
    if told == text:
        return
    kept = told.removesuffix(MORE).rstrip("…;, ")
    assert told.endswith(MORE)
    assert text.startswith(kept)
    # Where a number is the end of what is kept, nothing of it follows in the text: a separator does.
    assert not kept[-1:].isdigit() or text[len(kept) :][:1] in ("", ";", ",")
