"""Rig files with units: each number of a rig may have its unit, and a wrong unit is told with the one that is right."""

import math
from pathlib import Path
from typing import get_args, get_type_hints

import pytest

from haptic_fieldbus.drive.rig import (
    BusSection,
    Cogging,
    CompliantCoupling,
    Limits,
    LinearMechanism,
    RigAxis,
    RotaryMechanism,
    Seen,
    Stribeck,
    Weight,
)
from haptic_fieldbus.drive.rig_units import measured_by, tables_of
from haptic_fieldbus.errors import RigError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import load_rig, rig_schema
from tests.drive.test_rig_files import COMPLETE, faults_of, write
from tests.test_schemas import accepts

PLAIN = """\
[bus.can0]
interface = "socketcan"
channel = "can0"
bitrate = 500_000
listen = 0.25
[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
rated_torque = 0.094
torque_constant = 0.0259
rated_current = 2.5
peak_current = 10.0
encoder_counts_per_revolution = 4096
inertia = 6.0e-6
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05
[axis.handle.limits]
effort = 8.0
speed = 1.0
position = [-0.1, 0.1]
drift = 0.005
acceleration = 50.0
power = 0.5
stall = 120.0
[axis.handle.simulation]
gravity = { torque = -0.01 }
cogging = { torque = 0.002, periods_per_revolution = 12 }
stribeck = { torque = 0.001, velocity = 0.10471975511965977 }
coupling = { stiffness = 20.0, load_inertia = 1.0e-6, damping = 1.0e-3, backlash = 0.0017453292519943295 }
"""
TABLES = (
    CanSection,
    RigAxis,
    LinearMechanism,
    RotaryMechanism,
    Limits,
    Seen,
    CompliantCoupling,
    Weight,
    Cogging,
    Stribeck,
)
WITH_UNITS = {
    "bitrate = 500_000": 'bitrate = "500 kbit/s"',
    "listen = 0.25": 'listen = "250 ms"',
    "rated_torque = 0.094": 'rated_torque = "94 mN·m"',
    "torque_constant = 0.0259": 'torque_constant = "25.9 mNm/A"',
    "rated_current = 2.5": 'rated_current = "2500 mA"',
    "peak_current = 10.0": 'peak_current = "10 A"',
    "inertia = 6.0e-6": 'inertia = "60 g*cm^2"',
    "viscous_damping = 1.0e-4": 'viscous_damping = "100 µN·m·s/rad"',
    "coulomb_friction = 2.0e-3": 'coulomb_friction = "2 mNm"',
    "metres_per_revolution = 0.05": 'metres_per_revolution = "50 mm"',
    "effort = 8.0": 'effort = "0.008 kN"',
    "speed = 1.0": 'speed = "100 cm/s"',
    "position = [-0.1, 0.1]": 'position = ["-10 cm", 0.1]',
    "drift = 0.005": 'drift = "5 mm"',
    "acceleration = 50.0": 'acceleration = "50000 mm/s2"',
    "power = 0.5": 'power = "500 mW"',
    "stall = 120.0": 'stall = "2 min"',
    "{ torque = -0.01 }": '{ torque = "-10 mNm" }',
    "{ torque = 0.002, ": '{ torque = "2 mNm", ',
    "torque = 0.001, velocity = 0.10471975511965977": 'torque = "1 mNm", velocity = "1 rpm"',
    "stiffness = 20.0": 'stiffness = "20 mNm/mrad"',
    "load_inertia = 1.0e-6": 'load_inertia = "10 g·cm²"',
    "damping = 1.0e-3": 'damping = "1 mNms/rad"',
    "backlash = 0.0017453292519943295": 'backlash = "0.1 deg"',
}


def numbers(value: object) -> list[float]:
    if isinstance(value, dict):
        return [number for each in value.values() for number in numbers(each)]
    if hasattr(value, "__dataclass_fields__"):
        return numbers(vars(value))
    if isinstance(value, tuple):
        return [float(each) for each in value]
    return [float(value)] if isinstance(value, int | float) else []


def test_a_rig_with_units_is_the_rig_in_si(tmp_path: Path) -> None:
    text = PLAIN
    for plain, with_unit in WITH_UNITS.items():
        assert plain in text
        text = text.replace(plain, with_unit, 1)
    plainly = numbers(vars(load_rig(write(tmp_path, PLAIN))))
    assert len(plainly) > len(WITH_UNITS)
    assert numbers(vars(load_rig(write(tmp_path, text)))) == pytest.approx(plainly, rel=1e-14)


