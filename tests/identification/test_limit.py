"""The limit of a plan that rests on a fit is below the true one, which is computed from the true bench."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.api.identification import identified_of
from haptic_fieldbus.drive.rig import Identified, LinearMechanism, Rig, default_axis
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.known_bench import digest_with
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import scene_of
from tests.identification.benches import Bench, drawn_bench, identified_bench
from tests.planning.test_known_bench import oracle_limit

PROFILE = load_profile("maxon_epos4")
LOCKED = replace(PROFILE, timing=replace(PROFILE.timing, control_tick="sync"))
SHAFT = LinearMechanism("linear", 2.0 * math.pi)
"""The handle goes by one metre for each radian, so that the workspace is the shaft."""


def limit_after(bench: Bench, measured: Identified, factor: float, rate: float) -> float:
    """Return the limit at a rate [N·m/rad] on the bench, whose rig states `factor` times its damping."""
    true = bench.model
    axis = replace(
        default_axis(Workspace.LINEAR, bus="b", node=1, profile="p"), mechanism=SHAFT, rated_torque=4.0 * bench.effort,
        inertia=true.inertia, viscous_damping=factor * true.damping, coulomb_friction=true.coulomb,
        encoder_counts_per_revolution=bench.counts,
    )  # fmt: skip

    def limit_with(planned: float | None, rate: float) -> tuple[float, float]:
        section = CanSection("haptic_sim", "sim")
        identified = replace(measured, digest=None, planned_delay=planned, bus=section.route)
        own = replace(axis, identified=replace(identified, digest=digest_with(axis, identified)))
        rig = Rig({"b": section}, {"handle": own}, "rig.toml")
        plan = compile_plan(scene_of(Wall("handle", 1.0)), rig, {"p": LOCKED}, rate)
        (found,) = plan.axes
        assert found.stability is not None
        return found.stability.limit.value, found.delay.transport + found.delay.torque_loop

    return limit_with(limit_with(None, bench.rate)[1], rate)[0]


@pytest.mark.thorough("measures 12 drawn benches", quick=1)
@pytest.mark.parametrize("seed", range(12))
def test_the_limit_after_a_fit_is_below_the_true_one_at_its_rate_and_at_another(seed: int) -> None:
    bench = drawn_bench(seed)
    fit, _, _ = identified_bench(bench)
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile="p")
    measured = identified_of(fit, axis, profile=PROFILE.name, rate=bench.rate)
    true = bench.model
    damping = fit.values["viscous_damping"]
    spread = 2.0 * damping.half_width / damping.value
    for rate in (bench.rate, 0.5 * bench.rate):
        expected = oracle_limit(true.inertia, true.damping, true.delay, true.lag, 1.0 / rate)
        found = limit_after(bench, measured, 3.0, rate)
        # The wider the interval of the damping, the lower the limit.
        assert (0.9 - spread) * expected <= found <= expected
