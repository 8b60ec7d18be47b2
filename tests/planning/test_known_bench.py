"""A plan rests on what `identify` has measured: its limit is below the true one, and what does not count is refused.

The true limit is computed here, from the true mass, damping, delay and lag, by the exponential of a matrix of scipy.
"""

import math
from dataclasses import replace
from random import Random
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from haptic_fieldbus.drive.profile import DriveProfile, Identity
from haptic_fieldbus.drive.rig import (
    CompliantCoupling,
    Identified,
    LinearMechanism,
    Mechanics,
    Rig,
    RigAxis,
    default_axis,
)
from haptic_fieldbus.errors import PlanError, RigError
from haptic_fieldbus.margins import Basis
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.explain import explain, plan_json
from haptic_fieldbus.planning.known_bench import (
    KnownBench,
    as_stated,
    check_measured_drive,
    digest_with,
    known_bench,
    measured_texts,
    measured_times,
    widened,
)
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import select
from haptic_fieldbus.protocols.canopen.bus import CanSection, StandInCanSection
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.signals import Workspace
from tests.builders import canopen

PROFILE = load_profile("maxon_epos4")
LOCKED = replace(PROFILE, timing=replace(PROFILE.timing, control_tick="sync", encoder_latency=0.0))
"""A drive whose control tick is locked to SYNC, so that its delay is the same in each period."""
AXIS = default_axis(Workspace.LINEAR, bus="b", node=1, profile="p")
RATIO = AXIS.mechanism.ratio
DECIDING = ("inertia", "viscous_damping", "delay_and_lag", "torque_lag")
"""Values on which the limit of a spring depends."""


def oracle_limit(mass: float, damping: float, delay: float, lag: float, period: float) -> float:
    """Return the stiffness [N/m] at which the largest modulus of the eigenvalues of a period is 1."""
    whole = int(delay / period)
    rest = delay - whole * period
    motion = np.array([[0.0, 1.0, 0.0], [0.0, -damping / mass, 1.0 / mass], [0.0, 0.0, -1.0 / lag]])

    def held(time: float) -> tuple[Matrix, Matrix]:
        both = expm(np.block([[motion, np.array([[0.0], [0.0], [1.0 / lag]])], [np.zeros((1, 4))]]) * time)
        return both[:3, :3], both[:3, 3]

    (before, force_before), (after, force_after) = held(rest), held(period - rest)

    def radius(stiffness: float) -> float:
        count = 3 + whole + 1
        step = np.zeros((count, count))
        step[:3, :3] = after @ before
        newest = np.zeros(count)
        newest[0] = -stiffness
        forces = [newest, *np.eye(count)[3:]]  # that of this sample, then those before
        step[:3] += np.outer(after @ force_before, forces[whole + 1]) + np.outer(force_after, forces[whole])
        step[3:] = forces[: whole + 1]
        return float(max(abs(np.linalg.eigvals(step))))

    low, high = 0.0, 4.0 * (mass / period**2 + damping / period)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if radius(middle) < 1.0 else (low, middle)
    return low


def told(share: float = 0.01, **values: Any) -> Identified:
    """Return measured values, each with an interval of this share to both sides."""
    known = {
        "inertia": 4e-5, "viscous_damping": 1e-4, "coulomb_friction": 2e-3, "delay_and_lag": 5.6e-4,
        "torque_lag": 1.6e-4, **values,
    }  # fmt: skip
    ends: dict[str, Any] = {
        f"{key}_interval": ((1.0 - share) * each, (1.0 + share) * each) for key, each in known.items()
    }
    return Identified(**known, **ends, profile=PROFILE.name)


def planned(
    measured: Identified,
    profile: DriveProfile = PROFILE,
    rate: float = 1000.0,
    bus: str = "haptic_sim",
    *,
    seal: bool = True,
    **axis: Any,
) -> Plan:
    """Return the plan of a bench with these measured values, which `seal` seals as `identify` does."""
    own = replace(AXIS, identified=measured, **axis)
    section = CanSection(bus, "sim")
    if seal and measured.digest is None and measured != Identified():
        measured = replace(measured, bus=measured.bus or section.route)
        own = replace(own, identified=replace(measured, digest=digest_with(own, measured)))
    rig = Rig({"b": section}, {"handle": own}, source="rig.toml")
    return compile_plan(load_scene("wall"), rig, {"p": profile}, rate)


