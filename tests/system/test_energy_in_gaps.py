"""Scenes with a source of energy while feedback is lost again and again, and scenes without one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import HapticFieldbusError, SafetyTripError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.catalogue import load_scene, scene_names
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import AnyElement, Law, PairLaw
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.faults import AnswerLost, Fault, MissingTpdos
from tests.builders import endless_rig
from tests.system.test_run import LINEAR

SURFACE = 0.02


@dataclass(frozen=True)
class Harder:
    """A wall that pushes out harder than in, by a factor, and calls itself passive; it states what a wall stores."""

    axis: str
    stiffness: float = 600.0
    factor: float = 1.3
    name: str = "harder"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        deepest = 0.0

        def law(position: float) -> float:
            nonlocal deepest
            depth = max(position - SURFACE, 0.0)
            deepest = max(deepest, depth) if depth else 0.0
            return -self.stiffness * depth * (self.factor if depth < deepest - 2e-5 else 1.0)

        return law

    def stored(self, position: float) -> float:
        return 0.5 * self.stiffness * max(position - SURFACE, 0.0) ** 2

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


@dataclass(frozen=True)
class HarderUnstated:
    """The same wall, which states nothing of what it stores."""

    axis: str
    stiffness: float = 600.0
    factor: float = 1.3
    name: str = "harder"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        return Harder(self.axis, self.stiffness, self.factor).begin(period)

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


@dataclass(frozen=True)
class LoudShaft(Coupling):
    """A shaft that pushes back harder than it was twisted."""

    def begin(self, period: float) -> PairLaw:
        sound, most = super().begin(period), 0.0

        def law(first: float, second: float) -> tuple[float, float]:
            nonlocal most
            twist = abs(first - second)
            most = max(most, twist) if twist > 5e-4 else twist
            force, back = sound(first, second)
            factor = 1.6 if twist < most - 2e-5 else 1.0
            return factor * force, factor * back

        return law


def scene_with(*elements: AnyElement) -> Scene:
    return Scene("planted", "for tests", LINEAR, elements)


def gaps(first: float, last: float, missing: int = 2, every: float = 0.1) -> list[MissingTpdos]:
    """So many samples lost, each tenth of a second."""
    return [MissingTpdos("missing_tpdos", first + every * k, missing) for k in range(int((last - first) / every))]


def tripped(scene: Scene, faults: Sequence[Fault], rig: Rig | None = None, **options: object) -> Result:
    """The result of a run that its energy ended."""
    rig = rig or endless_rig(scene)
    with pytest.raises(SafetyTripError, match="more into the handle than allowed") as caught:
        run(scene, rig, duration=8.0, faults=faults, **options)  # type: ignore[arg-type]
    result = result_of(caught.value)
    assert [trip.name for trip in result.trips] == ["energy limit"]
    return result


def result_of(caught: HapticFieldbusError) -> Result:
    assert isinstance(caught.result, Result)
    return caught.result


def ended(result: Result) -> float:
    """When it tripped [s]."""
    (trip,) = result.trips
    assert trip.time is not None
    return trip.time


@pytest.mark.thorough("two kinds of own elements, three hands", quick=("Harder-tap",))
@pytest.mark.parametrize("hand", ["tap", "push", "sine"])
@pytest.mark.parametrize("kind", [Harder, HarderUnstated])
def test_a_wall_that_pushes_out_a_third_harder_trips_within_a_second_of_its_first_gap(
    kind: type[Harder], hand: str
) -> None:
    """Two samples of each tenth of a second are lost, one fiftieth; before, 15 N swung the handle for 8 s."""
    assert ended(tripped(scene_with(kind("handle")), gaps(0.7, 8.0), hand=hand)) < 1.7


@pytest.mark.thorough("another way to lose feedback")
@pytest.mark.parametrize("missing", [3, 9, 14, 20])
def test_it_trips_after_gaps_of_any_length(missing: int) -> None:
    assert ended(tripped(scene_with(Harder("handle")), gaps(0.7, 8.0, missing, 0.2), hand="tap")) < 1.7


@pytest.mark.thorough("another bus")
def test_it_trips_on_modbus_where_answers_are_lost() -> None:
    scene = scene_with(Harder("handle", 80.0, 1.8))
    lost = [AnswerLost("answer_lost", 0.7 + 0.25 * k, 1) for k in range(28)]
    bus = "sim-modbus-rtu@115200"
    result = tripped(scene, lost, endless_rig(scene, "generic_cia402_modbus", bus), bus=bus, rate=50.0, hand="sine")
    assert ended(result) < 2.0


@pytest.mark.thorough("two axes")
def test_a_shaft_that_gives_energy_trips_in_gaps() -> None:
    scene = load_scene("virtual_shaft")
    shaft = scene.couplings[0]
    assert isinstance(shaft, Coupling)
    loud = LoudShaft(shaft.axes, shaft.stiffness, name=shaft.name)
    # More gaps would end the run by themselves: the shaft has little margin, and a gap of one handle is one of both.
    tripped(replace(scene, elements=(loud, *scene.elements[1:])), gaps(0.7, 8.0, 2, 0.4), hand="sine")


@pytest.mark.thorough("all scenes, hands and lengths of gaps", quick=("dahl-sine",))
@pytest.mark.parametrize("hand", ["push", "sine"])
@pytest.mark.parametrize("scene", scene_names())
def test_no_scene_of_the_library_trips_by_energy_in_gaps(scene: str, hand: str) -> None:
    """Short and long gaps, one after another; what ends a run may be anything else."""
    for missing, every in ((2, 0.02), (14, 0.1), (20, 0.15)):
        faults = gaps(0.15, 2.0, missing, every)
        try:
            result = run(scene, endless_rig(scene), duration=2.0, hand=hand, fade_in=0.1, faults=faults, force=True)
        except HapticFieldbusError as caught:
            result = result_of(caught)
        assert not {trip.name for trip in result.trips} & {"energy limit", "energy forgiven", "energy of held torque"}
        assert all(each.largest < 0.5 * each.limit for each in result.passivity)
        assert all(each.forgiven < 0.1 * each.forgiven_limit for each in result.passivity)


def test_a_hand_that_presses_on_through_a_long_gap_gets_nothing_back_for_that_way() -> None:
    """Before, the force of before the gap did 9 mJ along that way, which were forgiven."""
    found = run("wall", endless_rig("wall"), duration=1.5, faults=[MissingTpdos("missing_tpdos", 1.0, 25)])
    (ledger,) = found.passivity
    assert ledger.booked == {}
    assert ledger.held < 0.001
    assert ledger.largest < 0.001
