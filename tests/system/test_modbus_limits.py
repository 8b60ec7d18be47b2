"""The stiffness limit of a plan and the simulated Modbus line agree: just below it a swing decays, just above it grows.

The envelope of a free oscillation changes by the spectral radius of the predicted loop each period. The prediction has
the delay of the plan; the simulated drive knows nothing of it, it has registers and a line with characters.
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.system.test_run import LINEAR

TCP, RTU = ModbusSection("sim-modbus-tcp", "sim"), ModbusSection("sim-modbus-rtu", "sim", 115200)
FORCE = 6.0
"""At which the free swing begins [N]: many steps of the torque, and less than the motor has."""
PROFILE = Path("profiles/generic_cia402_modbus.toml")


def bilateral(stiffness: float) -> Scene:
    """A spring about a place beside the start."""
    wall = Wall("handle", stiffness, position=FORCE / stiffness, sides="bilateral")
    return Scene("spring", "for tests", LINEAR, (wall,))


def bench(section: ModbusSection, profile: str) -> Rig:
    """The shipped bench without Coulomb friction, with a fine encoder, and limits out of the way."""
    axis = default_axis(Workspace.LINEAR, bus="bus", node=1, profile=profile)
    fine = {"coulomb_friction": 0.0, "encoder_counts_per_revolution": 400_000, "limits": Limits(speed=100.0)}
    return Rig({"bus": section}, {"handle": replace(axis, **fine)})  # type: ignore[arg-type]


def stability_of(scene: Scene, rig: Rig) -> Stability:
    found = plan(scene, rig).stability
    assert found is not None
    return found


@pytest.fixture
def only_23(tmp_path: Path) -> str:
    """A drive that writes several registers by function 23 alone."""
    text = PROFILE.read_text(encoding="utf-8").replace("functions = [3, 4, 6, 16, 23]", "functions = [3, 4, 6, 23]")
    path = tmp_path / "only_23.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


@pytest.mark.thorough("long runs, four a way", quick=("1.1-rtu, 23",))
@pytest.mark.parametrize(
    ("section", "alone", "words"),
    [(TCP, False, "FC3 then FC16"), (TCP, True, "FC23"), (RTU, False, "FC23")],
    ids=["tcp, 3 then 16", "tcp, 23", "rtu, 23"],
)
@pytest.mark.parametrize("factor", [0.9, 0.97, 1.03, 1.1])
def test_a_swing_decays_below_the_limit_and_grows_above_it_at_the_predicted_rate(
    factor: float, section: ModbusSection, alone: bool, words: str, only_23: str
) -> None:
    rig = bench(section, only_23 if alone else "generic_cia402_modbus")
    compiled = plan(bilateral(50.0), rig)
    assert words in compiled.buses[0].traffic.line()
    limit = stability_of(bilateral(50.0), rig).stiffness_limit.stable
    assert limit is not None
    scene = bilateral(factor * limit)
    predicted = math.log(stability_of(scene, rig).spectral_radius)
    # From a second on, when all force is permitted, for as long as a change by a fifth takes.
    duration = 2.0 + 0.2 / abs(predicted) / compiled.rate
    trace = run(scene, rig, hand="none", duration=duration, force=True).traces[0]
    rate = growth(trace.times, trace.position - FORCE / (factor * limit), begin=1.0) / compiled.rate
    assert (rate > 0.0) is (factor > 1.0)
    assert rate == pytest.approx(predicted, rel=0.05, abs=2e-5)


def growth(times: NDArray[np.float64], swing: NDArray[np.float64], begin: float) -> float:
    """The slope of the logarithm of the peaks [1/s]; a peak is that of the parabola through three samples."""
    size = np.abs(swing)
    before, at, after = size[:-2], size[1:-1], size[2:]
    peaks = (at > before) & (at >= after) & (times[1:-1] > begin)
    heights = at - (after - before) ** 2 / (8.0 * (after - 2.0 * at + before))
    return float(np.polyfit(times[1:-1][peaks], np.log(heights[peaks]), 1)[0])


@pytest.mark.thorough("leaves four drives alone", quick=1)
@pytest.mark.parametrize("rate", [1000.0, 500.0, 100.0, 50.0])
def test_a_guard_that_a_write_in_the_next_request_feeds_is_proved_with_a_period_to_spare(
    rate: float, only_23: str
) -> None:
    """The last write reaches the drive a period late, and a computer that is a little late is still told from it."""
    (proof,) = run("damper", drive=only_23, bus="sim-modbus-tcp", rate=rate, duration=0.02, prove=True).proofs
    assert proof.holds
    assert proof.off is not None
    assert proof.off > proof.guard + 1.5 / rate, "the worst case is met"
    assert proof.allowed - proof.off > 1.0 / rate
