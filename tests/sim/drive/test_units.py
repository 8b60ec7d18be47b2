"""The factor group against exact fractions."""

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.sim.drive.dictionary import Dictionary, Entry
from haptic_fieldbus.sim.drive.units import Units, fit

FACTOR = st.integers(1, 2**32 - 1)
COUNTS = st.integers(-(2**31), 2**31 - 1)
PER_RADIAN = 4096 / (2 * math.pi)


def _units(factors: tuple[int, ...], polarity: int = 0, *, feed: bool = True) -> Units:
    entries = {
        (index, subindex): Entry(index, subindex, DataType.UINT32, factors[2 * place + subindex - 1])
        for place, index in enumerate((0x608F, 0x6091, 0x6092))
        for subindex in (1, 2)
    }
    dictionary = Dictionary(entry for entry in entries.values() if feed or entry.index != 0x6092)
    entries[0x607E, 0] = Entry(0x607E, 0, DataType.UINT8, polarity)
    return Units(PER_RADIAN, entries, dictionary)


@given(COUNTS, st.tuples(*[FACTOR] * 6), st.booleans())
def test_a_position_is_the_nearest_unit_modulo_32_bits(counts: int, factors: tuple[int, ...], turned: bool) -> None:
    resolution, gear, feed = (Fraction(factors[place], factors[place + 1]) for place in (0, 2, 4))
    exact = counts * feed / (resolution * gear) * (-1 if turned else 1)
    shown = _units(factors, 0x80 if turned else 0).position(counts)
    assert -(2**31) <= shown < 2**31
    difference = (exact - shown + 2**31) % 2**32 - 2**31
    assert abs(difference) <= Fraction(1, 2)


def test_as_it_comes_a_unit_is_a_count() -> None:
    units = _units((4096, 1, 1, 1, 4096, 1))
    assert units.plain
    assert units.position(-7) == -7
    assert units.angle == pytest.approx(2 * math.pi / 4096)
    assert units.velocity(2 * math.pi) == 4096


@pytest.mark.parametrize(("polarity", "angle", "speed"), [(0, 1, 1), (0x80, -1, 1), (0x40, 1, -1), (0xC0, -1, -1)])
def test_polarity_turns_positions_and_velocities_apart(polarity: int, angle: int, speed: int) -> None:
    units = _units((4096, 1, 1, 1, 3600, 1), polarity)
    assert (math.copysign(1, units.angle), math.copysign(1, units.speed)) == (angle, speed)
    assert units.counts(900 * angle) == 1024
    assert not units.plain


def test_without_feed_constant_counts_of_the_driving_shaft() -> None:
    assert _units((2000, 1, 4, 1, 9, 9), feed=False).position(400) == 100


def test_a_factor_of_zero_counts_as_one() -> None:
    assert _units((0, 0, 0, 0, 0, 0)).position(5) == 5


@pytest.mark.parametrize(("value", "fits"), [(1e12, 2**31 - 1), (-1e12, -(2**31)), (2.6, 3)])
def test_what_does_not_fit_is_bounded(value: float, fits: int) -> None:
    assert fit(value) == fits
