"""How deep a handle is in an element, against the element's own force: none outside, and deeper by what it moves."""

from typing import Any, cast

import numpy as np
import pytest

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import AnyElement, said
from haptic_fieldbus.scenes.end_stop import EndStop
from haptic_fieldbus.scenes.generalised_maxwell import GeneralisedMaxwell
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.kelvin_voigt import KelvinVoigt
from haptic_fieldbus.scenes.needle import Needle
from haptic_fieldbus.scenes.predicted_wall import PredictedWall
from haptic_fieldbus.scenes.registry import ELEMENTS, element_type, kind_of
from haptic_fieldbus.scenes.standard_linear_solid import StandardLinearSolid
from haptic_fieldbus.scenes.virtual_coupling import VirtualCoupling
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.cases import every

EVERYWHERE = {
    "braking_pulse", "constant", "coupling", "dahl", "damped_sprung_mass", "damper", "detents", "free_puck", "friction",
    "grating", "gravity", "inertia", "lugre", "magnet", "pendulum", "periodic", "ramp", "spring", "sprung_mass",
    "stick_slip", "texture",
}  # fmt: skip
"""Kinds that act everywhere, or around places of their own: no side of them is outside."""
NO_SURFACE = EVERYWHERE | {"proxy"}
"""Either side of a proxy's surface may be outside: that from which the handle came."""
SURFACE = 0.012


def bodies(side: Any) -> list[AnyElement]:
    """One of each kind with a surface at `SURFACE`."""
    return [
        Wall("handle", 600.0, SURFACE, side=side),
        PredictedWall("handle", 600.0, SURFACE, side=side),
        HuntCrossley("handle", 5.0, 0.01, SURFACE, side=side),
        KelvinVoigt("handle", 600.0, 5.0, SURFACE, side=side),
        StandardLinearSolid("handle", 300.0, 300.0, 0.1, SURFACE, side=side),
        GeneralisedMaxwell("handle", 300.0, ((300.0, 0.1),), SURFACE, side=side),
        Needle("handle", 2.0, 0.05, 500.0, position=SURFACE, side=side),
        VirtualCoupling("handle", 600.0, 0.1, wall_stiffness=2000.0, wall=SURFACE, side=side),
    ]


def resting_force(element: AnyElement, position: float) -> float:
    """Force on a handle that begins at rest there."""
    law = law_of(cast(Any, element), 1e-3)
    return law(*(position if signal is Signal.POSITION else 0.0 for signal in element.needs))


@every("kind", ELEMENTS)
def test_each_kind_has_a_depth_or_is_known_to_have_no_surface(kind: str) -> None:
    assert hasattr(element_type(kind), "penetration") == (kind not in NO_SURFACE), (
        f"{kind}: give it `penetration`, so that a run tells how deep the handle went, or say here why it has none"
    )


def test_each_kind_with_a_surface_is_here() -> None:
    assert {kind_of(type(each)) for each in bodies("positive")} | {"end_stop"} == set(ELEMENTS) - set(NO_SURFACE)


@pytest.mark.parametrize("side", ["positive", "negative"])
@pytest.mark.parametrize("place", range(len(bodies("positive"))))
def test_a_body_pushes_where_the_handle_is_deep_and_only_there(place: int, side: str) -> None:
    element, inwards = bodies(side)[place], 1.0 if side == "positive" else -1.0
    penetration = said(element).penetration
    assert penetration is not None
    assert penetration(SURFACE) == 0.0
    for way in (1e-9, 1e-3, 0.02):
        assert penetration(SURFACE - inwards * way) == 0.0
        assert resting_force(element, SURFACE - inwards * way) == 0.0
        assert penetration(SURFACE + inwards * way) == pytest.approx(way, abs=1e-17)
        assert inwards * resting_force(element, SURFACE + inwards * way) < 0.0


def test_a_stop_is_deep_beyond_either_end() -> None:
    stop = EndStop("handle", 600.0, -0.03, 0.01)
    depths = [stop.penetration(position) for position in (-0.035, -0.03, 0.0, 0.01, 0.0125)]
    assert depths == pytest.approx([0.005, 0.0, 0.0, 0.0, 0.0025])
    forces = [resting_force(stop, position) for position in (-0.035, 0.0, 0.0125)]
    assert np.sign(forces).tolist() == [1.0, 0.0, -1.0]


def test_what_its_values_leave_without_a_surface_has_no_depth() -> None:
    assert Wall("handle", 600.0, SURFACE, sides="bilateral").penetration(1.0) is None
    assert VirtualCoupling("handle", 600.0, 0.1).penetration(1.0) is None
