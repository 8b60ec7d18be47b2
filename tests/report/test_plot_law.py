"""Force over position: the law of a scene, its wells, stops and the limit of the motor."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from haptic_fieldbus.assessing.result import Array, Trace
from haptic_fieldbus.report.drawing import UNITS
from haptic_fieldbus.report.plot import draw_law, law_at_rest, wells
from haptic_fieldbus.scenes.dahl import Dahl
from haptic_fieldbus.scenes.detents import Detents
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace

PITCH = 0.7
DETENTS = Detents("knob", pitch=PITCH, amplitude=0.05)
STOP = EndStop("knob", stiffness=0.3, damping=0.01, lower=-1.0, upper=4.0)


def test_the_law_is_the_sum_of_all_that_depends_on_the_place_alone_or_on_it_and_speed() -> None:
    places: Array = np.array([-2.0, 0.2, 4.5])
    found = law_at_rest([DETENTS, STOP], places)
    assert found is not None
    stop = np.array([0.3 * 1.0, 0.0, -0.3 * 0.5])
    np.testing.assert_allclose(found, stop - 0.05 * np.sin(2 * np.pi * places / PITCH), atol=1e-12)


def test_of_what_remembers_alone_there_is_no_law() -> None:
    assert law_at_rest([Dahl("knob", coulomb=0.1, stiffness=5.0)], np.zeros(1)) is None


def test_wells_are_a_pitch_apart() -> None:
    places: Array = np.linspace(-1.0, 3.0, 2001)
    law = law_at_rest([DETENTS], places)
    assert law is not None
    np.testing.assert_allclose(wells(places, law), PITCH * np.arange(-1, 5), atol=1e-5)


@pytest.mark.parametrize(("effort", "told"), [(0.5, True), (50.0, False), (None, False)])
def test_the_limit_of_the_motor_is_drawn_where_it_matters(effort: float | None, told: bool) -> None:
    position: Array = np.linspace(0.0, 4.9, 500)
    trace = Trace("knob", Workspace.ROTARY, position, position, -0.1 * position)
    panel = Figure().subplots()
    draw_law(panel, trace, [DETENTS, STOP], effort, UNITS[Workspace.ROTARY])
    labels = panel.get_legend_handles_labels()[1]
    assert ("motor limit" in labels) == told
    assert {"torque at rest", "detent", "stop"} <= set(labels)


def test_without_a_law_only_the_paths_are_drawn() -> None:
    position: Array = np.linspace(0.0, 0.05, 500)
    trace = Trace("handle", Workspace.LINEAR, position, position, -position)
    panel = Figure().subplots()
    draw_law(panel, trace, [], None, UNITS[Workspace.LINEAR])
    assert len(panel.lines) == 1
    assert panel.get_legend_handles_labels()[1] == ["commanded"]
    draw_law(panel, trace, [Wall("handle", 600.0, position=0.02)], None, UNITS[Workspace.LINEAR])
    assert {"force at rest", "wall"} <= set(panel.get_legend_handles_labels()[1])


def test_the_law_beyond_the_rendered_force_does_not_stretch_the_panel() -> None:
    position: Array = np.linspace(0.0, 0.05, 500)
    trace = Trace("handle", Workspace.LINEAR, position, position, -10.0 * position)
    panel = Figure().subplots()
    draw_law(panel, trace, [Wall("handle", 6e5, position=0.02)], None, UNITS[Workspace.LINEAR])
    low, high = panel.get_ylim()
    assert high - low < 2.0 * 0.5
