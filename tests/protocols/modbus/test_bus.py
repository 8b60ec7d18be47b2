"""Names of Modbus buses, their sections in rigs, and what a rig leaves open."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.errors import PlanError, RigError, UsageError
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.protocols.canopen.bus import CanSection, StandInCanSection
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, StandInModbusSection, line_of, modbus_section, parse_bus
from haptic_fieldbus.protocols.modbus.protocol import PROTOCOL
from tests.protocols.modbus.lines import GENERIC, with_line

RIG = """\
[bus.line]
interface = "modbus-rtu"
channel = "/dev/ttyUSB0"
baud = 115200
silence = "0.2 ms"
round_trip = 0.0005

[bus.can0]
interface = "socketcan"
channel = "can0"

[axis.handle]
bus = "line"
node = 247
profile = "generic_cia402_modbus"
mechanism = { kind = "linear", metres_per_revolution = 0.05 }
encoder_counts_per_revolution = 4096
rated_torque = "0.4 N·m"
inertia = 4e-5
viscous_damping = 1e-4
coulomb_friction = 2e-3
"""


def rig(folder: Path, *replacements: tuple[str, str]) -> Path:
    text = RIG
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("text", "section"),
    [
        ("sim-modbus-tcp", ModbusSection("sim-modbus-tcp", "sim")),
        ("sim-modbus-rtu", ModbusSection("sim-modbus-rtu", "sim")),
        ("sim-modbus-rtu@115200", ModbusSection("sim-modbus-rtu", "sim", 115200)),
        ("modbus-tcp:10.0.0.2", ModbusSection("modbus-tcp", "10.0.0.2")),
        ("modbus-tcp:10.0.0.2:1502", ModbusSection("modbus-tcp", "10.0.0.2:1502")),
        ("modbus-rtu:/dev/ttyUSB0@9600", ModbusSection("modbus-rtu", "/dev/ttyUSB0", 9600)),
    ],
)
def test_a_name_is_parsed_and_written_again(text: str, section: ModbusSection) -> None:
    found = parse_bus(text)
    assert found.section == section
    assert found.simulated is text.startswith("sim")
    assert PROTOCOL.bus_name(section).text == text


@pytest.mark.parametrize(
    ("channel", "address"),
    [
        ("10.0.0.2", ("10.0.0.2", 502)),
        ("10.0.0.2:1502", ("10.0.0.2", 1502)),
        ("drive.local", ("drive.local", 502)),
        ("fe80::1", ("fe80::1", 502)),
        ("[fe80::1]:1502", ("fe80::1", 1502)),
        ("[fe80::1]", ("fe80::1", 502)),
    ],
)
def test_a_host_has_the_port_of_the_standard_unless_it_names_one(channel: str, address: tuple[str, int]) -> None:
    assert ModbusSection("modbus-tcp", channel).address == address


def test_a_host_may_be_late_by_what_the_rig_states() -> None:
    assert ModbusSection("sim-modbus-tcp", "sim").lateness == 0.0
    assert ModbusSection("sim-modbus-tcp", "sim", jitter=1e-4).lateness == 1e-4


def test_a_rig_file_holds_a_line_with_units(tmp_path: Path) -> None:
    section = modbus_section(load_rig(rig(tmp_path)).bus["line"])
    assert (section.baud, section.round_trip) == (115200, 0.0005)
    assert section.silence == pytest.approx(0.2e-3)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("node = 247", "node = 248", "axis.handle.node: 248; expected a whole number from 1 to 247"),
        ("node = 247", "node = 0", "from 1 to 247; 0 is broadcast: all units follow it, and none answers"),
        ("node = 247", "node = 255", "axis.handle.node: 255; expected a whole number from 1 to 247"),
        ("baud = 115200", "baud = 100", "bus.line.baud: 100"),
        ("baud = 115200", "bitrate = 115200", "bus.line.bitrate: unknown key"),
        ("baud = 115200", 'parity = "mark"', "bus.line.parity"),
    ],
)
def test_a_fault_of_a_line_is_told_with_its_key(tmp_path: Path, old: str, new: str, words: str) -> None:
    with pytest.raises(RigError) as refused:
        load_rig(rig(tmp_path, (old, new)))
    assert words in str(refused.value)


@pytest.mark.parametrize(("bus", "unit"), [("sim-modbus-tcp", 255), ("sim-modbus-tcp", 1), ("sim-modbus-rtu", 247)])
def test_a_device_on_tcp_may_be_asked_as_itself(bus: str, unit: int) -> None:
    assert check_request(bus=bus, node=unit).text == bus
    assert select(Task("wall", bus=bus, node=unit)).plan.axes[0].node == unit


@pytest.mark.parametrize(
    ("bus", "unit", "words"),
    [
        ("sim-modbus-tcp", 0, "0: a node-ID is .* or 255 for the device itself; 0 is broadcast"),
        ("sim-modbus-tcp", 254, "254: a node-ID is a whole number from 1 to 247, or 255 for the device itself"),
        ("sim-modbus-rtu", 255, "255: a node-ID is a whole number from 1 to 247$"),
    ],
)
def test_a_unit_that_nobody_can_be_is_refused(bus: str, unit: int, words: str) -> None:
    with pytest.raises(UsageError, match=words):
        check_request(bus=bus, node=unit)


def test_a_rig_is_simulated_on_a_line_of_its_own_kind(tmp_path: Path) -> None:
    path = rig(tmp_path)
    section = modbus_section(load(Task("wall", path, bus="sim")).rig.bus["line"])
    assert (section.interface, section.baud) == ("sim-modbus-rtu", 115200)
    assert section.silence == pytest.approx(0.2e-3)
    named = modbus_section(load(Task("wall", path, bus="sim-modbus-rtu@9600")).rig.bus["line"])
    assert (named.interface, named.baud) == ("sim-modbus-rtu", 9600)
    plan = select(Task("wall", path, bus="sim")).plan
    assert plan.axes[0].node == 247
    assert plan.rate > 200.0, "0.2 ms of silence instead of 1.75"


def test_a_line_and_a_can_bus_are_simulated_together(tmp_path: Path) -> None:
    text = rig(tmp_path).read_text(encoding="utf-8")
    axis = text[text.index("[axis.handle]") :].replace('"line"', '"can0"').replace("_modbus", "")
    second = axis.replace("axis.handle", "axis.right").replace("node = 247", "node = 5")
    path = rig(tmp_path, ("[axis.handle]", "[axis.left]"))
    path.write_text(path.read_text(encoding="utf-8") + second, encoding="utf-8")
    selection = select(Task("virtual_shaft", path, bus="sim"))
    assert {bus.protocol for bus in selection.plan.buses} == {"canopen", "modbus"}
    assert {type(section) for section in selection.plan.rig.bus.values()} == {StandInCanSection, StandInModbusSection}
    with pytest.raises(UsageError, match="is one bus, but the axes of"):
        load(Task("virtual_shaft", path, bus="modbus-tcp:10.0.0.1"))


def test_a_bus_of_another_protocol_cannot_take_its_place() -> None:
    section = ModbusSection("modbus-tcp", "10.0.0.2")
    from haptic_fieldbus.protocols.registry import parse_bus as parse

    with pytest.raises(UsageError, match='bus "socketcan:can0" is not a Modbus line'):
        PROTOCOL.in_place_of(section, parse("socketcan:can0"), None)
    with pytest.raises(TypeError, match="socketcan:can0 is not a Modbus line"):
        modbus_section(CanSection("socketcan", "can0"))


class TestLine:
    def test_what_the_rig_leaves_open_is_that_of_the_profile(self) -> None:
        section = ModbusSection("modbus-rtu", "/dev/ttyS0")
        assert line_of(section, [GENERIC]).octet == pytest.approx(11 / 115200)
        assert line_of(replace(section, parity="none"), [GENERIC]).octet == pytest.approx(10 / 115200)
        assert line_of(replace(section, baud=9600, stop_bits=2), [GENERIC]).octet == pytest.approx(12 / 9600)

    def test_the_slowest_drive_decides_the_silence(self) -> None:
        section = ModbusSection("modbus-rtu", "/dev/ttyS0")
        quick, slow = with_line(silence=1e-4), with_line(silence=5e-3)
        assert line_of(section, [quick]).silence == 1e-4
        assert line_of(section, [quick, slow]).silence == 5e-3
        assert line_of(section, [quick, GENERIC]).silence == 1.75e-3
        assert line_of(replace(section, silence=2e-3), [slow]).silence == 2e-3, "the rig knows better"

    def test_drives_that_differ_after_power_on_need_a_word_of_the_rig(self) -> None:
        section = ModbusSection("modbus-rtu", "/dev/ttyS0")
        with pytest.raises(PlanError, match=r"have different baud after power-on \(115200, 9600\); set it in the rig"):
            line_of(section, [GENERIC, with_line(baud=9600)])
        assert line_of(replace(section, baud=19200), [GENERIC, with_line(baud=9600)]).octet == pytest.approx(11 / 19200)