def bench_of(axis: RigAxis, bus: str = "haptic_sim") -> KnownBench:
    return known_bench(Rig({"b": CanSection(bus, "sim")}, {"handle": axis}), "handle", PROFILE)


def expecting(measured: Identified, profile: DriveProfile = PROFILE, rate: float = 1000.0) -> Identified:
    """Return the values with the delay that the plan of the measurement expects."""
    (axis,) = planned(measured, profile, rate).axes
    return replace(measured, planned_delay=axis.delay.transport + axis.delay.torque_loop)


def limit_of(plan: Plan) -> float:
    assert plan.stability is not None
    return plan.stability.limit.value


# The limit.


def test_the_oracle_knows_the_textbook_case() -> None:
    """With hardly any lag, a light delay and weak damping the limit is b/(T/2 + td + λ)."""
    assert oracle_limit(1.0, 0.5, 0.3e-3, 1e-5, 1e-3) == pytest.approx(0.5 / 0.81e-3, rel=2e-3)


def test_a_plan_rests_on_the_measured_values_and_says_so() -> None:
    plan = planned(expecting(told(viscous_damping=5e-5)))
    (axis,) = plan.axes
    assert axis.plant is not None
    assert axis.plant.damping == pytest.approx(5e-5 / RATIO**2)
    assert plan.stability is not None
    assert plan.stability.limit.basis is Basis.IDENTIFIED
    text = explain(plan, verbose=True)
    assert "measured   inertia 4e-5 kg·m² ± 1 %, damping 50 µN·m·s/rad ± 1 %, friction 2 mN·m ± 1 %" in text
    assert "N/m (damping measured); 600 is" in text
    assert "stated, not measured" not in text
    assert plan_json(plan)["limit"] == {"value": limit_of(plan), "unit": "N/m", "basis": "identified"}


def test_only_what_was_not_measured_is_still_stated() -> None:
    plan = planned(Identified(inertia=5e-5, inertia_interval=(4.9e-5, 5.1e-5)))
    (axis,) = plan.axes
    assert (axis.bench.inertia, axis.bench.viscous_damping, axis.bench.basis) == (5e-5, 1e-4, Basis.STATED)
    assert axis.bench.shares[1] == (0.5, 2.0)
    assert "damping stated, not measured" in explain(plan)


@pytest.mark.parametrize("profile", [PROFILE, LOCKED], ids=["tick unknown", "tick locked"])
@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_the_limit_is_below_that_of_every_bench_inside_the_region(profile: DriveProfile, rate: float) -> None:
    """Intervals of 5 % are a region of 10 %."""
    draw = Random(7)
    measured = expecting(told(0.05, delay_and_lag=7e-4, torque_lag=2e-4), profile, rate)
    limit = limit_of(planned(measured, profile, rate))
    for _ in range(40):
        shares = {key: draw.choice([0.9, 1.1, draw.uniform(0.9, 1.1)]) for key in DECIDING}
        at = {key: share * getattr(measured, key) for key, share in shares.items()}
        true = oracle_limit(
            at["inertia"] / RATIO**2, at["viscous_damping"] / RATIO**2, at["delay_and_lag"] - at["torque_lag"],
            at["torque_lag"], 1.0 / rate,
        )  # fmt: skip
        assert limit <= true * (1.0 + 1e-6)
    nominal = oracle_limit(4e-5 / RATIO**2, 1e-4 / RATIO**2, 5e-4, 2e-4, 1.0 / rate)
    assert limit > 0.55 * nominal
    assert profile is PROFILE or limit > 0.8 * nominal


def test_a_damping_that_friction_hides_leaves_no_limit() -> None:
    hidden = replace(told(), viscous_damping_interval=(0.0, 1.9e-4))
    plan = planned(hidden)
    assert limit_of(plan) == 0.0
    assert "0 N/m (damping measured); no stiffness is stable" in explain(plan)
    assert limit_of(planned(replace(told(), viscous_damping=0.0, viscous_damping_interval=(0.0, 0.0)))) == 0.0


