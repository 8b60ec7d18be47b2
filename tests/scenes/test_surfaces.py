"""How deep a handle is in an element, against the element's own force: none outside, and deeper by what it moves.

Every kind is asked by the examples of its sheet. A kind whose first example pushes on one side of a place alone has a
surface.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import AnyElement, CouplingElement, abilities
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.registry import ELEMENTS
from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.cases import every
from tests.scenes.test_element_contract import SHEETS

PLACES = np.linspace(-0.1, 0.1, 81).tolist()
"""Where the handle is put at rest [m]; the surfaces of all examples lie between."""
EITHER_SIDE = {"proxy"}
"""Kinds of which either side may be outside: that from which the handle came."""
CLOSE = 1e-9
"""[m]."""


def resting_force(element: AnyElement, position: float) -> float:
    """Force on a handle that begins at rest there."""
    law = law_of(cast(Any, element), 1e-3)
    return law(*(position if signal is Signal.POSITION else 0.0 for signal in element.needs))


def depth(element: AnyElement, position: float) -> float:
    """How deep the handle is there [m], of an element that has a surface."""
    penetration = abilities(element).penetration
    assert penetration is not None
    found = penetration(position)
    assert found is not None
    return found


def surfaces(element: AnyElement) -> list[tuple[float, float]]:
    """Each surface [m], found to the last bit, and the direction that leads inwards from it."""
    found = []
    for one, other in pairwise(PLACES):
        if (depth(element, one) > 0.0) != (depth(element, other) > 0.0):
            inwards = 1.0 if depth(element, other) > 0.0 else -1.0
            outside, inside = (one, other) if inwards > 0.0 else (other, one)
            while (middle := 0.5 * (outside + inside)) not in (outside, inside):
                outside, inside = (outside, middle) if depth(element, middle) > 0.0 else (middle, inside)
            found.append((outside, inwards))
    return found


def is_one_sided(forces: Sequence[float]) -> bool:
    """Whether a force is exactly 0 up to some place, and beyond it everywhere and of one sign."""
    signs = np.sign(forces if forces[0] == 0.0 else forces[::-1])
    beyond = signs[int(np.argmax(signs != 0.0)) :]
    return bool(signs[0] == 0.0 and beyond[0] != 0.0 and np.all(beyond == beyond[0]))


@every("kind", ELEMENTS)
def test_a_kind_that_pushes_on_one_side_alone_tells_how_deep_the_handle_is(kind: str) -> None:
    element = SHEETS[kind].examples[0]
    if not (isinstance(element, CouplingElement) or abilities(element).penetration) and kind not in EITHER_SIDE:
        assert not is_one_sided([resting_force(element, place) for place in PLACES]), (
            f"{kind}: give it `penetration`, so that a run tells how deep the handle went"
        )


def test_a_wall_pushes_on_one_side_alone() -> None:
    for side in ("positive", "negative"):
        wall = Wall("handle", 600.0, 0.012, side=cast(Any, side))
        assert is_one_sided([resting_force(wall, place) for place in PLACES])
    assert not is_one_sided([0.0, 0.0])
    assert not is_one_sided([0.0, 1.0, 0.0])


@every("kind", [kind for kind, sheet in SHEETS.items() if abilities(sheet.examples[0]).penetration])
def test_a_body_pushes_where_the_handle_is_deep_and_only_there(kind: str) -> None:
    told = [(each, abilities(each).penetration) for each in SHEETS[kind].examples]
    bodies = [each for each, penetration in told if penetration is not None and penetration(0.0) is not None]
    assert bodies, f"{kind}: its sheet has no example with a surface"
    for element in bodies:
        found = surfaces(element)
        assert found
        for surface, inwards in found:
            assert depth(element, surface) == 0.0
            for way in (CLOSE, 1e-3, 5e-3):
                assert depth(element, surface - inwards * way) == 0.0
                assert resting_force(element, surface - inwards * way) == 0.0
                assert depth(element, surface + inwards * way) == pytest.approx(way, abs=1e-16)
                assert inwards * resting_force(element, surface + inwards * way) < 0.0


def test_a_stop_is_deep_beyond_either_end() -> None:
    stop = EndStop("handle", 600.0, -0.03, 0.01)
    assert surfaces(stop) == [(-0.03, -1.0), (0.01, 1.0)]
    depths = [stop.penetration(position) for position in (-0.035, -0.03, 0.0, 0.01, 0.0125)]
    assert depths == pytest.approx([0.005, 0.0, 0.0, 0.0, 0.0025])
    forces = [resting_force(stop, position) for position in (-0.035, 0.0, 0.0125)]
    assert np.sign(forces).tolist() == [1.0, 0.0, -1.0]


def test_what_its_values_leave_without_a_surface_has_no_depth() -> None:
    assert Wall("handle", 600.0, 0.012, sides="bilateral").penetration(1.0) is None
    assert VirtualCoupling("handle", 600.0, 0.1).penetration(1.0) is None
