"""`view` and `--view` before any page: what is refused, and with which words."""

import sys

import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.cli.view import check_view
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.planning.live_changes import plan_change
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.view.description import base_command, describe, round_scale
from tests.builders import plan_of, scene_of
from tests.cli.command import Command


def test_without_nicegui_the_extra_is_named_and_all_else_works(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "nicegui", None)
    monkeypatch.setattr("haptic_fieldbus.cli.view.find_spec", lambda name: None)
    for words in (("run", "wall", "--view"), ("view",), ("demo",)):
        finished = command(*words)
        assert finished.status == 2
        assert "pip install -e '.[view]'" in finished.err
    assert command("run", "wall", "--duration", "0.05").status == 0


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "", "0", "0x0", "0.0", "::0"])
def test_a_page_for_everybody_is_refused(host: str) -> None:
    with pytest.raises(UsageError, match="give the address or the name of one interface"):
        check_view(host, None)


@pytest.mark.parametrize("port", [-1, 65_536, 99_999])
def test_a_port_that_no_computer_has_is_refused(port: int, command: Command) -> None:
    pytest.importorskip("nicegui")
    for words in (("run", "wall", "--view", "--view-port"), ("view", "--port"), ("demo", "--port")):
        finished = command(*words, str(port))
        assert finished.status == 2
        assert f"port {port}: expected a whole number from 0 to 65535" in finished.err


def test_without_a_run_there_is_nothing_to_view(command: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    finished = command("view", "--run", "1")
    assert finished.status == 2
    assert "haptic-fieldbus run SCENE --view" in finished.err


def test_a_command_line_is_told_without_its_settings_and_its_view() -> None:
    given = ["run", "wall", "--set", "wall.stiffness=3", "--view", "--view-port", "1", "--rate", "500", "--set=a.b=1"]
    assert base_command(given) == ["run", "wall", "--rate", "500"]


def test_the_scale_of_a_parameter_has_the_limit_of_the_plan_and_the_law_is_that_of_the_wall() -> None:
    plan = plan_of(scene_of(Wall("handle", 600.0, position=0.02)))
    told = describe(plan, plan)
    stiffness, position, _ = told["parameters"]
    assert plan.stability is not None
    assert stiffness["limit"] == plan.stability.limit.value == 875.0
    assert told["limits"] == ["875 N/m; 600 is inside, margin 1.45"]
    assert stiffness["low"] < stiffness["value"] < stiffness["limit"] < stiffness["high"]
    assert position["limit"] is None
    (axis,) = told["axes"]
    low, high = axis["travel"]
    for number, force in enumerate(axis["law"]):
        place = low + number * (high - low) / (len(axis["law"]) - 1)
        assert force == pytest.approx(-600.0 * max(0.0, place - 0.02))
    assert axis["surfaces"] == [{"at": 0.02, "side": "positive", "name": "wall"}]


def test_the_material_of_two_end_stops_is_drawn_on_the_outer_sides() -> None:
    detents = plan("detents")
    (axis,) = describe(detents, detents)["axes"]
    assert [(each["at"], each["side"]) for each in axis["surfaces"]] == [(-0.03, "negative"), (0.03, "positive")]


@pytest.mark.parametrize("low", [0.0, -0.1, -3.14159, -7.3e4])
@pytest.mark.parametrize("high", [1e-5, 0.048, 1.0, 602.34375, 937.5, 1e6])
def test_a_slider_has_a_hundred_to_two_hundred_round_steps_and_holds_its_scale(low: float, high: float) -> None:
    begin, end, step = round_scale(low, high, False)
    assert f"{step:.0e}"[0] in "125"
    assert float(f"{step:.0e}") == step
    assert begin - 1e-9 <= low < high <= end * (1.0 + 1e-9)
    assert 80 <= round((end - begin) / step) <= 202
    for each in (begin, end):
        assert each / step == pytest.approx(round(each / step), abs=1e-6)


def test_a_parameter_that_the_run_can_never_change_says_why_and_others_say_nothing() -> None:
    wall, detents = plan("wall"), plan("detents")
    reasons = {each["name"]: each["fixed"] for each in describe(wall, wall)["parameters"]}
    assert reasons.pop("wall.damping") == "wall needs velocity, which this run does not estimate"
    assert {*reasons.values()} == {""}
    with pytest.raises(PlanError, match="needs velocity, which this run does not estimate"):
        plan_change(wall, wall, {"wall.damping": 1.0})
    damped = plan("wall", settings={"wall.damping": 0.5})
    for running in (damped, detents):
        named = {each["name"]: each["fixed"] for each in describe(running, running)["parameters"]}
        assert not named.get("wall.damping")
    # The damping of a run that began with one is changed to 0 and back.
    undamped = plan_change(damped, damped, {"wall.damping": 0.0}).plan
    assert {each["fixed"] for each in describe(undamped, damped)["parameters"]} == {""}
