"""Units found, watched and checked on real lines, by reading alone; what cannot be done is told."""

import os
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.buses.modbus.access import ACCESS, adapter_checks, opened
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.drive.rig import RigAxis, default_axis
from haptic_fieldbus.errors import BusError, BusTimeoutError, UsageError
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.bus import ModbusSection
from haptic_fieldbus.signals import Signal, Workspace
from tests.buses.modbus.benches import NAME, PROFILE, section_of
from tests.buses.modbus.servers import ERROR, FAULT, IDENTITY, SERIAL, STATUS, Drive, Server, rtu_server, tcp_server

Lines = Callable[..., AbstractContextManager[Server]]
LINES: dict[str, Lines] = {"tcp": tcp_server, "rtu": rtu_server}
LOOKS = 20
"""So many times a line is looked at, at most, until a look was not disturbed."""
BOTH = ("tcp", pytest.param("rtu", marks=pytest.mark.thorough("listens to the serial line first")))
AXIS = default_axis(Workspace.LINEAR, bus="bus", node=1, profile=NAME)
AXES: dict[str, RigAxis] = {"handle": AXIS}


@pytest.mark.parametrize("line", BOTH)
def test_only_the_units_that_are_named_are_asked_and_those_that_answer_are_found(line: str) -> None:
    with LINES[line](Drive(unit=1), Drive(unit=3)) as server:
        found = ACCESS.scan(section_of(server.name), AXES, None, [1, 2, 3] if line == "tcp" else [3])
        units = {frame[6 if line == "tcp" else 0] for frame in server.frames}
        assert units == ({1, 2, 3} if line == "tcp" else {3})
        assert [node.node for node in found.nodes] == ([1, 3] if line == "tcp" else [3])
        assert found.nodes[-1].profile == NAME
        assert found.nodes[-1].serial == 4711
        assert found.nodes[-1].power_state == "switch on disabled"
        assert "--node 1-8" in found.listened
        assert all(drive.written == [] for drive in server.drives.values())


def test_without_numbers_only_the_units_of_the_rig_are_asked() -> None:
    with tcp_server(Drive(), Drive(unit=2)) as server:
        assert [node.node for node in ACCESS.scan(section_of(server.name), AXES, None).nodes] == [1]
        assert {frame[6] for frame in server.frames} == {1}


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("tcp", "the power of the drive, the address, the port and the unit id"),
        pytest.param(
            "rtu",
            "the power of the drive, the wiring, the baud rate, the parity and the unit id",
            marks=pytest.mark.thorough("listens to the serial line first"),
        ),
    ],
)
def test_where_no_unit_answers_the_units_and_what_to_check_are_told(line: str, told: str) -> None:
    def sentences(server: Server, *units: int) -> list[str]:
        found = ACCESS.scan(section_of(server.name), AXES, None, units)
        return [sentence for row in found.rows() if row.label == "none" for sentence in row.note]

    with LINES[line](Drive(unit=3)) as server:
        assert sentences(server, 1, 2) == [f"no answer from unit 1, 2 on {server.name}: check {told}"]
        assert sentences(server, 3) == []


def test_a_unit_that_is_no_known_drive_is_found_all_the_same() -> None:
    with tcp_server(Drive()) as server:
        del server.drive.registers[STATUS]
        (node,) = ACCESS.scan(section_of(server.name), AXES, None).nodes
        assert (node.node, node.profile) == (1, None)
        assert node.sure is not None
        assert "no matching profile" in node.sure


def test_a_server_that_has_every_register_is_taken_for_no_drive() -> None:
    with tcp_server(Drive()) as server:
        server.drive.registers = dict.fromkeys(range(0x8000), 0) | server.drive.registers
        (node,) = ACCESS.scan(section_of(server.name), AXES, None).nodes
        assert (node.node, node.profile) == (1, None)
        assert NAME in (node.sure or "")
        assert "also other registers between them, as any server may have" in (node.sure or "")
        assert "use --drive PROFILE" in (node.sure or "")


@pytest.mark.parametrize("lacks", [SERIAL, IDENTITY])
def test_a_unit_without_serial_number_or_identity_is_found_all_the_same(lacks: int) -> None:
    with tcp_server(Drive()) as server:
        for address in (lacks, lacks + 1):
            del server.drive.registers[address]
        (node,) = ACCESS.scan(section_of(server.name), AXES, None).nodes
        assert (node.node, node.profile) == (1, NAME)
        assert (node.serial is None) is (lacks == SERIAL)


def test_a_profile_that_cannot_render_force_is_named_and_not_proposed(tmp_path: Path) -> None:
    text = Path(load_profile(NAME).source).read_text(encoding="utf-8")
    assert "usable" not in text.partition("[power]")[0]
    text = text.replace("[drive]\n", "[drive]\nusable = false\n").replace(
        "[sources]\n", '[sources]\n"drive.usable" = "a test"\n'
    )
    (tmp_path / "useless.toml").write_text(text, encoding="utf-8")
    with tcp_server(Drive()) as server:
        (node,) = ACCESS.scan(section_of(server.name), AXES, tmp_path).nodes
        assert node.profile == NAME
        assert "useless (cannot render force) would match too" in (node.sure or "")


def test_a_look_reads_what_the_drive_says_and_writes_nothing() -> None:
    with tcp_server(Drive()) as server, ACCESS.onlooker(section_of(server.name), AXES) as onlooker:
        server.drive.move_to(99)
        glimpse = onlooker.look()["handle"]
        assert glimpse.values[Signal.POSITION] == 99
        assert glimpse.error_code is None
        server.drive.registers |= {STATUS: FAULT, ERROR: 0x2310}
        assert onlooker.look()["handle"].error_code == 0x2310
        assert onlooker.masters == ""
        server.drives.clear()
        assert "does not answer" in onlooker.look()["handle"].note
        assert server.frames
        assert all(frame[7] == 3 for frame in server.frames)