def test_an_interval_that_ends_at_0_is_as_wide_as_its_other_side() -> None:
    assert widened(1.0, (0.8, 1.1)) == pytest.approx((0.6, 1.4))
    assert widened(1.0, (0.4, 1.5)) == pytest.approx((0.0, 2.2))
    assert widened(0.0, (0.0, 0.1)) == pytest.approx((0.0, 0.2))


def test_a_limit_takes_a_few_of_the_sixteen_corners(monkeypatch: pytest.MonkeyPatch) -> None:
    from haptic_fieldbus.margins.group import Group

    counted: list[float] = []
    rough = Group.rough_limit

    def noted(self: Group) -> float:
        counted.append(0.0)
        return rough(self)

    monkeypatch.setattr(Group, "rough_limit", noted)
    plan = planned(expecting(told(0.0123, inertia=4.1e-5)))
    assert not counted  # nobody has asked for the limit
    limit_of(plan)
    assert len(counted) <= 4


def test_a_table_without_a_digest_is_judged_like_stated_values() -> None:
    """Anybody may have written it, so it never narrows what is open, and never says that it was measured."""
    measured = expecting(told(viscous_damping=3e-4))
    (axis,) = planned(measured, seal=False).axes
    assert (axis.bench.basis, axis.bench.viscous_damping) == (Basis.STATED, 3e-4)
    assert axis.bench.shares == ((0.8, 1.25), (0.5, 2.0), (0.5, 2.0))
    assert limit_of(planned(measured, seal=False)) <= limit_of(planned(Identified(), viscous_damping=3e-4))
    text = explain(planned(measured, seal=False), verbose=True)
    assert "without digest, so judged like stated values" in text
    assert "damping stated, not measured" in text
    rough = replace(measured, viscous_damping_interval=(1e-4, 5e-4))
    assert bench_of(replace(AXIS, identified=rough)).shares[1] == pytest.approx((0.0, 7.0 / 3.0))


def test_a_bench_of_which_a_value_is_varied_is_none_that_was_measured() -> None:
    stated = as_stated(replace(AXIS, identified=replace(told(viscous_damping=7e-4), inertia=None)))
    assert (stated.inertia, stated.viscous_damping, stated.identified) == (4e-5, 7e-4, Identified())


# Delay and lag.


def times_of(
    measured: Identified, profile: DriveProfile = PROFILE, rate: float = 1000.0, bus: str = "haptic_sim"
) -> Any:
    (axis,) = planned(measured, profile, rate, bus).axes
    return measured_times(axis.bench, profile, axis.delay, (1e-4, 3e-4))


def test_the_measured_delay_takes_the_place_of_what_the_profile_leaves_open() -> None:
    measured = expecting(told(delay_and_lag=9e-4), LOCKED)
    times = times_of(measured, LOCKED)
    assert (times.total, times.lag) == (9e-4, 1.6e-4)
    assert times.delay == pytest.approx(7.4e-4)
    assert times.totals == pytest.approx((9e-4 * 0.98, 9e-4 * 1.02))
    (axis,) = planned(measured, LOCKED).axes
    assert axis.group is not None
    assert axis.group.members[0].delay == pytest.approx(7.4e-4)
    assert axis.group.members[0].plant.torque_lag == 1.6e-4


def test_a_tick_that_is_not_locked_may_be_a_control_period_later_after_the_next_start() -> None:
    locked, free = times_of(expecting(told(), LOCKED), LOCKED), times_of(expecting(told()))
    assert free.totals[1] == pytest.approx(locked.totals[1] + PROFILE.timing.control_period)


def test_a_host_on_a_real_bus_may_be_late() -> None:
    measured = expecting(told())
    assert times_of(measured, bus="socketcan").totals[1] == pytest.approx(times_of(measured).totals[1] + 1e-4)


