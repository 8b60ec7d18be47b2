"""A scene on a simulated bench that is not rigid, from the rig file to the report."""

from pathlib import Path

import pytest

from haptic_fieldbus.api import run

RIG = """\
[bus.can0]
interface = "socketcan"
channel = "can0"
[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
limits = { speed = 10.0 }
mechanism = { kind = "linear", metres_per_revolution = 0.05 }
"""
LOADED = """\
[axis.handle.simulation]
coupling = { stiffness = 20.0, load_inertia = 1.0e-5, damping = 1.0e-3, backlash = 0.01 }
gravity = { torque = -4.0e-3 }
cogging = { torque = 2.0e-3, periods_per_revolution = 14 }
stribeck = { torque = 1.0e-3, velocity = 0.5 }
"""


def error(folder: Path, text: str) -> float:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    result = run("wall", rig=path, bus="sim", duration=1.5)
    assert result.torque_error is not None
    return result.torque_error.rms


@pytest.mark.thorough("a run on a bench with a load")
def test_a_wall_is_rendered_on_a_loaded_bench_and_the_report_knows_how_far_it_is_off(tmp_path: Path) -> None:
    assert 0.0 < error(tmp_path, RIG + LOADED) < 1.0


@pytest.mark.thorough("renders the same twice")
def test_the_same_bench_and_seed_give_the_same_motion(tmp_path: Path) -> None:
    assert error(tmp_path, RIG + LOADED) == error(tmp_path, RIG + LOADED) != pytest.approx(error(tmp_path, RIG))
