"""Values read before anything is written, values written then, and values put back, on a real connection."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.drive.profile import DataType, Identity, PowerRow, PowerState
from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.errors import (
    BusConfigurationError,
    BusError,
    BusTimeoutError,
    DriveFaultError,
    ForeignMasterError,
    HapticFieldbusError,
)
from haptic_fieldbus.protocols.modbus.profile import IdentityRegister, ModbusProfile, Register, WrittenRegister
from tests.buses.modbus.benches import PROFILE, Bench, plan_of
from tests.buses.modbus.servers import (
    COMMAND,
    DISPLAY,
    ENABLED,
    ERROR,
    FAULT,
    IDENTITY,
    LIMIT,
    MODE,
    RATED,
    SERIAL,
    STATUS,
    TARGET,
    WATCHDOG,
    Drive,
    Server,
    rtu_server,
    tcp_server,
)


@pytest.fixture
def opened() -> Iterator[ExitStack]:
    with ExitStack() as stack:
        yield stack


@pytest.fixture(autouse=True)
def _state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


def bench_on(stack: ExitStack, drive: Drive, profile: ModbusProfile = PROFILE, **changes: Any) -> tuple[Bench, Server]:
    server = stack.enter_context(tcp_server(drive))
    return stack.enter_context(Bench(plan_of(server.name, profile, **changes))), server


REFUSED: dict[str, tuple[dict[int, int], type[HapticFieldbusError], str]] = {
    "fault": ({STATUS: FAULT, ERROR: 0x2310}, DriveFaultError, r"state fault, error code 2310h \(register 0105h"),
    "set-point": ({TARGET: 50}, ForeignMasterError, r"commanded by another master.*0201h.*\(target torque\) is 50"),
    "command": ({COMMAND: 0x0F}, ForeignMasterError, r"0200h.*\(command\) is 000Fh, which enables it"),
    "energised": ({STATUS: ENABLED}, ForeignMasterError, "shows the state operation enabled"),
    "another rating": ({RATED + 1: 800}, BusConfigurationError, r"rated torque is 0.8 N·m .*the rig has 0.4"),
    "low limit": ({LIMIT: 100}, BusConfigurationError, r"0203h.* is 100 ‰ of rated torque .*raise_max_torque"),
}
"""Registers of a drive that is refused, the error, and its words."""


@pytest.mark.parametrize("case", REFUSED)
def test_a_drive_that_must_not_be_touched_is_refused_in_a_sentence_and_nothing_is_written(
    opened: ExitStack, case: str
) -> None:
    registers, error, words = REFUSED[case]
    bench, server = bench_on(opened, Drive(), raise_max_torque=False)
    server.drive.registers |= registers
    with pytest.raises(error, match=words):
        bench.open()
    assert server.drive.written == []
    assert bench.bus.stop() is True


def test_another_model_is_refused(opened: ExitStack) -> None:
    model = IdentityRegister(IDENTITY, DataType.UINT32, name="vendor", values=(0x22, 0x23))
    bench, server = bench_on(opened, Drive(), replace(PROFILE, identity=(model,)))
    with pytest.raises(BusConfigurationError, match=r"vendor .* is 00000000h; .*expects 00000022h or 00000023h"):
        bench.open()
    assert server.drive.written == []


def test_a_unit_that_does_not_answer_is_told_with_what_to_do(opened: ExitStack) -> None:
    bench, _ = bench_on(opened, Drive(unit=9))
    with pytest.raises(BusTimeoutError, match=r"unit 1 \(axis handle\) does not answer on modbus-tcp.*unit id"):
        bench.open()


@pytest.mark.thorough("listens to the serial line first")
def test_an_adapter_that_gives_back_what_one_sends_is_noticed_and_can_be_declared(opened: ExitStack) -> None:
    server = opened.enter_context(rtu_server(Drive()))
    echoed: list[int] = []

    def echo(frame: bytes, asked: int) -> Iterator[bytes | float | None]:
        yield server.frames[-1]
        echoed.append(asked)
        yield frame

    server.mischief = echo
    with Bench(plan_of(server.name)) as bench, pytest.raises(BusError, match="set echo = true in its table"):
        bench.open()
    with Bench(plan_of(server.name, section={"echo": True})) as bench:
        server.drive.move_to(77)
        assert bench.open().enable().read()[5] == 77
        assert bench.bus.stop() is True
        # On a slow host an answer may come too late for its period; what the adapter gives back is never told.
        assert [each for each in bench.bus.warnings if "answered an earlier request" not in each] == []


def test_what_is_written_is_what_the_profile_asks_for_and_it_is_put_back(opened: ExitStack) -> None:
    special = WrittenRegister(0x0107, DataType.UINT16, value=5)
    bench, server = bench_on(opened, Drive(), replace(PROFILE, setup=(special,)), limits=Limits(effort=20.0))
    drive = server.drive
    drive.registers |= {WATCHDOG: 7}
    bench.open()
    limit = drive.value(LIMIT)
    assert limit == 397  # 20 N of 50.3 N that 0.4 N·m are at 0.05 m a revolution
    assert (drive.value(0x0107), drive.value(MODE), drive.value(DISPLAY)) == (5, 10, 10)
    assert drive.value(WATCHDOG) == round(1e3 * bench.plan.guards[0].seconds)
    assert drive.value(TARGET) == 0
    (told,) = bench.bus.facts["handle"].changes
    assert "is lowered from 100 % to 40 % of rated torque until the end" in told
    assert bench.bus.stop() is True
    assert (drive.value(WATCHDOG), drive.value(LIMIT)) == (7, 1000)
    assert bench.bus.warnings == []


def test_a_limit_in_another_unit_than_the_set_point_is_that_of_the_axis(opened: ExitStack) -> None:
    """A motor of 0.4 N·m at 5 cm a revolution gives 50.3 N, so 20 N are 0.159 N·m, in mN·m 159."""
    torque = replace(PROFILE.torque, limit=Register(LIMIT, DataType.UINT16, unit="mN·m"))
    bench, server = bench_on(opened, Drive(), replace(PROFILE, torque=torque), limits=Limits(effort=20.0))
    bench.open()
    assert server.drive.value(LIMIT) == 159


def test_facts_are_those_that_the_drive_tells(opened: ExitStack) -> None:
    drive = Drive()
    drive.registers |= {IDENTITY + 1: 0x22, IDENTITY + 3: 0x33, IDENTITY + 5: 2}
    bench, _ = bench_on(opened, drive)
    bench.open()
    facts = bench.bus.facts["handle"]
    assert (facts.node, facts.identity) == (1, Identity(0x22, 0x33, 2, 4711))
    assert facts.rated_torque == 0.4
    assert "within" in facts.link_loss
    assert "cannot be received on TCP" in facts.listened


@pytest.mark.parametrize(
    ("registers", "serial", "known"),
    [
        ({SERIAL + 1: 0}, PROFILE.serial, None),
        ({SERIAL: 0xFFFF, SERIAL + 1: 0xFFFF}, PROFILE.serial, None),
        ({SERIAL + 1: 0xFFFF}, PROFILE.serial, 0xFFFF),
        ({SERIAL + 1: 0xFFFF}, Register(SERIAL + 1, DataType.UINT16), None),
        ({}, None, None),
    ],
    ids=["zero", "all ones", "16 bits set of 32", "all ones of 16 bits", "no register"],
)
def test_a_serial_number_that_was_never_given_is_unknown_and_nothing_is_noted(
    opened: ExitStack, tmp_path: Path, registers: dict[int, int], serial: Register | None, known: int | None
) -> None:
    drive = Drive()
    drive.registers |= registers
    bench, _ = bench_on(opened, drive, replace(PROFILE, serial=serial), limits=Limits(effort=20.0))
    bench.open()
    assert bench.bus.facts["handle"].identity.serial == known
    assert bool(list(tmp_path.rglob("*.json"))) is (known is not None)
    assert any("has no serial number" in each for each in bench.bus.warnings) is (known is None)


STUCK = {"watchdog": WATCHDOG, "limit": LIMIT, "mode": MODE}


@pytest.mark.parametrize("what", STUCK)
def test_a_register_that_keeps_another_value_ends_the_set_up(opened: ExitStack, what: str) -> None:
    class Stubborn(Drive):
        def write(self, address: int, value: int) -> None:
            self.written.append((address, value))
            if address != STUCK[what]:
                super().write(address, value)

    bench, server = bench_on(opened, Stubborn(), limits=Limits(effort=20.0))
    server.drive.registers[LIMIT] = 100
    with pytest.raises(BusConfigurationError, match=f"register {STUCK[what]:04X}h.*, read back"):
        bench.open()
    assert server.drive.value(STATUS) != ENABLED


def test_a_mode_that_is_not_shown_is_waited_for_and_told(opened: ExitStack) -> None:
    profile = replace(PROFILE, timing=replace(PROFILE.timing, mode_change_timeout=0.02))

    class Unwilling(Drive):
        def write(self, address: int, value: int) -> None:
            super().write(address, value)
            self.registers[DISPLAY] = 3

    bench, _ = bench_on(opened, Unwilling(), profile)
    with pytest.raises(BusConfigurationError, match=r"did not accept mode 10: register 030Ah .* is 3 \(waited"):
        bench.open()


def test_somebody_who_commands_after_the_look_is_refused_before_anything_is_written(opened: ExitStack) -> None:
    bench, server = bench_on(opened, Drive())
    bench.bus.inspect(bench.plan, bytearray(bench.plan.image.input_size))
    server.drive.registers[TARGET] = 3
    with pytest.raises(ForeignMasterError, match="Nothing was written"):
        bench.bus.configure(bench.plan)
    assert server.drive.written == []


def test_octets_on_a_serial_line_that_nobody_asked_for_are_somebody_else(opened: ExitStack) -> None:
    server = opened.enter_context(rtu_server(Drive()))
    bench = opened.enter_context(Bench(plan_of(server.name)))
    server.put(bytes(8))
    with pytest.raises(ForeignMasterError, match=r"received 8 octets within 0.5 s .* Nothing was sent"):
        bench.open()
    assert server.frames == []


def test_a_drive_without_a_watchdog_needs_an_emergency_stop_and_is_told(opened: ExitStack) -> None:
    bench, _ = bench_on(opened, Drive(), replace(PROFILE, watchdog=None), emergency_stop="power")
    bench.open()
    assert bench.bus.facts["handle"].link_loss.startswith("on link loss the motor keeps its torque until")


def test_the_fault_of_a_lost_master_is_cleared_and_another_one_is_not(opened: ExitStack) -> None:
    watchdog = replace(PROFILE.watchdog, fault=0x8130) if PROFILE.watchdog else None
    bench, server = bench_on(opened, Drive(), replace(PROFILE, watchdog=watchdog))
    bench.open().enable()
    assert bench.bus.stop()
    server.drive.registers |= {STATUS: FAULT, ERROR: 0x2310}
    with pytest.raises(DriveFaultError, match=r"error code 2310h\. Nothing was cleared"):
        bench.bus.acknowledge()
    server.drive.registers[ERROR] = 0x8130
    bench.bus.acknowledge()
    assert server.drive.value(STATUS) == 0x40
    bench.bus.acknowledge()


def test_a_drive_with_a_table_of_its_own_is_cleared_by_the_command_that_its_profile_names(opened: ExitStack) -> None:
    rows = (
        PowerRow(0xFFFF, FAULT, PowerState.FAULT, 0),
        PowerRow(0xFFFF, 0x40, PowerState.SWITCH_ON_DISABLED, 0x0F),
        PowerRow(0xFFFF, ENABLED, PowerState.OPERATION_ENABLED, 0x0F),
    )
    own = replace(PROFILE, power=replace(PROFILE.power, table="rows", rows=rows))
    bench, server = bench_on(opened, Drive(), own)
    bench.open()
    server.drive.registers[STATUS] = FAULT
    with pytest.raises(DriveFaultError, match=r"has no command that resets it \(power\.reset of its profile\)"):
        bench.bus.acknowledge()
    known, server = bench_on(opened, Drive(), replace(own, power=replace(own.power, reset=0x80)))
    known.open()
    server.drive.registers[STATUS] = FAULT
    known.bus.acknowledge()
    assert server.drive.value(STATUS) == 0x40


def test_a_statusword_is_asked_for_beside_the_exchange(opened: ExitStack) -> None:
    bench, server = bench_on(opened, Drive())
    bench.open()
    writes = len(server.drive.written)
    assert bench.bus.ask("handle") == 0x40
    assert len(server.drive.written) == writes
    server.drives.clear()
    assert bench.bus.ask("handle") is None


def test_a_limit_that_the_drives_register_cannot_hold_is_refused_and_nothing_is_written(opened: ExitStack) -> None:
    """20 N are 0.159 N·m, in µN·m 159155, and 16 bits hold 65535."""
    torque = replace(PROFILE.torque, limit=Register(LIMIT, DataType.UINT16, unit="µN·m"))
    bench, server = bench_on(opened, Drive(), replace(PROFILE, torque=torque), limits=Limits(effort=20.0))
    with pytest.raises(BusConfigurationError, match=r"cannot exceed 65535, but the limit of the axis"):
        bench.open()
    assert server.drive.written == []
