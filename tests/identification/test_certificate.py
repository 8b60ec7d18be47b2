"""Taps against a contact on a plant of the simulation, and the growth of its swings."""

import math
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.identification.certificate import FIRST_COUNTS, Certificate, Swings, TappedContact, Tapping
from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.identification.experiment import Experiment, Stage
from haptic_fieldbus.identification.shaft import ShaftModel, ShaftRecord
from haptic_fieldbus.numerals import lines_of, object_of
from tests.identification.benches import Bench, Course, conducted, plant_of_bench

LIGHT = Bench(ShaftModel(1e-4, 2e-4, 0.0, 5e-4, 2e-4), 65_536, 1000.0, 0.2, 50.0, 6.0)
"""A bench without friction; its onset is close to b/(T/2 + delay + lag), 0.167 N·m/rad."""
SURFACE = 0.3
STEP = 0.004
"""Of the torque, as a share of the effort."""


class Contact(Experiment):
    """Taps and the wall that they tap, as the loop adds them; a finger beside them."""

    finger = 0.0
    """Strength of the finger, as a share of the press."""
    listened = 0

    def __init__(self, taps: Tapping, stiffness: float) -> None:
        super().__init__(taps.bounds)
        self.taps, self.stiffness = taps, stiffness

    def _all(self) -> Stage:
        yield 0.0

    def effort(self, position: float) -> float:
        self.taps.advance(position)
        asked = self.taps.effort(position)
        self.stage, self.done = self.taps.stage, self.taps.done
        side = math.copysign(1.0, self.taps.press)
        depth = max(side * (position - self.taps.surface), 0.0)
        self.listened += self.stage == "tap"
        pushes = any(0 <= self.listened - at < 50 for at in (2000, 4100, 4600))
        return asked - side * self.stiffness * depth + (self.finger * self.taps.press if pushes else 0.0)


def laid(bench: Bench, stiffness: float, side: float = 1.0) -> Tapping:
    model = bench.model
    press = side * min(0.9 * bench.effort, 0.4 * stiffness * bench.bounds.high)
    least = max(FIRST_COUNTS * bench.bounds.resolution, 10.0 * STEP * bench.effort / stiffness)
    return Tapping(
        bench.bounds, model.inertia, model.coulomb, model.delay + model.lag, surface=side * SURFACE, press=press,
        stiffness=stiffness, least=least,
    )  # fmt: skip


def tapped(bench: Bench, stiffness: float, side: float = 1.0) -> tuple[Tapping, Course]:
    taps = laid(bench, stiffness, side)
    return taps, conducted(Contact(taps, stiffness), bench, plant_of_bench(bench))


@pytest.mark.parametrize(("growth", "counts"), [(0.5, 1e5), (0.9, 1e5), (0.98, 1e4), (1.02, 1e4)])
def test_growth_is_that_of_a_swing_with_a_known_one(growth: float, counts: float) -> None:
    times = np.arange(4000) * 1e-3
    places = growth ** (5.0 * times) * np.cos(2.0 * math.pi * 5.0 * times)
    swings = Swings(1.0 / counts, 16.0 / counts)
    found = [ratio for place in np.rint(places * counts) / counts if (ratio := swings.take(place)) is not None]
    assert found[:3] == pytest.approx([growth] * 3, abs=2e-3)


def test_a_swing_of_few_counts_judges_nothing() -> None:
    swings = Swings(1.0, 16.0)
    places = [15.0 * math.cos(0.1 * number) / 2.0 for number in range(400)]
    assert all(swings.take(float(round(place))) is None for place in places)
    assert not swings.is_large


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_the_growth_of_a_contact_without_friction_is_that_of_its_damping_and_delay(share: float, side: float) -> None:
    """The decay rate of a light contact is (b − K·τ)/2m, with the age τ of the force."""
    model, age = LIGHT.model, 0.5e-3 + LIGHT.model.delay + LIGHT.model.lag
    stiffness = share * model.damping / age
    taps, course = tapped(LIGHT, stiffness, side)
    assert taps.failure == ""
    period = 2.0 * math.pi * math.sqrt(model.inertia / stiffness)
    expected = math.exp(-(model.damping - stiffness * age) / (2.0 * model.inertia) * period)
    assert taps.growth == pytest.approx(expected, abs=0.01)
    assert max(map(abs, course.record.torques)) <= LIGHT.effort
    assert abs(course.angles[-1] - course.angles[0]) < 0.1, "the handle is led back to where it was"
    pressed = course.angles[course.stages.index("tap") : course.stages.index("back")]
    assert min(side * angle for angle in pressed) > SURFACE, "contact stays"


def test_a_contact_above_its_onset_ends_the_taps() -> None:
    taps, course = tapped(LIGHT, 0.3)
    assert taps.grew
    assert "times as large as the one a period before" in taps.failure
    assert taps.done
    assert taps.effort(course.angles[-1]) == 0.0