def test_a_longer_delay_than_the_profile_permits_counts_without_a_planned_one_too() -> None:
    (axis,) = planned(Identified()).axes
    longest = axis.delay.range[1] + 3e-4
    assert times_of(told(delay_and_lag=0.9 * longest)) is None
    times = times_of(told(delay_and_lag=1.1 * longest))
    assert times.totals[1] == pytest.approx(1.1 * 1.02 * longest + PROFILE.timing.control_period)
    assert times.totals[0] == 0.0


@pytest.mark.parametrize("delay", [0.1234565, 0.7654325, 5.4321e-4])
def test_a_planned_delay_that_a_rig_keeps_in_six_digits_is_still_that_of_its_plan(delay: float) -> None:
    measured = told(delay_and_lag=0.9 * delay)
    (axis,) = planned(replace(measured, planned_delay=float(f"{delay:.6g}"))).axes
    planned_now = replace(axis.delay, drive=axis.delay.drive + delay - axis.delay.transport - axis.delay.torque_loop)
    assert planned_now.transport + planned_now.torque_loop == pytest.approx(delay, rel=1e-12)
    times = measured_times(axis.bench, PROFILE, planned_now, (1e-4, 3e-4))
    assert times is not None
    assert times.total == 0.9 * delay


@pytest.mark.parametrize("surplus", [-2e-4, 3e-4])
def test_at_another_rate_the_share_of_drive_and_computer_is_kept_and_never_negative(surplus: float) -> None:
    """At 50 kbit/s the frames take longer, so that the plan expects more."""
    measured = expecting(told())
    (slow,) = planned(measured, rate=100.0, bus="haptic_sim").axes
    planned_now = slow.delay.transport + slow.delay.torque_loop
    assert measured.planned_delay is not None
    own = replace(measured, planned_delay=planned_now - 1e-4, delay_and_lag=planned_now - 1e-4 + surplus,
                  delay_and_lag_interval=(planned_now - 1e-4 + surplus,) * 2)  # fmt: skip
    times = times_of(own, rate=100.0)
    assert times.total == pytest.approx(planned_now + max(surplus, 0.0))
    assert times.totals[1] == pytest.approx(planned_now + max(surplus, 0.0) + PROFILE.timing.control_period)


def test_without_a_planned_or_a_measured_delay_the_ranges_of_the_profile_count() -> None:
    measured = expecting(told())
    assert times_of(replace(measured, planned_delay=None)) is None
    assert times_of(replace(measured, delay_and_lag=None, delay_and_lag_interval=None)) is None


def test_a_lag_that_was_not_measured_has_the_range_of_the_profile() -> None:
    times = times_of(expecting(replace(told(), torque_lag=None, torque_lag_interval=None)))
    assert (times.lag, times.lags) == (PROFILE.torque_lag, (1e-4, 3e-4))


def test_a_compliant_coupling_stays_open() -> None:
    coupling = CompliantCoupling(stiffness=1.0, load_inertia=3e-5)
    (axis,) = planned(expecting(told()), simulation=Mechanics(coupling=coupling)).axes
    assert axis.group is not None
    ranges = axis.group.members[0].ranges
    assert ranges is not None
    assert ranges.coupling == (0.5, 2.0)
    assert ranges.total is not None


def test_a_measured_inertia_below_that_of_the_load_leaves_the_bench_unknown() -> None:
    coupling = CompliantCoupling(stiffness=1.0, load_inertia=3e-5)
    (axis,) = planned(told(inertia=2.5e-5), simulation=Mechanics(coupling=coupling)).axes
    assert "not above load_inertia of simulation.coupling" in axis.cap
    assert axis.plant is None


MOVED: dict[str, dict[str, Any]] = {
    "another adapter": {"interface": "slcan"}, "another channel": {"channel": "can1"},
    "a stated delay of the adapter": {"adapter_latency": 5e-5}, "none any more": {"adapter_latency": None},
}  # fmt: skip


def limit_on(section: CanSection, own: RigAxis, rate: float) -> float:
    return limit_of(compile_plan(load_scene("wall"), Rig({"b": section}, {"handle": own}, "r"), {"p": LOCKED}, rate))


