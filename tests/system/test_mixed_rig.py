"""One scene on two protocols: an axis on CANopen and one on Modbus, coupled, in one run."""

from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus.planning.explain import plan_json

AXIS = """
[axis.{name}]
bus = "{bus}"
node = 3
profile = "{profile}"
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
encoder_counts_per_revolution = 4096
rated_torque = "0.4 N·m"
inertia = "400 g·cm²"
viscous_damping = 1e-4
coulomb_friction = "2 mN·m"
"""
BUSES = """
[bus.line]
interface = "modbus-tcp"
channel = "192.168.0.10"
[bus.can0]
interface = "socketcan"
channel = "can0"
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    left = AXIS.format(name="left", bus="line", profile="generic_cia402_modbus")
    right = AXIS.format(name="right", bus="can0", profile="maxon_epos4")
    path.write_text(BUSES + left + right, encoding="utf-8")
    return path


def test_each_axis_has_the_traffic_and_the_delay_of_its_bus(rig: Path) -> None:
    """SYNC and TPDO take 0.19 ms, the answer of function 3 is there after 0.45 ms."""
    plan = haptic_fieldbus.plan("virtual_shaft", rig=rig, bus="sim")
    left, right = plan.axes
    assert plan.rate == 1000.0
    assert left.delay.transport == pytest.approx(0.5e-3)
    assert right.delay.bus == pytest.approx((135 + 92) * 1e-6 + 0.45e-3 - 0.19e-3)
    shown = plan_json(plan)
    assert shown["pdos"]
    assert shown["registers"]
    (ages,) = plan.coupling_ages
    assert ages.ages["left"]["left"] == pytest.approx(left.delay.total)


@pytest.mark.thorough("two drives for a second and a half")
def test_a_shaft_between_them_is_felt(rig: Path) -> None:
    settings = {"shaft.stiffness": "max/4"}
    result = haptic_fieldbus.run("virtual_shaft", rig=rig, bus="sim", duration=1.5, settings=settings)
    assert result.trips == ()
    assert (result.verdict or "").startswith("Feels right: ")
    assert result.torque_error is not None