@pytest.mark.parametrize("coulomb", [0.0, 0.004])
@pytest.mark.parametrize("share", [0.3, 0.7])
def test_a_finger_that_taps_shows_the_growth_of_a_free_swing(share: float, coulomb: float) -> None:
    """It pushes while the handle swings too, which lets single swings grow; friction only makes a growth smaller."""
    model, age = replace(LIGHT.model, coulomb=coulomb), 0.5e-3 + LIGHT.model.delay + LIGHT.model.lag
    stiffness = share * model.damping / age
    taps, contact = by_hand(replace(LIGHT, model=model), stiffness)
    assert contact.listened > 9000
    period = 2.0 * math.pi * math.sqrt(model.inertia / stiffness)
    expected = math.exp(-(model.damping - stiffness * age) / (2.0 * model.inertia) * period)
    assert taps.failure == ""
    assert taps.growth is not None
    assert taps.growth < expected + 0.02
    assert coulomb or taps.growth == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("coulomb", [0.0, 1e-4])
def test_a_contact_above_its_onset_grows_beside_a_finger_too(coulomb: float) -> None:
    taps, _ = by_hand(replace(LIGHT, model=replace(LIGHT.model, coulomb=coulomb)), 0.3)
    assert taps.grew
    assert "times as large as the one a period before" in taps.failure


def by_hand(bench: Bench, stiffness: float) -> tuple[Tapping, Contact]:
    """Tap a contact by a finger that the record does not show."""
    taps = laid(bench, stiffness)
    taps.by_hand, contact = True, Contact(taps, stiffness)
    contact.finger = 0.3
    conducted(contact, bench, plant_of_bench(bench))
    return taps, contact


def test_friction_that_stops_each_swing_is_no_growth() -> None:
    taps, _ = tapped(replace(LIGHT, model=replace(LIGHT.model, coulomb=0.02)), 0.1)
    assert taps.failure == ""
    assert taps.growth == 0.0


def contact(stiffness: float, growth: float | None) -> TappedContact:
    return TappedContact(stiffness, growth, by_hand=False, record=ShaftRecord(1e-3, (), (), 1e-3))


BENCH: dict[str, object] = {
    "rig": "rig.toml", "drive": "a drive", "serial": "0x00001234", "firmware": None, "bus": "can0", "rate_hz": 1000.0,
    "basis": "stated",
}  # fmt: skip


def certificate(*growths: float | None, onset: Estimate | None = None, predicted: float = 1000.0) -> Certificate:
    contacts = tuple(contact(100.0 * (place + 1), growth) for place, growth in enumerate(growths))
    return Certificate(
        "wall", "wall", "N/m", 300.0, predicted, contacts, onset, "growth", BENCH, "2026-11-27T12:00:00+00:00"
    )


@pytest.mark.parametrize(
    ("growths", "seen"),
    [
        ((), None),
        ((None, None), None),
        ((None, 0.0, 0.5), 300.0),
        ((0.5, 0.95, 0.6), 100.0),
        ((0.95,), None),
        ((0.5, None, 0.8, 1.2), 300.0),
    ],
)
def test_what_was_seen_is_the_largest_stiffness_with_all_below_it_well_damped(
    growths: tuple[float | None, ...], seen: float | None
) -> None:
    assert certificate(*growths).seen == seen


def test_rows_are_a_text_and_a_json_object_of_the_same() -> None:
    onset = Estimate(500.0, 450.0, 550.0, "N/m", "friction hides it")
    found = certificate(None, 0.0, 0.5, onset=onset)
    text = "\n".join(" ".join(line) for line in lines_of(found.rows()))
    parts = (
        "a drive, serial 0x00001234, can0 at 1000 Hz", "500 N/m ± 10 %, extrapolated; friction hides it",
        "300 N/m well damped", "no second swing", "no swing was large enough", "below the predicted 1000 N/m",
    )  # fmt: skip
    for part in parts:
        assert part in text
    told = object_of(found.rows())
    assert told["onset"] == {"value": 500.0, "low": 450.0, "high": 550.0}
    assert (told["seen"], told["predicted"], told["bench"]) == (300.0, 1000.0, BENCH)
    assert certificate().contradiction == ""


@pytest.mark.parametrize(("low", "told"), [(50.0, True), (110.0, True), (112.0, False)])
def test_a_stiffness_near_the_onset_that_rests_by_friction_is_warned_of(low: float, told: bool) -> None:
    """`seen` is 100 N/m here, and 0.9 of 111 N/m is 100."""
    found = certificate(0.5, onset=Estimate(400.0, low, 800.0, "N/m"), predicted=400.0)
    assert found.seen == 100.0
    assert ("100 N/m is near or above an onset" in found.nearness) == told
    assert any("friction stopped" in line for _, line in lines_of(list(found.rows()))) == told


def test_a_predicted_onset_five_per_cent_beside_the_interval_is_a_contradiction() -> None:
    onset = Estimate(500.0, 450.0, 550.0, "N/m", "")
    for predicted, told in ((425.0, "above"), (430.0, ""), (520.0, ""), (575.0, ""), (583.0, "below")):
        sentence = certificate(predicted=predicted, onset=onset).contradiction
        assert sentence.startswith(f"the onset is {told} the predicted" if told else "")
        assert bool(sentence) == bool(told)