@pytest.mark.parametrize("change", MOVED)
@pytest.mark.parametrize(("slow", "rate"), [(2.5e-4, 1000.0), (1e-3, 250.0)])
def test_a_delay_that_was_measured_with_another_adapter_never_raises_the_limit(
    change: str, slow: float, rate: float
) -> None:
    """The true bench keeps its slow adapter, whatever the rig says of it; the oracle knows its limit."""
    section = CanSection("socketcan", "can0", adapter_latency=slow)
    (planned_there,) = compile_plan(
        load_scene("wall"), Rig({"b": section}, {"handle": AXIS}, "r"), {"p": LOCKED}, rate
    ).axes
    delay = planned_there.delay.transport + planned_there.delay.torque_loop
    measured = replace(told(delay_and_lag=delay), planned_delay=delay, bus=section.route)
    own = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    moved = replace(section, **MOVED[change])
    limit, elsewhere = limit_on(section, own, rate), limit_on(moved, own, rate)
    true = oracle_limit(4e-5 / RATIO**2, 1e-4 / RATIO**2, delay - 1.6e-4, 1.6e-4, 1.0 / rate)
    assert 0.7 * true < limit < true
    assert elsewhere <= limit


def test_on_another_adapter_and_with_an_earlier_table_the_longest_delay_of_the_profile_counts() -> None:
    measured = expecting(told(), LOCKED)
    (here,) = planned(replace(measured, bus="socketcan:other"), LOCKED, bus="socketcan").axes
    times = measured_times(here.bench, LOCKED, here.delay, (1e-4, 3e-4))
    assert times is not None
    assert times.totals[1] == pytest.approx(here.delay.range[1] + 3e-4 + here.delay.lateness)
    earlier = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    assert bench_of(earlier, "socketcan").is_moved


def test_the_simulation_in_the_place_of_a_real_bus_has_its_measured_delay() -> None:
    measured = replace(expecting(told()), bus=CanSection("socketcan", "can0").route)
    own = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    section = StandInCanSection("haptic_sim", "sim")
    assert not known_bench(Rig({"b": section}, {"handle": own}), "handle", PROFILE).is_moved


# What does not count.


def test_what_was_measured_on_a_simulated_bus_does_not_count_on_a_real_one() -> None:
    measured = replace(told(), simulated=True)
    sealed = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    assert bench_of(sealed).basis is Basis.IDENTIFIED
    assert "measured on a simulated bus" in bench_of(sealed, "socketcan").fault
    stand_in = Rig({"b": StandInCanSection("haptic_sim", "sim")}, {"handle": sealed})
    assert "measured on a simulated bus" in known_bench(stand_in, "handle", PROFILE).fault
    forged = replace(sealed, identified=replace(sealed.identified, simulated=False))
    assert "was changed after the measurement" in bench_of(forged, "socketcan").fault


def test_what_was_measured_on_a_real_bus_counts_in_a_simulation() -> None:
    """As in `run --bus sim`; a table of an earlier version says nothing, and counts as of a real bus."""
    measured = told()
    sealed = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    assert [bench_of(sealed, bus).basis for bus in ("socketcan", "haptic_sim")] == [Basis.IDENTIFIED] * 2


def test_what_was_measured_on_another_axis_does_not_count() -> None:
    measured = replace(told(), axis="left")
    sealed = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    assert bench_of(sealed).fault == "the values of [identified] were measured on the axis left"
    renamed = replace(sealed, identified=replace(sealed.identified, axis="handle"))
    assert "was changed after the measurement" in bench_of(renamed).fault


@pytest.mark.parametrize("key", ["torque", "position"])
def test_what_was_measured_with_other_units_of_the_profile_does_not_count(key: str) -> None:
    """With a torque of a tenth the damping that was measured is ten times too large, and so would the limit be."""
    measured = replace(told(), units="permille_of_rated_torque, counts")
    sealed = replace(AXIS, identified=replace(measured, digest=digest_with(AXIS, measured)))
    assert bench_of(sealed).fault == ""
    profile = canopen("maxon_epos4")
    assert profile.position is not None
    corrected: dict[str, Any] = {
        "torque": replace(profile.torque, target=replace(profile.torque.target, unit="mA")),
        "position": replace(profile.position, actual=replace(profile.position.actual, unit="0.1 deg")),
    }
    rig = Rig({"b": CanSection("haptic_sim", "sim")}, {"handle": sealed})
    fault = known_bench(rig, "handle", replace(profile, **{key: corrected[key]})).fault
    assert fault.startswith(f"the profile {PROFILE.name} had the units {measured.units} at the measurement, and has ")


