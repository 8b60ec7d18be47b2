"""Numbers as people read them in texts and plots; JSON keeps every digit.

Plain digits from 1e-4 up to 1e6, beyond them a power of ten: 1.2e-5. The minus is ASCII and thousands have no
separator, so that a printed number can be typed, `--set wall.stiffness=3370`.
"""

import math
import textwrap
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

DIGITS = 3
"""Significant digits of measured or computed numbers: finer than perception."""
LIMIT_DIGITS = 4
"""Significant digits of a limit and of a setting beside it, so that a setting just above reads differently."""
TYPED_DIGITS = 3
"""Significant digits of a limit, and of a setting below it: as a person would type them."""
PERCENT_DIGITS = 2
GIVEN_DIGITS = 12
"""Significant digits of a given number: all written ones, and none added by binary fractions."""
MOST_TYPED = 6
"""Largest number of digits that a person types; a number with more digits was computed."""
PLAIN_FROM, PLAIN_BELOW = 1e-4, 1e6

PREFIXES = ((1e-2, ""), (1e-4, "m"), (1e-7, "µ"), (1e-10, "n"))
"""SI prefixes, each from its smallest quantity on."""
FACTORS = {"": 1.0, "m": 1e3, "µ": 1e6, "n": 1e9}


def exactly(value: float) -> str:
    """Return a number as it was given."""
    return rounded(value, GIVEN_DIGITS)


def as_typed(value: float) -> str:
    """Return a number as it was given, or rounded when it has more digits than a person types."""
    given = exactly(value)
    digits = given.partition("e")[0].replace(".", "").strip("-0")
    return given if len(digits) <= MOST_TYPED else rounded_limit(value)


def rounded(value: float, digits: int = DIGITS) -> str:
    """Return a measured or computed number with this many significant digits, without trailing zeros."""
    if not math.isfinite(value):
        return str(float(value))
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    nearest = float(f"{mantissa}e{exponent}")
    if nearest == 0.0:
        return "0"
    if PLAIN_FROM <= abs(nearest) < PLAIN_BELOW:
        return repr(nearest).removesuffix(".0")
    return f"{mantissa.rstrip('0').rstrip('.') if '.' in mantissa else mantissa}e{int(exponent)}"


def rounded_limit(limit: float) -> str:
    """Return a computed limit, or a number compared with it."""
    return rounded(limit, LIMIT_DIGITS)


def rounded_down(value: float, digits: int = 2) -> float:
    """Return a number above 0 with this many digits, rounded down: a proposal must not exceed its limit."""
    # The factor just above 1 keeps rounding from lowering a value that already has so few digits.
    unit = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return float(f"{math.floor(value / unit * (1.0 + 1e-12)) * unit:.{digits}g}")


def in_unit(value: float, unit: str) -> str:
    """Return a measured or computed quantity, with an SI prefix if it is small.

    Units of kg keep their prefix.
    """
    fitting = (prefix for least, prefix in PREFIXES if abs(value) >= least)
    prefix = "" if unit.startswith("kg") else next(fitting, "")
    return f"{rounded(FACTORS[prefix] * value)} {prefix}{unit}"


def percent(share: float, digits: int = PERCENT_DIGITS) -> str:
    """Return a share in percent, whole ones from ten percent on."""
    whole = len(str(round(abs(100.0 * share)))) if math.isfinite(share) else 0
    return f"{rounded(100.0 * share, max(digits, whole))} %"


WIDE = 0.3
"""Half width of an interval, of its value, from which on its ends are told."""


def with_interval(value: float, low: float, high: float, unit: str) -> str:
    """Return a value with its interval: in percent, or the ends if it is wide."""
    half = 0.5 * (high - low)
    if value > 0.0 and half < WIDE * value:
        return f"{in_unit(value, unit)} ± {percent(half / value)}"
    return f"{in_unit(low, unit)} to {in_unit(high, unit)}"


# What is told of a plan, a run, a judgement or a bench is made once, as rows; texts and JSON objects are drawn of them.

Line = tuple[str, str]
"""A key and a text; an empty key continues the line before."""


LINE_WIDTH, KEY_WIDTH = 110, 11
"""Longest line of a short text, and the column of keys in it [characters]."""
MORE = "more with -v"


@dataclass(frozen=True)
class OutputRow:
    """One item of an output: in words, as a value of a JSON object, or both."""

    label: str = ""
    """Word in the column of keys of a text."""
    note: Iterable[str] = ()
    """Lines beside the label, shown once; none for an item of JSON alone."""
    key: str = ""
    """Key of the JSON object, with the unit of a number; empty for an item of words alone."""
    value: object = None
    """Value of the key as in JSON, SI unless the key names another unit."""
    detail: bool = False
    """True: a short text leaves it out."""
    cut: bool = False
    """True: in a short text each line stays one line. If it is too long, its last clauses are left out."""


def lines_of(rows: Iterable[OutputRow], *, once: bool = False, short: bool = False) -> list[Line]:
    """Return rows in words; `once`: a label equal to that of the previous row is not repeated.

    A `short` text repeats labels, has no details and no line over `LINE_WIDTH`, except where a single word is longer.
    """
    lines: list[Line] = []
    before = ""
    for row in rows:
        if short:
            lines += [] if row.detail else _short(row)
            continue
        for number, text in enumerate(row.note):
            lines.append(("" if number or (once and row.label == before) else row.label, text))
            before = row.label
    return lines


def _short(row: OutputRow) -> Iterator[Line]:
    """Yield each text of a row beside its label, in lines that fit: cut, or wrapped if nothing may be lost."""
    width = LINE_WIDTH - KEY_WIDTH
    for text in row.note:
        wrapped = textwrap.wrap(text, width, break_long_words=False, break_on_hyphens=False)
        lines = [shortened(text, width)] if row.cut else wrapped
        yield from ((row.label if number == 0 else "", line) for number, line in enumerate(lines))


def shortened(text: str, width: int) -> str:
    """Return a text of at most `width` characters: its last clauses are left out, with a mark.

    Clauses end with a semicolon, else with a comma. A clause that is too long by itself is cut between two words, and
    never between a number and its unit.
    """
    if len(text) <= width:
        return text
    for separator in ("; ", ", "):
        parts = text.split(separator)
        for kept in range(len(parts) - 1, 0, -1):
            told = separator.join([*parts[:kept], MORE])
            if len(told) <= width:
                return told
    room = text[: width - len(MORE) - 2]
    words = room.split(" ")[:-1]
    while words and words[-1][-1:].isdigit():
        words.pop()
    return f"{' '.join(words) or room.rstrip('-.0123456789')}… {MORE}"


def object_of(rows: Iterable[OutputRow], order: Iterable[str] = ()) -> dict[str, object]:
    """Return the JSON object of rows, with the keys of `order` first."""
    found = {row.key: row.value for row in rows if row.key}
    return {key: found[key] for key in dict.fromkeys((*order, *found)) if key in found}
