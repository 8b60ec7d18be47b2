"""The resonance of an elastic shaft: two inertias with a spring, whose frequency has a closed form."""

import math
from dataclasses import replace

import pytest

from haptic_fieldbus.drive.rig import Cogging, CompliantCoupling, Mechanics, Stribeck
from haptic_fieldbus.identification.fit import ShaftFit
from haptic_fieldbus.identification.shaft import ShaftModel
from haptic_fieldbus.sim.mechanics.loaded_plant import Load, LoadedPlant
from haptic_fieldbus.sim.mechanics.motion import Shaft
from tests.identification.benches import Bench, identified_bench

MODEL = ShaftModel(4e-5, 1e-4, 2e-3, 0.0008, 0.0002)
BENCH = Bench(MODEL, 4096, 1000.0, 0.1, 60.0, 8.0)


def fitted(bench: Bench, mechanics: Mechanics) -> ShaftFit:
    """The fit to both experiments."""
    model = bench.model
    plant = LoadedPlant(Load(Shaft(model.inertia, model.damping, model.coulomb, model.lag), mechanics), None)
    return identified_bench(bench, plant)[0]


def coupled(frequency: float, share: float, ratio: float) -> Mechanics:
    """A spring that lets motor and load swing at a frequency [Hz]: ω² = k·(J₁ + J₂)/(J₁·J₂)."""
    load = share * MODEL.inertia
    reduced = load * (1.0 - share)
    stiffness = (math.tau * frequency) ** 2 * reduced
    return Mechanics(coupling=CompliantCoupling(stiffness, load, 2.0 * ratio * math.sqrt(stiffness * reduced)))


@pytest.mark.thorough("fits five benches", quick=1)
@pytest.mark.parametrize(
    ("frequency", "share", "ratio", "counts"),
    [
        (65.6, 0.74, 0.02, 1024),
        (33.6, 0.65, 0.05, 20_000),
        (24.9, 0.35, 0.05, 1024),
        (20.2, 0.3, 0.005, 4096),
        (44.0, 0.35, 0.05, 20_000),
    ],
)
def test_the_frequency_of_an_elastic_shaft_is_told(frequency: float, share: float, ratio: float, counts: int) -> None:
    fit = fitted(replace(BENCH, counts=counts), coupled(frequency, share, ratio))
    assert fit.resonance is not None
    assert fit.resonance.low <= frequency <= fit.resonance.high < 1.25 * fit.resonance.low
    assert any("as with an elastic coupling" in each for each in fit.warnings)
    assert fit.model.waves == ()
    # As the warning says, the damping is wrong by at most a factor of two.
    assert 0.5 < fit.model.damping / MODEL.damping < 2.0


@pytest.mark.thorough("fits a bench")
def test_an_elastic_shaft_of_a_light_load_is_at_least_told_by_the_counts_that_are_left() -> None:
    """Its mode explains 9 to 11 % of the squares, so small changes of the motion decide whether it is named."""
    fit = fitted(replace(BENCH, counts=20_000), coupled(44.0, 0.24, 0.05))
    assert any("elastic coupling" in each for each in fit.warnings)
    assert fit.model.damping == pytest.approx(MODEL.damping, rel=0.1)


@pytest.mark.thorough("fits six benches")
@pytest.mark.parametrize(
    "mechanics",
    [
        Mechanics(cogging=Cogging(1e-3, 24)),
        Mechanics(cogging=Cogging(4e-3, 7)),
        Mechanics(stribeck=Stribeck(2e-3, 2.0)),
        Mechanics(coupling=CompliantCoupling(50.0, 2e-5, 1e-3, 0.01)),
        Mechanics(coupling=CompliantCoupling(200.0, 1e-5, 1e-3, 0.003)),
        Mechanics(),
    ],
    ids=["cogging", "coarse-cogging", "stribeck", "play", "little-play", "rigid"],
)
def test_nothing_else_is_taken_for_a_resonance(mechanics: Mechanics) -> None:
    fit = fitted(BENCH, mechanics)
    assert fit.resonance is None
