"""Whole runs on simulated Modbus lines: what the first user sees, several drives, and two protocols in one rig."""

import json
import math
import re
import subprocess
import sys

import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.drive.rig import Rig, RigAxis, default_axis
from haptic_fieldbus.errors import UnstableSceneError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.signals import Workspace
from tests.sim.modbus.test_shipped_drives import usable

TCP, RTU = "sim-modbus-tcp", "sim-modbus-rtu@115200"
HALF = {"wall.stiffness": "max/2"}


def axis(bus: str, node: int, profile: str = "generic_cia402_modbus") -> RigAxis:
    return default_axis(Workspace.LINEAR, bus=bus, node=node, profile=profile)


@pytest.mark.thorough("whole runs", quick=1)
@pytest.mark.parametrize(
    ("bus", "hand", "feels"),
    [(TCP, "push", "Feels right: "), (RTU, "tap", "Feels different: ")],
)
def test_half_the_limit_is_rendered_as_a_wall(bus: str, hand: str, feels: str) -> None:
    """A serial line is 10.7 ms late: a wall of the right shape that a hand feels as another one."""
    result = run("wall", bus=bus, settings=HALF, hand=hand, duration=2.0)
    assert (result.trips, result.missed_cycles) == ((), 0)
    assert result.torque_error is not None
    assert result.verdict is not None
    assert result.verdict.startswith(feels)
    if bus == RTU:
        told = re.search(r"([\d.]+) % without the delay of 10\.7 ms, which added ([\d.]+) mJ", result.verdict)
        assert told is not None
        assert float(told[1]) < 8.0
        assert 1e-3 * float(told[2]) == pytest.approx(result.energy_generated, rel=5e-3)
    assert math.fsum(result.torque_error.by_source.values()) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.thorough("every shipped Modbus drive")
@pytest.mark.parametrize("drive", usable())
def test_every_shipped_drive_renders_a_wall(drive: str) -> None:
    """Drives without a watchdog give at most a twentieth of their torque, so nobody pushes them here."""
    result = run("wall", drive=drive, bus=RTU, settings=HALF, hand="none", duration=1.0)
    assert (result.trips, result.missed_cycles) == ((), 0)
    assert result.warnings == ()


def test_the_walls_stiffness_of_the_library_is_refused_where_it_is_unstable() -> None:
    with pytest.raises(UnstableSceneError, match="600 N/m exceeds the limit") as refused:
        run("wall", bus=RTU)
    found = plan("wall", bus=RTU, settings=HALF).stability
    assert found is not None
    assert refused.value.limit == found.limit.value
    assert "--set wall.stiffness=" in str(refused.value)


@pytest.mark.thorough("runs on two buses")
def test_json_has_every_key_that_it_has_on_can() -> None:
    told = [run("wall", duration=0.1, bus=bus, settings=HALF).to_json() for bus in ("sim", TCP)]
    assert told[0].keys() == told[1].keys()
    assert json.dumps(told[1])


@pytest.mark.thorough("a line with two drives")
@pytest.mark.parametrize(
    ("section", "stiffness"),
    [(ModbusSection("sim-modbus-tcp", "sim"), 150.0), (ModbusSection("sim-modbus-rtu", "sim", 115200), 10.0)],
)
def test_two_drives_take_turns_on_one_line(section: ModbusSection, stiffness: float) -> None:
    rig = Rig({"line": section}, {"left": axis("line", 3), "right": axis("line", 4)})
    alone = plan("wall", Rig({"line": section}, {"handle": axis("line", 3)}), settings=HALF)
    settings = {"shaft.stiffness": stiffness, "wall.stiffness": stiffness}
    result = run("virtual_shaft", rig, settings=settings, hand="none", duration=1.0)
    assert result.trips == ()
    assert result.rate is not None
    assert result.rate <= alone.rate
    assert [trace.axis for trace in result.traces] == ["left", "right"]


@pytest.mark.thorough("a rig of two protocols")
def test_axes_on_canopen_and_on_modbus_stand_in_one_rig() -> None:
    rig = Rig(
        {"can": CanSection("haptic_sim", "sim"), "line": ModbusSection("sim-modbus-tcp", "sim")},
        {"left": axis("can", 1, "generic_cia402"), "right": axis("line", 1)},
    )
    result = run("virtual_shaft", rig, settings={"shaft.stiffness": "max/2"}, hand="tap", duration=1.0)
    assert result.trips == ()
    assert result.torque_error is not None


@pytest.mark.thorough("two runs")
def test_a_late_host_is_drawn_from_the_seed() -> None:
    section = ModbusSection("sim-modbus-tcp", "sim", jitter=2e-4)
    rig = Rig({"line": section}, {"handle": axis("line", 1)})
    runs = [run("wall", rig, settings=HALF, duration=0.5, seed=seed) for seed in (1, 1, 2)]
    lateness = [result.timing.lateness_us.max for result in runs if result.timing and result.timing.lateness_us]
    assert lateness[0] == lateness[1] != lateness[2]
    assert 0.0 < lateness[0] <= 200.0


@pytest.mark.thorough("a process of its own")
@pytest.mark.parametrize(
    ("bus", "without"), [("sim", ("pymodbus", "serial", "modbus")), (TCP, ("can", "canopen", "canopen"))]
)
def test_a_wall_imports_nothing_of_the_other_protocol(bus: str, without: tuple[str, str, str]) -> None:
    *packages, protocol = without
    code = (
        "import sys, haptic_fieldbus as h\n"
        f"h.run('wall', bus={bus!r}, settings={HALF!r}, duration=0.05)\n"
        f"rooms = [m for m in sys.modules if m.startswith('haptic_fieldbus.') and '.{protocol}' in m]\n"
        f"print(rooms + [m for m in {packages!r} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
