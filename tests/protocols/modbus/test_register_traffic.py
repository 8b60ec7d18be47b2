"""Requests of a unit in words and in JSON, and its faults in the terms of the standard."""

import json
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.explain import explain, plan_json
from haptic_fieldbus.planning.limits import position_steps
from haptic_fieldbus.protocols.canopen.traffic import PdoTraffic
from haptic_fieldbus.protocols.modbus.profile import Register
from haptic_fieldbus.protocols.modbus.protocol import PROTOCOL
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.signals import LinkFlag, Workspace
from tests.builders import PROFILE, WALL
from tests.protocols.modbus.lines import GENERIC, RTU, TCP, on, traffic_of, with_line


def test_the_lines_of_a_plan_tell_function_octets_time_and_registers() -> None:
    text = explain(on(RTU, 100.0)).splitlines()
    start = text.index("in, out    unit 1, function 23, 32 octets, 5.01 ms")
    assert text[start + 1 : start + 9] == [
        "             writes 2 from 0200h",
        "               register 0200h controlword",
        "               register 0201h target torque",
        "             reads 5 from 0100h",
        "               register 0100h statusword",
        "               register 0101h torque demand",
        "               register 0102h position",
        "               register 0104h torque actual",
    ]
    assert "bus        100 Hz by FC23 on Modbus RTU at 115200 bit/s, load 68 %" in text
    assert "ways       FC23 at 100 Hz, delay 10.2 ms: limit 102 N/m, chosen" in text
    assert "           FC3 then FC16 at 83 Hz, delay 6.34 ms: limit 122 N/m" in text


def test_a_command_that_stands_apart_is_told_as_what_takes_the_place_of_a_set_point() -> None:
    text = explain(on("sim-modbus-rtu", drive="simplex_motion"))
    assert "             in its place, when it changes\n             writes 1 from 018Fh\n" in text
    assert "             reads 4 from 00C7h, 1 of them read through\n" in text


def test_a_run_is_told_what_each_request_carries() -> None:
    assert list(traffic_of(on(TCP)).of("handle").summary()) == [
        "function 3 reads statusword, torque demand, position",
        "function 16 writes controlword, target torque",
    ]
    assert list(traffic_of(on(RTU)).of("handle").summary()) == [
        "function 23 writes controlword, target torque, reads statusword, torque demand, position, torque actual"
    ]


def test_json_has_a_row_for_each_request() -> None:
    plan = plan_json(on(TCP, 1000.0))
    read, write = json.loads(json.dumps(plan["registers"]))
    assert (plan["pdos"], read["function"], write["function"]) == (None, 3, 16)
    assert (read["unit"], read["octets"], read["write"], read["command"]) == (1, 29, None, None)
    assert read["time_s"] == pytest.approx(0.45e-3)
    assert read["read"] == {
        "address": 0x100,
        "count": 4,
        "read_through": 0,
        "mapped": ["register 0100h statusword", "register 0101h torque demand", "register 0102h position"],
    }
    assert write["write"]["mapped"] == ["register 0200h controlword", "register 0201h target torque"]
    first, second = json.loads(json.dumps(plan["ways"]))
    assert (first["exchange"], first["chosen"], second["exchange"], second["chosen"]) == (
        "FC3 then FC16", True, "FC23", False,
    )  # fmt: skip
    assert first["stiffness_limit"] > second["stiffness_limit"] > 0.0
    assert (first["rate_hz"], first["bus"]) == (1000.0, "sim-modbus-tcp")


def test_what_the_scene_does_not_need_is_left_out() -> None:
    assert [left.what for left in on(TCP).left_out][:2] == ["register 0106h velocity", "velocity"]
    assert not any("torque actual" in address or "error" in address for address in on(TCP).mapped)


def test_a_way_without_a_limit_is_told_with_its_delay_alone() -> None:
    axis = replace(default_axis(Workspace.LINEAR, bus="line", node=1, profile="drive"), inertia=None)
    plan = compile_plan(WALL, Rig({"line": parse_bus(TCP).section}, {"handle": axis}), {"drive": GENERIC}, None)
    assert "ways       FC3 then FC16 at 1000 Hz, delay 0.659 ms, chosen\n" in explain(plan)


@pytest.mark.thorough("8 cases of one rule", quick=4)
@pytest.mark.parametrize(
    ("flag", "code", "words"),
    [
        (LinkFlag.EXCEPTION, 2, "unit 1 refused a request with exception 2 (illegal data address)"),
        (LinkFlag.EXCEPTION, 6, "exception 6 (server device busy)"),
        (LinkFlag.EXCEPTION, 99, "exception 99 (not one of the standard)"),
        (LinkFlag.BUS_OFF, 0, "the line is dead"),
        (LinkFlag.FOREIGN, 0x201, "another master on the line writes register 0201h of unit 1"),
        (LinkFlag.EMERGENCY, 0x7500, "unit 1 reports the fault 7500h"),
        (LinkFlag.NO_SIGN_OF_LIFE, 0, "unit 1 does not answer"),
        (LinkFlag.NOT_OPERATIONAL, 0, "left its torque mode"),
    ],
)
def test_a_fault_is_told_in_the_terms_of_the_standard(flag: LinkFlag, code: int, words: str) -> None:
    assert words in traffic_of(on(TCP)).of("handle").fault_text(flag, code)


def test_every_fault_has_a_text() -> None:
    traffic = traffic_of(on(TCP)).of("handle")
    for flag in LinkFlag:
        if flag is not LinkFlag.STALE:
            assert traffic.fault_text(flag, 1)


def test_a_way_that_the_drive_does_not_have_has_no_requests() -> None:
    traffic = traffic_of(on(TCP)).of("handle")
    with pytest.raises(ValueError, match=r"unit 1 has no functions for Transaction\.READ_THEN_WRITE"):
        traffic.requested(Transaction.READ_THEN_WRITE, traffic_of(on(TCP)).wire, with_line(functions=(23,)).line)


def test_the_traffic_of_another_protocol_is_refused() -> None:
    section = parse_bus(TCP).section
    with pytest.raises(TypeError, match="expected registers, not PdoTraffic"):
        PROTOCOL.bus_traffic(section, {"handle": (GENERIC, PdoTraffic(1, (), ()))}, 1000.0, 0.0)
    with pytest.raises(UsageError, match="uses canopen; expected a Modbus drive"):
        PROTOCOL.power_table(PROFILE)


def test_a_position_in_micrometres_needs_a_motor_that_goes_straight() -> None:
    assert GENERIC.position is not None
    micrometres = replace(GENERIC.position, actual=Register(0x102, GENERIC.position.actual.type, "µm"))
    axis = default_axis(Workspace.ROTARY, bus="line", node=1, profile="drive")
    with pytest.raises(PlanError, match="reports its position in µm; the rig needs a linear mechanism"):
        position_steps(replace(GENERIC, position=micrometres), axis)
