"""Verdicts that were once false: the event-exact simulation grows where a contact was called stable or passive."""

import math

import numpy as np
import pytest

from haptic_fieldbus.margins import Plant, Verdict
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.braking_pulse import BrakingPulse
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.needle import Needle
from haptic_fieldbus.scenes.wall import Wall
from tests.loops import BENCH, LAG, PERIOD
from tests.margins.events import Bench
from tests.margins.laws import Array, Crossley, Law

DELAY = 0.4e-3
EFFORT = 94.0
PLANT = Plant(BENCH.mass, BENCH.damping, BENCH.coulomb, BENCH.resolution, LAG)


def growth(effort: float, depth: float, loss: float, forces: list[float], periods: int = 7000) -> Array:
    """Growth a period of a knock of 0.1 µm/s on a handle that leans with each of these forces, as n = 3/2."""
    many, one = len(forces), np.ones(len(forces))
    push, k = np.array(forces), effort / depth**1.5
    law = Law(many, [Crossley(np.arange(many), 0.0 * one, k * one, 1.5 * one, loss * one)])
    bench = Bench(
        PLANT.mass * one, PLANT.damping * one, PERIOD, DELAY * one, LAG * one, EFFORT * one, 0.0 * one, 0.0 * one,
        0.0 * one, 0.0 * one, push,
    )  # fmt: skip
    reach, _ = bench.run(law, (push / k) ** (1.0 / 1.5), 1e-7 * one, periods, 7)
    # A knock that has died to rounding counts as one of 1 fm.
    grown: Array = ((reach[-1] + 1e-15) / (reach[1] + 1e-15)) ** (7.0 / (5.0 * periods))
    return grown


def judged(effort: float, depth: float, loss: float) -> Group:
    element = HuntCrossley("a", effort, depth, exponent=1.5, loss=loss)
    member = Member("a", PLANT, DELAY, (element,), None, "backward-difference", effort=EFFORT)
    return Group((member,), (), PERIOD)


def test_a_body_that_is_stable_deep_inside_is_refused_where_it_grows_near_the_surface() -> None:
    """Hunt–Crossley of 300 N at 15 mm: once "stable, margin 3.6", from the one depth of 15 mm."""
    grown = growth(300.0, 0.015, 0.5, [0.3, 1.0, 3.0, 6.0, 10.0, 20.0])
    assert (grown > 1.0003).all()
    found = judged(300.0, 0.015, 0.5).stability
    assert found.verdict is Verdict.UNSTABLE
    assert found.spectral_radius >= grown.max() - 1e-4


def test_a_body_that_grows_when_leant_on_is_neither_passive_nor_stable() -> None:
    """Hunt–Crossley of 1.86 N at 2 mm: once "passive, whatever hand"; 6 N press it deeper than 2 mm."""
    assert growth(1.86, 0.002, 0.0, [6.0])[0] > 1.0003
    assert judged(1.86, 0.002, 0.0).stability.verdict is Verdict.UNSTABLE


@pytest.mark.thorough("simulates 25 places twice")
@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_the_limit_is_where_the_worst_place_begins_to_grow(loss: float) -> None:
    found = judged(20.0, 0.015, loss)
    limit = found.stability.stiffness_limit.stable
    assert limit is not None
    forces = np.geomspace(0.03, 0.99 * EFFORT, 25).tolist()
    share = limit / (1.5 * 20.0 / 0.015)
    below, above = (growth(part * share * 20.0, 0.015, loss, forces).max() for part in (0.97, 1.05))
    assert below <= 1.0 < above  # 1 exactly: all knocks died to rounding


def test_less_force_or_less_way_leaves_out_the_places_beyond() -> None:
    """At 2 mm and below it, that is up to 1.86 N, the second body is stable and passive."""
    whole = judged(1.86, 0.002, 0.0)
    (member,) = whole.members
    for limited in ({"effort": 1.86}, {"travel": (-0.1, 0.002)}):
        group = Group((Member(**{**vars(member), **limited}),), (), PERIOD)
        assert group.stability.verdict is Verdict.PASSIVE
    assert math.isfinite(whole.stability.spectral_radius)


NEEDLE = Needle("a", 15.0, 0.012, 210.0, 2.6, cutting=4.5, drag=1.06, position=-0.007)


@pytest.mark.parametrize("elements", [(NEEDLE,), (BrakingPulse("a", 1.06, 0.05, 0.01), Wall("a", 1650.0))])
def test_a_damping_that_acts_only_at_times_does_not_count_for_ever(elements: tuple[Element, ...]) -> None:
    """The drag of an open hole once counted for the closed capsule, and a pulse for the time before it."""
    member = Member("a", Plant(0.37, 0.9, torque_lag=LAG), 0.0, elements, None, "backward-difference", effort=15.5)
    assert Group((member,), (), PERIOD).stability.verdict is Verdict.UNSTABLE