def test_the_bit_rate_of_a_text_is_whole(tmp_path: Path) -> None:
    section = load_rig(write(tmp_path, COMPLETE.replace("500_000", '"0.5 Mbit/s"'))).bus["can0"]
    assert isinstance(section, CanSection)
    assert section.bitrate == 500_000
    assert isinstance(section.bitrate, int)


def test_a_limit_has_the_unit_of_its_mechanism(tmp_path: Path) -> None:
    limits = '[axis.knob.limits]\neffort = "20 mNm"\nspeed = "60 rpm"\nposition = ["-90°", "90°"]\n'
    knob = load_rig(write(tmp_path, COMPLETE + limits)).axis["knob"].limits
    assert knob.effort == pytest.approx(0.02)
    assert knob.speed == pytest.approx(2 * math.pi)
    assert knob.position == pytest.approx((-math.pi / 2, math.pi / 2))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "rated_torque = 0.1",
            'rated_torque = "8 N"',
            'line 9: axis.handle.rated_torque: "8 N"; expected a torque in N·m, at the motor shaft; '
            "N is a unit of a force on a linear axis",
        ),
        (
            "effort = 8",
            'effort = "94 mN·m"',
            'line 21: axis.handle.limits.effort: "94 mN·m"; expected a force in N, because the axis is linear; '
            "mNm is a unit of a torque on a rotary axis",
        ),
        (
            "metres_per_revolution = 0.05",
            'metres_per_revolution = "5 deg"',
            'line 17: axis.handle.mechanism.metres_per_revolution: "5 deg"; expected a length in m, at the handle; '
            "deg is a unit of an angle on a rotary axis",
        ),
        (
            "bitrate = 500_000",
            'bitrate = "5 Mbit/s"',
            'line 4: bus.can0.bitrate: "5 Mbit/s"; expected a whole number from 10000 to 1000000',
        ),
        (
            "inertia = 6.0e-5",
            'inertia = "6e-5"',
            'line 11: axis.handle.inertia: "6e-5"; expected a number without quotes, '
            'or one with its unit such as "2 kg·m²"',
        ),
        (
            "[-0.10, 0.10]",
            '["10 cm", "-10 cm"]',
            'line 23: axis.handle.limits.position: ["10 cm", "-10 cm"]; expected the lower limit first',
        ),
    ],
)
def test_a_wrong_unit_is_told_with_the_right_one(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert faults_of(tmp_path, (old, new)) == [message]


@pytest.mark.parametrize("effort", ["8 N", "1 N·m"])
def test_an_unknown_mechanism_makes_no_second_fault(tmp_path: Path, effort: str) -> None:
    faults = faults_of(tmp_path, ('kind = "linear"', 'kind = "screw"'), ("effort = 8", f'effort = "{effort}"'))
    assert [fault.partition(";")[0] for fault in faults] == ['line 16: axis.handle.mechanism.kind: "screw"']


def test_tables_that_are_none_are_left_to_the_schema(tmp_path: Path) -> None:
    text = COMPLETE.replace("[axis.handle.limits]", "[axis.handle.limitz]").replace("bus = ", "buss = ", 1)
    with pytest.raises(RigError) as caught:
        load_rig(write(tmp_path, text.replace('mechanism = { kind = "rotary", gear_ratio = 4, zero = 120 }', "")))
    assert len(caught.value.faults) == 4


def floats(hint: object) -> bool:
    """Whether a value of this type may be a float, alone or in a list."""
    return hint is float or any(map(floats, get_args(hint)))


@pytest.mark.parametrize("schema", TABLES, ids=lambda each: each.__name__)
def test_every_float_of_a_rig_has_its_unit(schema: type) -> None:
    """So that none is forgotten when a field is added."""
    hints = get_type_hints(schema, include_extras=True)
    without = {name for name, hint in hints.items() if floats(hint) and not tables_of(hint)}
    assert {name for name in without if measured_by(hints[name]) is None} <= {"gear_ratio", "arguments"}


def test_an_editor_takes_the_units_too(tmp_path: Path) -> None:
    text = PLAIN
    for plain, with_unit in WITH_UNITS.items():
        text = text.replace(plain, with_unit, 1)
    assert accepts(rig_schema(), text)
    assert accepts(rig_schema(), PLAIN)
    assert not accepts(rig_schema(), PLAIN.replace("effort = 8.0", "effort = -8.0"))


def test_a_bus_of_no_particular_protocol_stands_for_itself() -> None:
    bus = BusSection("any", "0")
    assert bus.in_place_of_real() is bus
    assert not bus.stands_for_real