@pytest.mark.thorough("listens to the serial line first")
def test_on_a_serial_line_that_somebody_uses_nothing_is_asked() -> None:
    with rtu_server(Drive()) as server:
        section = section_of(server.name)
        with ACCESS.onlooker(section, AXES) as onlooker:
            onlooker.look()
            asked = len(server.frames)
            server.put(bytes(5))
            while not onlooker.masters:
                asked = len(server.frames)
                glimpse = onlooker.look()["handle"]
            assert len(server.frames) == asked
            assert (glimpse.note, glimpse.values) == ("not asked", {})


def test_a_rated_torque_is_read() -> None:
    with tcp_server(Drive()) as server:
        assert ACCESS.rated_torque(section_of(server.name), "handle", AXIS) == 0.4
        assert server.drive.written == []
        assert ACCESS.rated_torque(section_of(server.name), "handle", replace(AXIS, profile="maxon_epos4")) is None


@pytest.mark.parametrize("line", BOTH)
def test_a_line_is_checked_by_its_round_trip(line: str) -> None:
    """On a host that stops a process for long, a look that it did not disturb is waited for."""
    with LINES[line](Drive()) as server:
        looks = (ACCESS.checks(section_of(server.name), AXES, 50.0) for _ in range(LOOKS))
        named = ({check.name: check for check in look} for look in looks)
        checks = next(look for look in named if look["round_trip"].ok)
        assert checks["adapter"].ok is True
        assert "unit 1" in checks["round_trip"].measured
        assert len(server.frames) >= 200, "as many as the percentiles of the round trip and of its jitter rest on"
        assert checks["other_masters"].ok is (True if line == "rtu" else None)
        server.drives.clear()
        silent = {check.name: check for check in ACCESS.checks(section_of(server.name), AXES, 50.0)}
        assert silent["round_trip"].ok is False
        assert "unit id" in silent["round_trip"].advice


@pytest.mark.parametrize(
    ("given", "silence"),
    [
        ({"baud": 9600, "parity": "even", "stop_bits": 1}, 3.5 * 11 / 9600),
        ({"baud": 115200, "parity": "even", "stop_bits": 1}, 1.75e-3),
        ({"silence": 0.004}, 0.004),
    ],
    ids=["3.5 characters", "1.75 ms above 19200 bit/s", "as the rig says"],
)
def test_frames_are_as_far_apart_as_the_standard_says_or_the_rig(given: dict[str, Any], silence: float) -> None:
    """Modbus over Serial Line V1.02, 2.5.1.1: 3.5 characters of 11 bits, and a fixed time above 19200 bit/s."""
    with rtu_server(Drive()) as server, opened(section_of(server.name, **given), [PROFILE]) as requester:
        assert requester.silence_ns == pytest.approx(1e9 * silence, rel=1e-3)


def test_a_unit_that_is_silent_is_asked_three_times() -> None:
    with tcp_server(Drive(), mischief=lambda frame, asked: iter(())) as server:
        with opened(section_of(server.name), [PROFILE]) as requester:
            unit = UnitClient(requester, 1, "unit 1", PROFILE.line)
            with pytest.raises(
                BusTimeoutError, match=r"unit 1 does not answer on .*: 3 requests to read .*, 0\.02 s each"
            ):
                unit.read(PROFILE.power.status, 0.02)
        assert len(server.frames) == 3
        with opened(section_of(server.name), [PROFILE]) as requester:
            unit = UnitClient(requester, 1, "unit 1", PROFILE.line)
            begun_ns = requester.clock.now_ns()
            with pytest.raises(BusTimeoutError, match=r"1 requests to read .*, 0\.3 s each"):
                unit.read(PROFILE.power.status, tries=1)
            assert requester.clock.now_ns() - begun_ns >= 300_000_000


def test_a_line_that_cannot_be_opened_is_a_check_that_fails() -> None:
    checks = {check.name: check for check in ACCESS.checks(ModbusSection("modbus-rtu", "/dev/no_such"), AXES, 50.0)}
    assert checks["adapter"].ok is False
    assert checks["serial_access"].ok is False
    assert checks["usb_latency_timer"].ok is None


def test_a_serial_port_of_somebody_else_and_a_slow_latency_timer_have_their_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = tmp_path / "bus" / "usb-serial" / "devices" / "ttyUSB0"
    port.mkdir(parents=True)
    (port / "latency_timer").write_text("16\n")
    (tmp_path / "ttyUSB0").touch()
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    section = ModbusSection("modbus-rtu", str(tmp_path / "ttyUSB0"))
    rights, timer = adapter_checks(section, tmp_path)
    assert (rights.ok, timer.ok) == (False, False)
    assert "dialout" in rights.advice
    assert "udev" in timer.advice


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_can_frames_cannot_be_recorded_of_a_modbus_line(suffix: str) -> None:
    with pytest.raises(UsageError, match=r"is for CAN frames\. For Modbus record one row per period"):
        ACCESS.logs(Path(f"run{suffix}"), ["bus"], simulated=True)
    with ACCESS.logs(Path("run.csv"), ["bus"], simulated=True) as logs:
        assert logs == {}


def test_a_dead_server_is_told_when_it_is_scanned() -> None:
    with tcp_server(Drive()) as server:
        name = server.name
    with pytest.raises(BusError, match="no server at this address"):
        ACCESS.scan(section_of(name), AXES, None)
