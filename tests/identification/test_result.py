"""The result of a measurement, as people and programs get it."""

import json
from dataclasses import replace

import pytest

from haptic_fieldbus.identification import Announcement, IdentifiedBench, further_texts, interval_text
from haptic_fieldbus.identification.estimates import UNITS, Estimate
from haptic_fieldbus.identification.fit import ShaftFit
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.signals import Workspace

TOLD = Announcement("handle", -0.1, 0.1, 0.8, 12.5, 0.5, Workspace.LINEAR, 0.25, 2.5, from_start=True)


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.9e-4, 1.1e-4, "0.1 mN·m ± 10 %"),
        (0.0, 3e-4, "0 N·m to 0.3 mN·m"),
        (-1e-4, 1e-4, "-0.1 mN·m to 0.1 mN·m"),
    ],
)
def test_an_interval_is_told_in_percent_or_by_its_ends(low: float, high: float, text: str) -> None:
    value = 0.0 if low < 0.0 else 1e-4
    assert interval_text(Estimate(value, low, high, "N·m")) == text


def test_an_announcement_says_how_far_how_fast_and_how_strongly() -> None:
    lines = list(TOLD.lines())
    assert "from -0.1 m to 0.1 m from where it is" in lines[0]
    assert "keep hands off" in lines[0]
    assert "at most 12.5 N (25 % of rated torque) and 0.72 m/s" in lines[1]
    assert "before that, pulses of up to 2.5 N test the motor direction" in lines[2]
    fixed = Announcement("handle", -0.1, 0.1, 0.8, 12.5, 0.5, Workspace.LINEAR, 0.25, 2.5, from_start=False)
    assert "by the rig's zero" in next(fixed.lines())


def test_stribeck_friction_and_waves_are_told() -> None:
    model = ShaftModel(1.0, 1.0, 1.0, 1.0, 1.0, stribeck=2e-3, stribeck_speed=3.0, waves=((12.0, 3e-3, -4e-3),))
    model = replace(model, coulomb=0.19, damping=0.0)
    fit = ShaftFit(model, {"load": Estimate(0.0, -1e-3, 1e-3, "N·m")}, 0.3, 20.0, 8000)
    assert list(further_texts(fit)) == [
        "2 mN·m more friction at rest (Stribeck), which fades at 3 rad/s",
        "5 mN·m of cogging or weight, 12 times a turn",
    ]
    found = IdentifiedBench(TOLD, 1000.0, {}, fit=fit, check=0.31).to_json()
    assert found["stribeck"] == {"torque": 2e-3, "speed": 3.0}
    assert found["waves"] == [{"order": 12.0, "cosine": 3e-3, "sine": -4e-3}]
    little = replace(model, coulomb=0.51)
    for other in (ShaftModel(1, 1, 1, 1, 1), little):
        hidden = replace(fit, model=other)
        assert "nothing else seen above the 0.3 counts" in next(further_texts(hidden))
        assert IdentifiedBench(TOLD, 1000.0, {}, fit=hidden, check=0.31).to_json()["waves"] == []


def test_a_constant_load_is_told_with_its_direction() -> None:
    model, load = ShaftModel(1.0, 0.0, 2e-3, 1.0, 1.0), Estimate(-1.5e-3, -1.501e-3, -1.499e-3, "N·m")
    fit = ShaftFit(model, {"load": load}, 0.3, 20.0, 8000)
    assert list(further_texts(fit)) == ["1.5 mN·m of constant load, such as a weight, towards negative positions"]
    upward = replace(fit, values={"load": Estimate(1.5e-3, 1.499e-3, 1.501e-3, "N·m")})
    assert "towards positive positions" in next(further_texts(upward))
    unsure = replace(fit, values={"load": replace(load, high=1e-6)})
    assert "nothing else seen" in next(further_texts(unsure))


def test_a_wave_that_rounding_makes_without_friction_is_not_told() -> None:
    """Without Coulomb friction, damping at top speed is what a wave stands beside."""
    values = {"load": Estimate(0.0, -1e-9, 1e-9, "N·m")}
    fit = ShaftFit(ShaftModel(4e-5, 1e-4, 0.0, 1.0, 1.0, waves=((0.6, 3e-8, 0.0),)), values, 0.3, 90.0, 8000)
    assert "nothing else seen" in next(further_texts(fit))


def test_json_holds_each_value_with_its_interval_and_what_the_rig_states() -> None:
    values = {name: Estimate(1.0, 0.9, 1.1, unit, "" if name == "inertia" else "why") for name, unit in UNITS.items()}
    fit = ShaftFit(ShaftModel(1.0, 1.0, 1.0, 1.0, 1.0), values, 0.3, 20.0, 8000)
    found = IdentifiedBench(TOLD, 1000.0, {"inertia": 2.0}, warnings=("a warning",), fit=fit, check=0.31)
    told = json.loads(json.dumps(found.to_json()))
    assert told["values"]["inertia"] == {
        "value": 1.0, "low": 0.9, "high": 1.1, "unit": "kg·m²", "reason": None, "stated": 2.0,
    }  # fmt: skip
    assert told["values"]["load"]["stated"] is None
    assert told["values"]["load"]["reason"] == "why"
    assert (told["stribeck"], told["waves"], told["scale"]) == (None, [], None)
    assert told["residual"] == {"fit": 0.3, "check": 0.31, "unit": "counts"}
    assert (told["travel"], told["written"], told["warnings"]) == ([-0.1, 0.1], None, ["a warning"])
