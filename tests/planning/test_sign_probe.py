"""Torque, length and travel of the pulses that show the sign."""

import math
from dataclasses import replace
from typing import Any

import pytest

from haptic_fieldbus.drive.rig import Limits, RigAxis, Seen
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.sign_probe import SignProbe, sign_probe, sign_text
from tests.builders import VELOCITY_ONLY, WALL, plan_of, rig_of

RATIO = 0.05 / (2.0 * math.pi)
RATED = 0.4 / RATIO
MASS, FRICTION = 4e-5 / RATIO**2, 2e-3 / RATIO


def planned(rate: float = 1000.0, **changes: Any) -> Plan:
    return plan_of(rate=rate, rig=rig_of(WALL, **({"seen": Seen()} | changes)))


def probe_of(plan: Plan) -> SignProbe:
    probe = sign_probe(plan.axes[0], plan.period)
    assert probe is not None
    return probe


def test_a_simulated_bench_whose_sign_was_seen_has_no_pulses() -> None:
    plan = planned(seen=Seen(sign="seen"))
    assert sign_probe(plan.axes[0], plan.period) is None
    assert not [step for step in plan.steps if step.startswith("sign")]


def test_on_a_real_bus_the_sign_is_looked_for_whatever_the_rig_says() -> None:
    rig = rig_of(WALL)
    assert all(axis.seen.sign for axis in rig.axis.values())
    real = replace(rig, bus={name: replace(bus, interface="socketcan") for name, bus in rig.bus.items()})
    assert probe_of(plan_of(rig=real)).stages


@pytest.mark.parametrize("counts", [24, 400, 1000, 2000, 4096])
def test_a_pulse_on_the_free_handle_is_worth_four_counts_and_no_period_more(counts: int) -> None:
    probe = probe_of(planned(encoder_counts_per_revolution=counts))
    first = probe.stages[0]
    assert first.effort == pytest.approx(2.0 / 3.0 * 0.05 * RATED)

    def shown(periods: int) -> float:
        return (first.effort - FRICTION) / MASS * (periods * 1e-3) ** 2 / (0.05 / counts)

    assert shown(first.periods) >= 4.0 or first.periods == 100
    assert first.periods == 5 or shown(first.periods - 1) < 4.0
    assert probe.travel == pytest.approx(shown(first.periods) * 0.05 / counts)


@pytest.mark.parametrize("rate", [1000.0, 250.0, 50.0])
def test_a_pulse_has_whole_periods_and_five_milliseconds_at_least(rate: float) -> None:
    probe = probe_of(planned(rate))
    assert all(stage.periods / rate >= 0.005 - 1e-12 for stage in probe.stages)
    assert probe.time == pytest.approx({1000.0: 0.09, 250.0: 0.144, 50.0: 0.72}[rate])


@pytest.mark.parametrize("friction", [0.0, 0.005, 0.0133, 0.018, 0.03, 0.2])
def test_no_pulse_is_above_the_bound(friction: float) -> None:
    probe = probe_of(planned(coulomb_friction=friction))
    assert probe.largest <= max(0.05 * RATED, 1.1 * friction / RATIO) + 1e-9
    assert probe.holding == pytest.approx(0.05 * RATED)


def test_a_limit_of_the_rig_bounds_the_pulses_too() -> None:
    from haptic_fieldbus.drive.rig import Limits

    assert probe_of(planned(limits=Limits(effort=1.0))).largest <= 1.0


def test_an_unknown_inertia_begins_with_the_shortest_pulse_and_tells_no_travel() -> None:
    probe = probe_of(planned(inertia=None))
    assert (probe.stages[0].periods, probe.travel) == (5, None)
    assert [stage.periods for stage in probe.stages] == [5, 5, 10, 20]


def test_a_drive_with_velocity_only_states_the_speed() -> None:
    rig = rig_of(WALL, seen=Seen())
    plan = plan_of(rig=rig, profile=VELOCITY_ONLY)
    probe = probe_of(plan)
    assert probe.speed
    assert probe.step == pytest.approx(0.05 / 600)
    first = probe.stages[0]
    assert (first.effort - FRICTION) / MASS * first.periods * 1e-3 >= 4.0 * probe.step
    (step,) = [step for step in plan.steps if step.startswith("sign: ")]
    assert "m/s" in step


def test_the_bench_of_a_rig_file_is_looked_at_unless_it_says_so() -> None:
    assert RigAxis.__dataclass_fields__["seen"].default_factory is Seen
    assert Seen().sign is None


def test_until_the_sign_is_seen_no_more_is_permitted_than_the_axis_may_have() -> None:
    plan = planned(limits=Limits(effort=1.0))
    assert probe_of(plan).holding == pytest.approx(1.0)
    assert sign_text(plan.axes[0], probe_of(plan)).endswith("at most 1 N")
    assert probe_of(planned()).holding == pytest.approx(0.05 * RATED)
