"""Numbers with units: SI values of every unit beside figures of the SI brochure, and what a wrong unit is told."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.documents.quantities import Quantity, parse_quantity
from haptic_fieldbus.signals import Workspace
from tests.cases import every

LINEAR, ROTARY = Workspace.LINEAR, Workspace.ROTARY


@every(
    ("text", "quantity", "workspace", "value"),
    [
        ("20 mm", Quantity.LENGTH, LINEAR, 0.02),
        ("20mm", Quantity.LENGTH, LINEAR, 0.02),
        ("-1.5e1 µm", Quantity.LENGTH, LINEAR, -15e-6),
        ("30 deg", Quantity.LENGTH, ROTARY, math.pi / 6),
        ("30°", Quantity.LENGTH, ROTARY, math.pi / 6),
        ("0.6 N/mm", Quantity.STIFFNESS, LINEAR, 600.0),
        ("2 mN·m/deg", Quantity.STIFFNESS, ROTARY, 2e-3 * 180 / math.pi),
        ("2 mNm/deg", Quantity.STIFFNESS, ROTARY, 2e-3 * 180 / math.pi),
        ("3 N*s/m", Quantity.DAMPING, LINEAR, 3.0),
        ("3 Ns/m", Quantity.DAMPING, LINEAR, 3.0),
        ("3 mNms/rad", Quantity.DAMPING, ROTARY, 3e-3),
        ("250 g", Quantity.MASS, LINEAR, 0.25),
        ("40 g*cm^2", Quantity.MASS, ROTARY, 4e-6),
        ("4 kgm²", Quantity.MASS, ROTARY, 4.0),
        ("60 rpm", Quantity.SPEED, ROTARY, 2 * math.pi),
        ("6 m/min", Quantity.SPEED, LINEAR, 0.1),
        ("500 mm/s^2", Quantity.ACCELERATION, LINEAR, 0.5),
        ("180 deg/s2", Quantity.ACCELERATION, ROTARY, math.pi),
        ("5 ms", Quantity.TIME, LINEAR, 0.005),
        ("5 us", Quantity.TIME, ROTARY, 5e-6),
        ("0.2 kHz", Quantity.FREQUENCY, LINEAR, 200.0),
        ("70 %", Quantity.RATIO, LINEAR, 0.7),
        ("2 1/mm", Quantity.INVERSE_LENGTH, LINEAR, 2000.0),
        ("2 s/m", Quantity.INVERSE_SPEED, LINEAR, 2.0),
        ("2 kN/s", Quantity.EFFORT_RATE, LINEAR, 2000.0),
    ],
)
def test_a_number_with_its_unit_is_the_si_value(
    text: str, quantity: Quantity, workspace: Workspace, value: float
) -> None:
    assert parse_quantity(text, quantity, workspace) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "quantity", "workspace", "told"),
    [
        (
            "600 N/m",
            Quantity.STIFFNESS,
            ROTARY,
            "a stiffness in N·m/rad, because the axis is rotary; N/m is a unit of a stiffness on a linear axis",
        ),
        (
            "20 mm",
            Quantity.STIFFNESS,
            LINEAR,
            "a stiffness in N/m, because the axis is linear; mm is a unit of a length on a",
        ),
        ("3 furlong", Quantity.LENGTH, LINEAR, "a length in m, because the axis is linear; unknown unit"),
        (
            "3 mm",
            Quantity.MASS,
            ROTARY,
            "a moment of inertia in kg·m², because the axis is rotary; mm is a unit of a length on a",
        ),
        (
            "3 N",
            Quantity.EFFORT,
            ROTARY,
            "a torque in N·m, because the axis is rotary; N is a unit of a force on a linear axis",
        ),
        ("3 rpm", Quantity.FREQUENCY, LINEAR, "a frequency in Hz; rpm is a unit of a speed on a rotary axis"),
        ("3", Quantity.LENGTH, LINEAR, 'a number without quotes, or one with its unit such as "2 m"'),
        ("far", Quantity.LENGTH, LINEAR, 'a number without quotes, or one with its unit such as "2 m"'),
        ("", Quantity.RATIO, LINEAR, "a number without quotes"),
        ("3 m", Quantity.RATIO, LINEAR, "a number without a unit; m is a unit of a length on a linear axis"),
    ],
)
def test_another_unit_is_told_what_it_measures(text: str, quantity: Quantity, workspace: Workspace, told: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - its text is compared whole
        parse_quantity(text, quantity, workspace)
    assert str(caught.value).startswith(told)


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(Quantity), st.sampled_from(Workspace))
def test_the_si_unit_itself_changes_no_digit(value: float, quantity: Quantity, workspace: Workspace) -> None:
    unit = quantity.unit(workspace)
    if unit:
        assert parse_quantity(f"{value!r} {unit}", quantity, workspace) == value


@given(st.text(max_size=20), st.sampled_from(Quantity), st.sampled_from(Workspace))
def test_any_text_is_a_number_or_refused(text: str, quantity: Quantity, workspace: Workspace) -> None:
    told = ""
    try:
        assert type(parse_quantity(text, quantity, workspace)) is float
    except ValueError as error:
        told = str(error)
    assert not told or told.startswith(("a ", "an "))


@every(
    ("text", "told"),
    [
        ("100,5", "a number without a comma: 100.5"),
        ("100,5 N/m", "a number without a comma: 100.5 N/m"),
        (",5", "a number without a comma: 0.5"),
        ("-1,5e3", "a number without a comma: -1.5e3"),
        ("1,000", "a number without a comma: 1.000 or 1000"),
        ("1.000,5", "a number without a comma: 1000.5"),
        ("1,000.5 N/m", "a number without a comma: 1000.5 N/m"),
        ("1,234,567", "a number without a comma: 1234567"),
    ],
)
def test_a_decimal_comma_is_refused_with_the_spelling_to_use(text: str, told: str) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - its text is compared whole
        parse_quantity(text, Quantity.STIFFNESS, LINEAR)
    assert str(caught.value) == told


@every(
    ("text", "quantity", "workspace", "told"),
    [
        ("1n/mm", Quantity.STIFFNESS, LINEAR, 'because the axis is linear; write "1 N/mm"'),
        ("1 nm/RAD", Quantity.STIFFNESS, ROTARY, 'because the axis is rotary; write "1 N·m/rad"'),
        ("1khz", Quantity.FREQUENCY, LINEAR, 'a frequency in Hz; write "1 kHz"'),
        ("2 KG", Quantity.MASS, LINEAR, 'because the axis is linear; write "2 kg"'),
        ("1 sec", Quantity.TIME, LINEAR, "a time in s; unknown unit; known: min, ms, s, µs"),
    ],
)
def test_a_unit_in_another_spelling_is_refused_with_the_spelling_to_use(
    text: str, quantity: Quantity, workspace: Workspace, told: str
) -> None:
    with pytest.raises(ValueError) as caught:  # noqa: PT011 - its text is compared whole
        parse_quantity(text, quantity, workspace)
    assert str(caught.value).endswith(told)
