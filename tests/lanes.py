"""Lanes of tests: `make test` runs the quick one, `make test-all` the thorough one too, `make test-vendor` a third.

A test is quick unless it, its class or its module is marked: `@pytest.mark.thorough("compares 700 seeds")`. The reason
is required. `quick=2` leaves two of its parametrisations, evenly spread, in the quick lane; `quick=("wall",)` leaves
those of these IDs; one parameter alone is marked by `pytest.param`. A marker of a test counts more than one of its
class. The thorough lane also runs every hypothesis test again, with all of its examples. Any lane can be split into
parts that are the same on every machine.

Tests that read real vendors' EDS files are marked `vendor` and run in the vendor lane alone; see
tests/eds/vendor_files.py. No other test reads a file outside of the checkout.
"""

import os
from argparse import ArgumentTypeError
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from hashlib import sha256
from pathlib import Path

import pytest
from hypothesis import settings

VENDOR_FILES = "HAPTIC_FIELDBUS_VENDOR_FILES"
"""Environment variable: a folder with EDS and DCF files of vendors. Nothing is read where it is not set."""

ON_REQUEST = ("soak", "vendor")
"""Lanes that no other lane includes."""
SLOW = (*ON_REQUEST, "thorough")
"""Markers of what is not in the quick lane, by the lane that takes it; the first counts more."""
USUAL_EXAMPLES = 100
"""How many a hypothesis test has when it says nothing."""
FEWEST_EXAMPLES = 3


class Lane(Enum):
    """Which tests a run takes."""

    QUICK = "quick"
    THOROUGH = "thorough"
    ALL = "all"
    SOAK = "soak"
    VENDOR = "vendor"

    def takes(self, item: pytest.Item, slow: str | None) -> bool:
        """Whether a test runs in this lane; `slow` is its marker, if it has one."""
        if self is Lane.ALL:
            return slow not in ON_REQUEST
        if slow is None:
            return self is Lane.QUICK or (self is Lane.THOROUGH and has_examples(item))
        return self is Lane(slow)


@dataclass(frozen=True)
class Part:
    """One of several shares of the tests, about equal, numbered from 0."""

    number: int
    count: int

    @classmethod
    def read(cls, text: str) -> "Part":
        """Of `2/4`; a larger number is taken modulo the count, so that a hash will do."""
        number, _, count = text.partition("/")
        if not (number.isdecimal() and count.isdecimal() and int(count)):
            raise ArgumentTypeError(f"{text!r}: expected a number and a count, as in 2/4")
        return cls(int(number) % int(count), int(count))

    def takes(self, item: pytest.Item) -> bool:
        """By a hash of the node-ID, which no test beside it changes; tests of one xdist group stay together."""
        group = item.get_closest_marker("xdist_group")
        name = item.nodeid if group is None else str(group.args[0])
        return int.from_bytes(sha256(name.encode()).digest()[:8]) % self.count == self.number


def vendor_files() -> list[Path]:
    """Return the EDS and DCF files of vendors in the folder that the environment names, none where it names none."""
    folder = os.environ.get(VENDOR_FILES)
    return sorted(path for path in Path(folder).glob("*") if path.suffix.lower() in (".eds", ".dcf")) if folder else []


def slow_markers(items: Iterable[pytest.Item]) -> dict[pytest.Item, str]:
    """Tests that are not in the quick lane, and the marker that says so.

    Raises pytest.UsageError when a marker gives no reason.
    """
    families: dict[tuple[str, str], list[pytest.Item]] = {}
    for item in items:
        family = (item.parent.nodeid if item.parent else "", getattr(item, "originalname", item.name))
        families.setdefault(family, []).append(item)
    return {item: name for family in families.values() for item, name in _slow_of(family)}


def has_examples(item: pytest.Item) -> bool:
    """Whether hypothesis makes up the arguments."""
    return bool(getattr(getattr(item, "obj", None), "is_hypothesis_test", False))


def examples(count: int) -> int:
    """How many of `count` examples hypothesis shall try in the lane of this run."""
    return min(count, max(FEWEST_EXAMPLES, count * settings().max_examples // USUAL_EXAMPLES))


def _slow_of(family: Sequence[pytest.Item]) -> Iterable[tuple[pytest.Item, str]]:
    """Of the parametrisations of one test."""
    for number, item in enumerate(family):
        for name in SLOW:
            markers = _nearest(item, name)
            for marker in markers:
                _check(item, marker)
            if not all(_stays(item, number, len(family), marker.kwargs.get("quick", 0)) for marker in markers):
                yield item, name
                break


def _nearest(item: pytest.Item, name: str) -> list[pytest.Mark]:
    """Markers of the test and of its parameters, which hold together; else the one of its class or module."""
    own = [marker for marker in item.own_markers if marker.name == name]
    inherited = item.get_closest_marker(name)
    return own or ([inherited] if inherited is not None else [])


def _stays(item: pytest.Item, number: int, count: int, quick: int | Sequence[str]) -> bool:
    """Whether this parametrisation, the `number`-th of `count`, is one of those that stay quick."""
    if isinstance(quick, int):
        return number in {each * count // quick for each in range(min(quick, count))}
    callspec = getattr(item, "callspec", None)
    return callspec is not None and callspec.id in quick


def _check(item: pytest.Item, marker: pytest.Mark) -> None:
    match marker.args:
        case (str(reason),) if reason.strip() and marker.kwargs.keys() <= {"quick"}:
            return
    raise pytest.UsageError(
        f"{item.nodeid}: say why this test is not in the quick lane, "
        f'as in @pytest.mark.{marker.name}("compares 700 seeds")'
    )
