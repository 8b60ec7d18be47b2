"""Panel of a run: force over position, with the law of the scene, its wells and stops, and the motor's limit."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes

from haptic_fieldbus.assessing.result import Array, Trace
from haptic_fieldbus.report.drawing import GREEN, GREY, INK, PURPLE, SKY, VERMILION, AxisUnits, kept
from haptic_fieldbus.scenes.element import StaticElement
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal

AT_PLACE, AT_PLACE_AND_SPEED = (Signal.POSITION,), (Signal.POSITION, Signal.VELOCITY)
PLACES = 2001
"""Places at which the law of the scene is drawn."""
AROUND = 0.08
"""Share of the way by which the law is drawn beyond it."""
NEAR = 0.5
"""Share of the motor's limit from which it is drawn."""


def draw_law(panel: Axes, trace: Trace, elements: Sequence[object], effort: float | None, units: AxisUnits) -> None:
    """Draw the rendered and the ideal force over the position of the handle.

    `effort` is the limit of the motor [N or N·m]; None where it is not known.
    """
    low, high = float(trace.position.min()), float(trace.position.max())
    margin = AROUND * (high - low or 1e-3)
    places = np.linspace(low - margin, high + margin, PLACES)
    law = law_at_rest(elements, places)
    if law is not None:
        panel.plot(places * units.per_length, law, color=GREY, linewidth=1.0, linestyle="--", label="law at rest")
        for number, well in enumerate(wells(places, law)):
            label = "well" if not number else None
            panel.axvline(well * units.per_length, color=GREEN, linewidth=1.0, linestyle=":", label=label)
    _path(panel, trace.position, trace.force, units, SKY, 3.0)
    asked = trace.force
    if trace.ideal is not None:
        _path(panel, trace.position, trace.ideal, units, INK, 1.1)
        asked = trace.ideal
    if effort is not None and np.abs(asked).max() > NEAR * effort:
        for number, limit in enumerate((-effort, effort)):
            panel.axhline(
                limit, color=VERMILION, linewidth=1.2, linestyle="-.", label=None if number else "limit of the motor"
            )
    for number, stop in enumerate(_surfaces(elements, low - margin, high + margin)):
        panel.axvline(stop * units.per_length, color=PURPLE, linewidth=1.2, label=None if number else "wall or stop")
    panel.set_ylabel(f"{units.effort_name} [{units.effort}]")
    if panel.get_legend_handles_labels()[1]:  # the colours of both paths are those of the force beside
        panel.legend(fontsize=8, loc="best", framealpha=0.85, edgecolor="none")


def law_at_rest(elements: Sequence[object], places: Array) -> Array | None:
    """Return the force of the scene on a handle that rests at each place, `(n_places,)`.

    What remembers, such as friction, is left out; None when nothing else depends on the place.
    """
    laws = [
        (element.force, [0.0] * (len(element.needs) - 1))
        for element in elements
        if isinstance(element, StaticElement) and element.needs in (AT_PLACE, AT_PLACE_AND_SPEED)
    ]
    if not laws:
        return None
    return np.array([sum(force(place, *rest) for force, rest in laws) for place in places.tolist()])


def wells(places: Array, law: Array) -> list[float]:
    """Return the places to which the law draws the handle from both sides, between two of `places`."""
    found = []
    for (left, before), (right, after) in pairwise(zip(places.tolist(), law.tolist(), strict=True)):
        if before > 0.0 >= after and after != before:
            found.append(left + (right - left) * before / (before - after))
    return found


def _surfaces(elements: Sequence[object], low: float, high: float) -> list[float]:
    """Return the places of walls and end stops within a range."""
    found: list[float] = []
    for element in elements:
        if isinstance(element, Wall):
            found.append(element.position)
        elif isinstance(element, EndStop):
            found += [element.lower, element.upper]
    return [place for place in found if low <= place <= high]


def _path(panel: Axes, position: Array, force: Array, units: AxisUnits, colour: str, width: float) -> None:
    shown = np.union1d(kept(force), kept(position))
    x, y = position[shown] * units.per_length, force[shown]
    panel.plot(x, y, color=colour, linewidth=width, solid_capstyle="butt")
