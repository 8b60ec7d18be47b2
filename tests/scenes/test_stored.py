"""Statements of each element about its energy, against the work of its own force: quadrature, and motions at random."""

import itertools
from typing import Any, cast

import numpy as np
import pytest
import scipy.integrate

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import AnyElement, abilities
from haptic_fieldbus.scenes.registry import ELEMENTS, kind_of
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.texture import Texture
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Signal
from tests.cases import every
from tests.scenes.test_element_contract import EXAMPLES, SHEETS

LIBRARY: dict[str, AnyElement] = {
    f"{scene}.{element.name}": element for scene in scene_names() for element in load_scene(scene).elements
}
LIBRARY |= {
    f"example.{name}": element
    for name, (kind, element) in EXAMPLES.items()
    if kind not in set(map(kind_of, map(type, LIBRARY.values())))
}
"""Also the examples of kinds that no scene of the library has."""
MORE: dict[str, AnyElement] = {
    "bilateral": Wall("handle", 600.0, 0.01, sides="bilateral"),
    "left": Wall("handle", 600.0, 0.01, side="negative"),
    "sine": Texture("handle", 0.4, 0.006),
    "sharp": Texture("handle", 0.4, 0.006, profile="triangle", rounding=0.1),
    "round": Texture("handle", 0.4, 0.006, profile="triangle", rounding=1.0),
    "one-sided": Spring("handle", 300.0, dead_band=0.004, negative_coefficient=0.25, positive_saturation=1.5),
}
PLACES = np.linspace(-0.06, 0.06, 25)
PERIOD = 1e-3


def that_say(ability: str) -> list[str]:
    return [name for name, element in {**LIBRARY, **MORE}.items() if hasattr(element, ability)]


@every("kind", ELEMENTS)
def test_each_kind_states_its_energy_or_is_known_to_remember(kind: str) -> None:
    found = [element for element in LIBRARY.values() if kind_of(type(element)) == kind]
    stated = [abilities(each) for each in found]
    states = any(each.stored or each.reserve is not None or each.strongest for each in stated)
    assert states != SHEETS[kind].remembers, (
        f"{kind}: give it `stored`, `reserve` or `strongest`, so that its energy is known, or `remembers` to its sheet"
    )


@pytest.mark.thorough("quadrature of each", quick=4)
@pytest.mark.parametrize(
    "name", [each for each in that_say("stored") if "coupling" not in each and "shaft" not in each]
)
def test_what_is_stored_is_the_work_that_the_force_takes(name: str) -> None:
    """Of a handle at rest from place to place; tissue that flows stores at most what its springs would."""
    element = cast(Any, {**LIBRARY, **MORE}[name])
    if not hasattr(element, "force"):
        return
    for one, other in itertools.pairwise(PLACES):

        def force(x: float) -> float:
            return float(element.force(*(x if signal is Signal.POSITION else 0.0 for signal in element.needs)))

        work, _ = scipy.integrate.quad(force, one, other, limit=400)
        assert element.stored(float(other)) - element.stored(float(one)) == pytest.approx(-work, abs=2e-6)


@pytest.mark.thorough("motions at random, for each", quick=1)
@pytest.mark.parametrize("name", that_say("reserve"))
def test_a_memory_gives_back_no_more_than_its_reserve(name: str) -> None:
    """On motions of small steps at random, from any moment on; the half square of a step is the leak of its hold."""
    element, random = cast(Any, LIBRARY[name]), np.random.default_rng(7)
    for _ in range(20):
        law = law_of(element, PERIOD)
        steps = np.repeat(random.normal(0.0, 2e-5, 60), 25)
        path = 0.012 + np.cumsum(steps)
        forces = [
            law(*[x if signal is Signal.POSITION else step / PERIOD for signal in element.needs])
            for x, step in zip(path, steps, strict=True)
        ]
        given = np.concatenate([[0.0], np.cumsum(np.array(forces[:-1]) * np.diff(path))])
        most = float((given - np.minimum.accumulate(given)).max())
        stiffness = -float(element.linearised().d[0, 0])
        assert most <= element.reserve + 0.55 * stiffness * float((np.diff(path) ** 2).sum())


@pytest.mark.parametrize(
    "coupling", [Coupling(("a", "b"), 300.0), Coupling(("a", "b"), 300.0, ratio=-0.5, dead_band=0.002, saturation=2.0)]
)
def test_what_a_coupling_stores_is_the_work_of_both_of_its_forces(coupling: Coupling) -> None:
    law = coupling.begin(PERIOD)
    for a0, a1, b0, b1 in [(0.0, 0.02, 0.0, -0.01), (0.02, -0.03, -0.01, 0.03), (0.0, 0.001, 0.0, 0.0)]:

        def power(share: float, a0: float = a0, a1: float = a1, b0: float = b0, b1: float = b1) -> float:
            first, second = law(a0 + (a1 - a0) * share, b0 + (b1 - b0) * share)
            return float(first * (a1 - a0) + second * (b1 - b0))

        work, _ = scipy.integrate.quad(power, 0.0, 1.0, limit=400)
        assert coupling.stored(a1, b1) - coupling.stored(a0, b0) == pytest.approx(-work, abs=1e-6)


@pytest.mark.parametrize("name", that_say("strongest"))
def test_no_active_element_is_stronger_than_it_says(name: str) -> None:
    element = cast(Any, LIBRARY[name])
    if hasattr(element, "force") and element.strongest:
        forces = [abs(element.force(*(k * 4_000_000 for _ in element.needs))) for k in range(3_000)]
        assert 0.99 * element.strongest <= max(forces) <= element.strongest * (1 + 1e-12)
