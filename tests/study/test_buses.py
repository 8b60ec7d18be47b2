"""One scene over both protocols: what is measured of a bus, and how the page tells it."""

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.report.drawing import svg
from haptic_fieldbus.study.measure.bench import Tools
from haptic_fieldbus.study.page.cost import BUSES, BusPoint, best_of_each, bus_points, buses_table, draw_buses

TOOLS = Tools(api.run, api.plan)
CAN, TCP, FAST, SLOW = BUSES
SILENCE, ANSWER_TIME = 1.75e-3, 0.2e-3


def point(bus: str, error: float | None, reason: str = "") -> BusPoint:
    return BusPoint(bus, "backward-difference", "FC23", 100.0, 5e-3, 1e-5, error, reason)


def test_the_best_run_of_each_bus_is_told_and_a_refused_one_with_its_reason() -> None:
    points = [point(SLOW, 0.2), point(CAN, 0.03), point(CAN, 0.02), point(SLOW, None, "60 N/m is unstable")]
    best = best_of_each(points)
    assert [(each.bus, each.felt_error) for each in best] == [(CAN, 0.02), (SLOW, 0.2)]
    text = buses_table(points)
    assert '<td class="good">2 %</td>' in text
    assert '<td class="bad">20 %</td>' in text
    assert '<td class="bad">60 N/m is unstable</td>' in text
    assert best_of_each([point(SLOW, None, "refused")])[0].reason == "refused", "no bus is left out"


@pytest.mark.thorough("draws figures")
def test_a_refused_run_is_drawn() -> None:
    every = svg(draw_buses([point(CAN, 0.02), point(SLOW, None, "refused")]))
    assert every.count("<use") > svg(draw_buses([point(CAN, 0.02)])).count("<use")


@pytest.mark.thorough("runs the scene on all buses")
def test_the_error_follows_the_age_of_the_torque_on_both_protocols() -> None:
    """A force that is late by τ is off by about τ·rms(Ḟ)/rms(F), and the hand, so Ḟ/F, is the same on each bus."""
    errors, ages, costs = {}, {}, {}
    for name in BUSES:
        first, second = bus_points(TOOLS, name, quick=True)
        assert first.felt_error is not None
        assert second.felt_error is not None
        assert second.rate_hz == first.rate_hz / 4
        assert first.felt_error < second.felt_error, "a slower loop is later"
        assert 1e-7 < first.computing_s < 1e-3
        errors[name], costs[name] = first.felt_error, first.bus_s
        bus, drive = BUSES[name]
        plan = api.plan("wall", bus=bus, drive=drive)
        ages[name] = 0.5 * plan.period + plan.delay.total
    assert errors[SLOW] / errors[FAST] == pytest.approx(ages[SLOW] / ages[FAST], rel=0.15)
    assert max(errors[CAN], errors[TCP]) < 0.5 * errors[FAST]
    # By hand: function 23 writes two registers in 17 characters; status word, position (two), torque and the target
    # that is read back come in 15. With two silences and the time of the drive's answer.
    for name, baud in ((FAST, 1e6), (SLOW, 115200.0)):
        assert costs[name] == pytest.approx(32 * 11 / baud + 2 * SILENCE + ANSWER_TIME)
    assert costs[TCP] == pytest.approx(2 * (0.25e-3 + ANSWER_TIME))