def test_an_earlier_table_counts_unless_two_axes_have_the_same() -> None:
    """It has no name of an axis; nobody knows which of both was measured."""
    sealed = replace(AXIS, identified=replace(told(), digest=digest_with(AXIS, told())))
    assert bench_of(sealed).fault == ""
    both = Rig({"b": CanSection("haptic_sim", "sim")}, {"handle": sealed, "right": replace(sealed, node=2)})
    assert known_bench(both, "handle", PROFILE).fault == "[identified] is that of the axis right too"
    assert known_bench(both, "right", PROFILE).fault == "[identified] is that of the axis handle too"


def test_the_digest_of_an_earlier_table_is_still_that_of_its_version() -> None:
    assert digest_with(AXIS, told()) == "67d985d470bf3975"
    assert not {"simulated", "bus"} & {each.split("=")[0] for each in str(Identified())[11:-1].split(", ")}


BAD: dict[str, tuple[dict[str, Any], str]] = {
    "another profile": ({"profile": "another"}, "were measured with the profile another"),
    "an elastic shaft": ({"resonance": 25.0}, "identify found a resonance of 25 Hz, and simulation.coupling states no"),
    "edited by hand": ({"digest": "0123"}, "was changed after the measurement"),
    "no interval": ({"inertia_interval": None}, "inertia of [identified] has no interval around it"),
    "interval swapped": ({"viscous_damping_interval": (2e-4, 5e-5)}, "viscous_damping of [identified] has no interval"),
    "interval elsewhere": (
        {"coulomb_friction_interval": (0.1, 0.2)},
        "coulomb_friction of [identified] has no interval",
    ),
    "not a number": ({"viscous_damping": math.nan}, "viscous_damping of [identified] has no interval"),
    "an endless interval": ({"viscous_damping_interval": (0.0, math.inf)}, "viscous_damping of [identified] has no"),
    "wrong sign": ({"viscous_damping": -1e-4, "viscous_damping_interval": (-2e-4, 0.0)}, "viscous_damping of [ident"),
    "delay without end": ({"delay_and_lag_interval": (0.0, math.nan)}, "delay_and_lag of [identified] has no interval"),
    "a rough inertia": ({"inertia_interval": (1e-5, 7e-5)}, "the inertia was measured too roughly"),
}


@pytest.mark.parametrize("attack", BAD)
def test_values_that_do_not_count_leave_the_bench_unknown_and_do_not_bring_back_the_stated_ones(attack: str) -> None:
    """The stated damping may be ten times too large: what contradicts itself is refused, and not guessed."""
    changes, why = BAD[attack]
    plan = planned(replace(told(), **changes), viscous_damping=1e-3)
    (axis,) = plan.axes
    assert (plan.stability, axis.plant, axis.bench.measured) == (None, None, None)
    assert axis.limits.effort == pytest.approx(0.05 * axis.rated_effort)
    assert why in axis.cap
    assert "no limit is known, because" in axis.cap


@pytest.mark.parametrize(
    "changes",
    [
        {"encoder_counts_per_revolution": 1024}, {"rated_torque": 0.8}, {"torque_constant": 0.1},
        {"rated_current": 4.0}, {"peak_current": 10.0}, {"mechanism": LinearMechanism("linear", 0.02)},
    ],
)  # fmt: skip
def test_an_axis_that_was_changed_after_the_measurement_is_another_bench(changes: dict[str, Any]) -> None:
    measured = told()
    sealed = replace(measured, digest=digest_with(AXIS, measured))
    assert bench_of(replace(AXIS, identified=sealed)).fault == ""
    changed = replace(AXIS, identified=sealed, **changes)
    assert "was changed after the measurement" in bench_of(changed).fault


