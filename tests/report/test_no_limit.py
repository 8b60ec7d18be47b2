"""A limit that there is none of is told in words, and never as a number."""

import json

import pytest

import haptic_fieldbus
from haptic_fieldbus.api.stability_limits import judge_scene
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.report.analysis_texts import stability_lines
from haptic_fieldbus.report.texts import stability_text

METHOD = "backward-euler"
"""A virtual mass by it pulls like a mass, however stiff its spring."""


def test_the_limits_of_a_scene_say_so() -> None:
    lines = [
        text for key, text in stability_lines(judge_scene(Task("sprung_mass", method=METHOD))) if key in ("limits", "")
    ]
    assert lines[0] == "stable with no limit"
    assert lines[1].startswith("passive at no stiffness")
    assert "friction: stable with no limit, passive at no stiffness" in lines[4]


def test_a_plan_says_so() -> None:
    plan = haptic_fieldbus.plan("sprung_mass", method=METHOD)
    assert "200 N/m asked, stable with no limit, passive at no stiffness" in explain(plan)
    assert stability_text(plan).startswith("stable with no limit on this bench; you ask 200: ")


def test_in_json_it_is_null() -> None:
    told = haptic_fieldbus.stability("sprung_mass", method=METHOD).to_json()
    text = json.dumps({key: value for key, value in told.items() if key in ("stiffness_limit", "margin")}, default=vars)
    assert '"stable": null' in text
    assert '"margin": null' in text


def test_a_part_of_it_cannot_be_asked_for() -> None:
    with pytest.raises(UsageError, match="this bench has no stability limit"):
        haptic_fieldbus.plan("sprung_mass", method=METHOD, settings={"sprung_mass.stiffness": "max/2"})
    with pytest.raises(UsageError, match="this bench has no stability limit"):
        haptic_fieldbus.stability("sprung_mass", method=METHOD, mass=10.0, settings={"sprung_mass.stiffness": "max"})
