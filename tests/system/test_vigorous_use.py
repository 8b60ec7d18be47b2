"""Vigorous use of every kind of element: what is called passive or stable never trips.

Values of the element and hands are drawn; a hand pushes, taps, swings or lets go, and gives two blows.
"""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.documents.quantities import Quantity
from haptic_fieldbus.errors import PlanError, SceneError
from haptic_fieldbus.margins import Verdict
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.hunt_crossley import HuntCrossley
from haptic_fieldbus.scenes.parameter_changes import changed
from haptic_fieldbus.scenes.registry import ELEMENTS, kind_of, quantities
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.hand import HANDS, Hand, Piece, hand_named
from tests.builders import endless_rig, scene_of

SCALED = {
    Quantity.LENGTH, Quantity.EFFORT, Quantity.STIFFNESS, Quantity.DAMPING, Quantity.MASS, Quantity.SPEED,
    Quantity.INVERSE_SPEED,
}  # fmt: skip
"""Quantities whose values are drawn, from a third to three times those of the library."""
IN_SCENES = {kind_of(type(each)) for name in scene_names() for each in load_scene(name).elements}
KINDS = tuple(kind for kind in sorted(ELEMENTS) if kind in IN_SCENES)
USES = 200
BLOW = Hand("blow", (Piece(0.5, 60.0), Piece(0.51, 0.0)))
GOOD = {Verdict.PASSIVE, Verdict.STABLE}


def scene_with(kind: str, random: np.random.Generator) -> Scene:
    """A scene of the library that has this kind of element, with drawn values; of bodies that stiffen any."""
    if kind == "hunt_crossley":
        effort, depth = 10.0 ** random.uniform(-2.0, 1.0), 10.0 ** random.uniform(-3.0, -1.7)
        exponent, loss = random.uniform(1.0, 4.0), random.choice([0.0, 0.3, 1.0])
        return scene_of(HuntCrossley("handle", effort, depth, exponent=exponent, loss=loss))
    found = [scene for scene in map(load_scene, scene_names()) if _names(scene, kind)]
    scene = found[random.integers(len(found))]
    drawn = {
        f"{name}.{field.name}": float(value * 10.0 ** random.uniform(-0.5, 0.5))
        for name, element in ((each.name, each) for each in scene.elements if each.name in _names(scene, kind))
        for field in dataclasses.fields(element)  # type: ignore[arg-type]
        if quantities(type(element)).get(field.name) in SCALED
        and isinstance(value := getattr(element, field.name), float)
    }
    return changed(scene, drawn)


def _names(scene: Scene, kind: str) -> list[str]:
    return [each.name for each in scene.elements if kind_of(type(each)) == kind]


def hand_with(random: np.random.Generator) -> Hand:
    """A hand of the simulation that also gives two blows of 20 to 80 N."""
    hand = hand_named(str(random.choice(["push", "tap", "sine", "release"])))
    assert hand is not None
    for at in (0.6, 1.1):
        blow = float(random.choice([-1.0, 1.0]) * random.uniform(20.0, 80.0))
        hand = hand.hitting(at, blow, float(random.uniform(0.004, 0.02)))
    return replace(hand, name="vigorous")


def drawn(seed: int) -> tuple[Scene, Hand]:
    """A scene that is called passive or stable on the endless bench, and a hand."""
    random = np.random.default_rng([26, seed])
    kind = KINDS[seed % len(KINDS)]
    while True:
        try:
            scene = scene_with(kind, random)
            axes = plan(scene, rig=endless_rig(scene)).axes
        except (SceneError, PlanError):  # the values contradict each other, or are refused
            continue
        if all(axis.stability is None or axis.stability.verdict in GOOD for axis in axes):
            return scene, hand_with(random)


def test_a_blow_of_60_n_on_a_body_that_stiffens_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """0.18 N at 10 mm with the exponent 2; the blow carries the handle far deeper, where it is steeper."""
    monkeypatch.setitem(HANDS, BLOW.name, BLOW)
    scene = scene_of(HuntCrossley("handle", 0.18, 0.01, exponent=2.0))
    stability = plan(scene, rig=endless_rig(scene)).axis("handle").stability
    assert stability is not None
    assert stability.verdict is Verdict.PASSIVE
    (ledger,) = run(scene, endless_rig(scene), hand=BLOW.name, duration=1.3).passivity
    assert ledger.largest < 0.1 * ledger.limit


@pytest.mark.thorough("200 runs of 1.6 s")
@pytest.mark.parametrize("seed", range(USES))
def test_vigorous_use_does_not_trip(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, hand = drawn(seed)
    monkeypatch.setitem(HANDS, hand.name, hand)
    for ledger in run(scene, endless_rig(scene), hand=hand.name, duration=1.6).passivity:
        assert ledger.largest < 0.5 * ledger.limit