@pytest.mark.parametrize("key", ["viscous_damping", "inertia_interval", "planned_delay", "serial", "rate", "date"])
def test_every_value_of_the_table_is_sealed(key: str) -> None:
    measured = replace(told(), planned_delay=5e-4, serial=7, rate=1000.0, date="today")
    sealed = replace(measured, digest=digest_with(AXIS, measured))
    value = getattr(sealed, key)
    other = (value[0], 1.01 * value[1]) if isinstance(value, tuple) else "now" if key == "date" else 1.01 * value
    changes: dict[str, Any] = {key: other}
    assert bench_of(replace(AXIS, identified=replace(sealed, **changes))).fault


def test_a_whole_number_in_the_file_is_the_same_value() -> None:
    measured = replace(told(), rate=1000.0)
    sealed = replace(measured, digest=digest_with(AXIS, measured))
    assert bench_of(replace(AXIS, identified=replace(sealed, rate=1000))).fault == ""


def test_a_stated_coupling_brings_back_the_stated_values_of_an_elastic_bench() -> None:
    elastic = Identified(resonance=25.0, date="today", digest="any")
    bench = bench_of(replace(AXIS, identified=elastic, simulation=Mechanics(CompliantCoupling(1.0, 1e-5))))
    assert bench == bench_of(AXIS)
    assert bench_of(replace(AXIS, identified=elastic)).inertia is None


def test_tables_that_were_sealed_before_there_was_a_resonance_still_count() -> None:
    assert digest_with(AXIS, told()) == digest_with(AXIS, replace(told(), resonance=25.0))
    assert "resonance" not in str(Identified())  # from which the digest of a note about a run is made


@pytest.mark.parametrize("attack", ["another profile", "an elastic shaft", "edited by hand", "a rough inertia"])
def test_a_run_names_what_does_not_count_and_the_way_out(attack: str) -> None:
    changes, why = BAD[attack]
    axis = replace(AXIS, bus="b", profile="maxon_epos4", identified=replace(told(), **changes))
    rig = Rig({"b": CanSection("haptic_sim", "sim")}, {"handle": axis})
    with pytest.raises(PlanError) as refused:
        select(Task("wall", rig))
    text = str(refused.value)
    assert why in text
    for part in ("axis handle", "haptic-fieldbus identify --rig FILE", "remove [axis.handle.identified]", "5 %"):
        assert part in text


@pytest.mark.parametrize(
    "attack", ["no interval", "interval swapped", "interval elsewhere", "not a number", "wrong sign"]
)
def test_a_table_that_no_measurement_writes_is_a_fault_of_the_file(attack: str) -> None:
    axis = replace(AXIS, bus="b", profile="maxon_epos4", identified=replace(told(), **BAD[attack][0]))
    with pytest.raises(RigError, match="identified"):
        select(Task("wall", Rig({"b": CanSection("haptic_sim", "sim")}, {"handle": axis})))


def test_another_drive_is_refused_and_one_without_a_number_is_not() -> None:
    bench = bench_of(replace(AXIS, identified=replace(told(), serial=0x1234)))
    check_measured_drive("handle", bench, Identity(serial=0x1234))
    check_measured_drive("handle", bench, Identity())
    check_measured_drive("handle", bench_of(AXIS), Identity(serial=9))
    with pytest.raises(PlanError, match=r"serial number 0x00001234, this drive has 0x00000009"):
        check_measured_drive("handle", bench, Identity(serial=9))


def test_what_was_measured_fills_what_the_rig_leaves_out() -> None:
    bare: RigAxis = replace(AXIS, inertia=None, viscous_damping=None, coulomb_friction=None, profile="maxon_epos4")
    rig = Rig({"b": CanSection("haptic_sim", "sim")}, {"handle": replace(bare, identified=told())})
    plan = select(Task("wall", rig)).plan
    assert plan.stability is not None
    assert plan.axes[0].cap == ""


def test_an_unmeasured_bench_has_no_line_of_measured_values() -> None:
    assert not [*measured_texts(bench_of(AXIS))]
    only = Identified(inertia=5e-5, inertia_interval=(4.9e-5, 5.1e-5))
    assert [*measured_texts(bench_of(replace(AXIS, identified=only)))] == [
        "inertia 5e-5 kg·m² ± 2 %; date unknown; without digest, so judged like stated values"
    ]
