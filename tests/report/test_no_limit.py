"""A limit that there is none of is told in words, and never as a number."""

import json

import pytest

import haptic_fieldbus
from haptic_fieldbus.api.stability_limits import Device, judge_scene
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.report.analysis_texts import stability_lines

METHOD = "backward-euler"
"""A virtual mass by it pulls like a mass, however stiff its spring."""
DEVICE = Device(mass=0.6, damping=1.6, delay=4e-4)
"""With an older force it would have a limit."""


def test_the_limits_of_a_scene_say_so() -> None:
    lines = [
        text
        for key, text in stability_lines(judge_scene(Task("sprung_mass", method=METHOD), DEVICE))
        if key in ("limit", "nominal", "")
    ]
    assert "none: stable at any stiffness (damping stated, not measured); 200 N/m asked" in lines
    assert "stable with no limit" in lines
    assert not [line for line in lines if line.startswith("worst case")]
    assert "with 0.7 times damping and Coulomb friction: stable with no limit" in lines


def test_a_plan_says_so() -> None:
    assert "none: no stiffness to vary" in explain(haptic_fieldbus.plan("damper"))


def test_in_json_it_is_null() -> None:
    told = judge_scene(Task("sprung_mass", method=METHOD), DEVICE).stability.to_json()
    text = json.dumps(
        {key: value for key, value in told.items() if key in ("limit", "stiffness_limit", "margin")}, default=vars
    )
    assert '"stable": null' in text
    assert '"margin": null' in text
    assert '"limit": null' in text


def test_a_part_of_it_cannot_be_asked_for() -> None:
    with pytest.raises(UsageError, match="this scene has no limit on this bench"):
        haptic_fieldbus.plan("damper", settings={"damper.stiffness": "max/2"})
    with pytest.raises(UsageError, match="this scene has no limit on this bench"):
        haptic_fieldbus.stability("sprung_mass", method=METHOD, mass=10.0, settings={"sprung_mass.stiffness": "max"})
