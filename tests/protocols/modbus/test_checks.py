"""Faults of a Modbus profile that its schema cannot state: each with its key and line, all at once."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import FULL_SCALE, Rig, RotaryMechanism, default_axis, steps_per_revolution, torque_step
from haptic_fieldbus.errors import PlanError, ProfileError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import scene_of, shipped
from tests.protocols.modbus.lines import on, traffic_of

GENERIC = (profile_folder() / "generic_cia402_modbus.toml").read_text(encoding="utf-8")


UNIT = 'unit = "full_scale/32767"'


def faults_of(folder: Path, *replacements: tuple[str, str]) -> list[str]:
    """All faults of the generic profile after replacements."""
    text = GENERIC
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new)
    path = folder / "own.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ProfileError) as refused:
        load_profile(path)
    return [str(fault) for fault in refused.value.faults]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("address = 0x0101", "address = 0x0102", "position.actual.address: 0x0102 is already used by torque.demand"),
        ("address = 0x0104", "address = 0x0103", "position.actual.address: 0x0102 is already used by torque.actual"),
        ("address = 0x0201", "address = 0x0200", "torque.target.address: 0x0200 is already used by power.command"),
        ("address = 0x0102, ", "address = 0xFFFF, ", "the last address is 0xFFFF"),
        ('0x0201, type = "int16"', '0x0201, type = "uint16"', 'expected "int16" or "int32"'),
        ('address = 0x0100, type = "uint16"', 'address = 0x0100, type = "uint8"', 'expected "uint16" or "uint32"'),
        ('unit = "counts",', 'unit = "turns",', 'expected "counts" or "0.1 deg" or "µm"'),
        ('unit = "ms"', 'unit = "h"', 'watchdog.time.unit: "h"; expected "ms" or "s"'),
        ('"permille_of_rated_torque", object = 0x6071', '"full_scale/32767"', "torque.full_scale: missing"),
        ("functions = [3, 4, 6, 16, 23]", "functions = [6, 16]", "4 or 23 among them: otherwise nothing can be read"),
        ("functions = [3, 4, 6, 16, 23]", "functions = [3]", "6, 16 or 23 among them"),
        ('transports = ["rtu", "tcp"]', 'transports = ["tcp"]', "line.baud: no effect"),
        ("[[0x0100, 0x0107]", "[[0x0107, 0x0100]", "the first address before the last one"),
        ('echo = "demand"', 'echo = "actual"\n#', "line 27: torque.actual"),
        ('table = "cia402"', 'table = "rows"', "power.rows: missing"),
        ('table = "cia402"', 'rows = [{ mask = 1, bits = 1, state = "fault", controlword = 0 }]', "no effect"),
        ('table = "cia402"', 'table = "cia402"\nreset = 1', "power.reset: no effect"),
        ('evidence = "standard"', 'evidence = "standard"\nusable = false', "drive.usable: false without a reason"),
        ("[position]", "[places]", "position: missing, like [velocity]"),
        ("value = 10 ", "value = 40000 ", "mode.value: 40000; expected -32768 to 32767, which fit into int16"),
        (
            "[sources]",
            '[[setup]]\naddress = 0x0401\ntype = "uint16"\nvalue = 70000\n[sources]',
            "setup[0].value: 70000; expected 0 to 65535, which fit into uint16",
        ),
        (
            "deadline = 0.05",
            'deadline = 40.0\nwrites = [{ address = 0x0400, type = "int16", value = 40000 }]',
            "watchdog.writes[0].value: 40000; expected -32768 to 32767",
        ),
        ("functions = [3, 4, 6, 16, 23]", "functions = [[3], { a = 1 }]", "line.functions[0]: "),
        ('echo = "demand"', 'echo = ["demand"]', "torque.echo: "),
        ('echo = "demand"', "echo = { a = 1 }", "torque.echo: "),
    ],
)  # fmt: skip
def test_a_fault_is_told_with_its_key(old: str, new: str, words: str, tmp_path: Path) -> None:
    replacements = [(old, new)]
    if words == "line 27: torque.actual":
        replacements.append(("actual = { address = 0x0104", "#"))
        words = '"actual" without torque.actual'
    if "[places]" in new:
        replacements.append(("[velocity]", "[speed]"))
    assert any(words in fault for fault in faults_of(tmp_path, *replacements)), faults_of(tmp_path, *replacements)


def test_a_wide_register_overlaps_what_follows_it(tmp_path: Path) -> None:
    (fault,) = faults_of(
        tmp_path, ('demand = { address = 0x0101, type = "int16"', 'demand = { address = 0x0101, type = "int32"')
    )
    assert "position.actual.address: 0x0102 is already used by torque.demand; expected another register" in fault


def test_a_target_of_two_registers_needs_a_function_that_writes_two(tmp_path: Path) -> None:
    (fault,) = faults_of(
        tmp_path,
        ("functions = [3, 4, 6, 16, 23]", "functions = [3, 6]"),
        ('target = { address = 0x0201, type = "int16"', 'target = { address = 0x0210, type = "int32"'),
    )
    assert "16 or 23 among them: otherwise no target torque can be written" in fault


def test_a_list_of_registers_needs_a_source_too(tmp_path: Path) -> None:
    (fault,) = faults_of(tmp_path, ('"identity" = "own table', '"serial.unit" = "own table'))
    assert fault.endswith('identity: no source; expected an entry "identity" in [sources]')


def test_all_faults_are_told_at_once(tmp_path: Path) -> None:
    faults = faults_of(tmp_path, ('unit = "ms"', 'unit = "h"'), ("functions = [3, 4, 6, 16, 23]", "functions = [5]"))
    assert [fault.partition(": ")[2].partition(":")[0] for fault in faults] == ["line.functions", "watchdog.time.unit"]


@pytest.mark.parametrize("name", shipped("modbus"))
def test_a_shipped_profile_is_planned_on_its_simulated_line_or_says_why_not(name: str) -> None:
    profile = load_profile(name)
    if not profile.drive.usable:
        with pytest.raises(PlanError, match="is not usable for force: the value of register 40263"):
            on("sim-modbus-rtu", drive=name)
        return
    plan = on("sim-modbus-rtu", drive=name)
    traffic = traffic_of(plan)
    assert traffic.fits
    assert traffic.line().startswith(f"{plan.rate:g} Hz by {traffic.exchange} on Modbus RTU at ")
    assert profile.guarded is (profile.name == "generic_cia402_modbus")


def test_the_full_scale_of_a_profile_is_a_torque_at_the_shaft() -> None:
    axis = on("sim-modbus-rtu", drive="simplex_motion").axes[0]
    assert axis.effort_unit == pytest.approx(2.0 / 32767 / axis.rig.mechanism.ratio)
    assert axis.shown_unit == pytest.approx(1e-3 / axis.rig.mechanism.ratio)
    assert torque_step(FULL_SCALE, axis.rig) is None, "without a profile there is none"


def test_a_motor_that_goes_straight_has_newtons_and_micrometres() -> None:
    axis = on("sim-modbus-rtu", drive="iris_orca").axes[0]
    assert axis.effort_unit == pytest.approx(1e-3), "a millinewton, whatever the metres of a turn"
    assert axis.position_unit == pytest.approx(1e-6)
    assert steps_per_revolution("µm", 4096, 0.05) == pytest.approx(50_000)


def test_a_motor_that_goes_straight_needs_a_linear_mechanism() -> None:
    scene = scene_of(Wall("handle", 1.0), workspace=Workspace.ROTARY)
    axis = default_axis(Workspace.ROTARY, bus="line", node=1, profile="iris_orca")
    rig = Rig({"line": parse_bus("sim-modbus-rtu").section}, {"handle": replace(axis, emergency_stop="power")})
    assert isinstance(axis.mechanism, RotaryMechanism)
    with pytest.raises(PlanError, match="linear mechanism"):
        compile_plan(scene, rig, {"iris_orca": load_profile("iris_orca")}, None)


def test_a_drive_of_canopen_is_told_where_it_belongs() -> None:
    with pytest.raises(PlanError, match=r"maxon EPOS4 speaks canopen, but the bus .* is modbus; .*--bus sim"):
        on("sim-modbus-tcp", drive="maxon_epos4")
    with pytest.raises(PlanError, match="simulate it with --bus sim-modbus-tcp"):
        on("sim", drive="generic_cia402_modbus")
    with pytest.raises(PlanError, match=r"Simplex Motion .* supports Modbus RTU, but sim-modbus-tcp is TCP"):
        on("sim-modbus-tcp", drive="simplex_motion")


def test_a_watchdog_time_that_its_register_cannot_hold_is_refused(tmp_path: Path) -> None:
    old = 'time = { address = 0x0204, type = "uint16"'
    faults = faults_of(tmp_path, (old, old.replace("uint16", "int16")), ("deadline = 0.05", "deadline = 40.0"))
    assert any("watchdog.deadline" in fault and "which fit into int16" in fault for fault in faults)


def test_no_value_in_the_unit_of_full_scale_is_above_full_scale(tmp_path: Path) -> None:
    """Its sixteen bits are those of the unit, whatever the register: beyond them the sign of the torque turns."""
    wide = 'target = { address = 0x0210, type = "int32", unit = "full_scale/32767"'
    text = GENERIC.replace('target = { address = 0x0201, type = "int16", unit = "permille_of_rated_torque"', wide)
    text = text.replace('0x0101, type = "int16", unit = "permille_of_rated_torque"', f'0x0101, type = "int16", {UNIT}')
    assert wide in text
    assert UNIT in text
    path = tmp_path / "own.toml"
    for full_scale, refused in ((0.5, False), (0.3, True)):
        path.write_text(text.replace("[torque]", f"[torque]\nfull_scale = {full_scale}"), encoding="utf-8")
        if refused:
            with pytest.raises(PlanError, match="at most 32767 steps are possible"):
                on("sim-modbus-rtu", drive=str(path))
        else:
            assert on("sim-modbus-rtu", drive=str(path)).axes[0].limits.effort > 0.0
