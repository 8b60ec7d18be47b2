"""The energy of axes that are judged together, in whole runs."""

from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.energy import Ledger, LedgerAxis, SentTorque, shares
from haptic_fieldbus.cycle.energy_steps import bind_ledger
from haptic_fieldbus.cycle.laws import AxisState, Sensed
from haptic_fieldbus.cycle.safety import Permission
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.planning.energy import ledger_elements
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.element import PairLaw
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import endless_rig, plan_of, scene_of
from tests.cycle.test_cycle import image

STIFFNESS = 400.0


@dataclass(frozen=True)
class LoudShaft(Coupling):
    """A shaft whose second side pushes as hard as ever on its way back, and half as hard on the way in."""

    def begin(self, period: float) -> PairLaw:
        sound, twist = super().begin(period), 0.0

        def law(first: float, second: float) -> tuple[float, float]:
            nonlocal twist
            before, twist = twist, abs(first - second)
            force, back = sound(first, second)
            return (0.5 * force, 0.5 * back) if twist > before else (force, back)

        return law


@pytest.mark.thorough("a run with and without the controller", quick=("True",))
@pytest.mark.parametrize("controls", [False, True])
def test_a_shaft_is_judged_as_one(controls: bool) -> None:
    scene = load_scene("virtual_shaft")
    shaft = scene.couplings[0]
    assert isinstance(shaft, Coupling)
    sound = replace(scene, passivity="controller" if controls else "observer")
    (ledger,) = run(sound, hand="push", duration=1.5).passivity
    assert ledger.axes == ("left", "right")
    assert ledger.largest < 0.1 * ledger.limit


def test_a_shaft_that_gives_energy_ends_the_run() -> None:
    scene = load_scene("virtual_shaft")
    shaft = scene.couplings[0]
    assert isinstance(shaft, Coupling)
    loud = LoudShaft(shaft.axes, shaft.stiffness, name=shaft.name)
    with pytest.raises(SafetyTripError, match="more into the handle than allowed"):
        run(replace(scene, elements=(loud, *scene.elements[1:])), hand="sine", duration=5.0)


def test_an_axis_with_a_virtual_mass_and_the_controller_keeps_its_account() -> None:
    scene = replace(load_scene("sprung_mass"), passivity="controller")
    (ledger,) = run(scene, endless_rig(scene), hand="tap", duration=1.5).passivity
    assert ledger.largest < ledger.limit


class TiedBench:
    """A ledger of two axes on a spring, of which the left one is moved by hand, and the right one stands still."""

    def __init__(self, permission: Permission) -> None:
        self.permission = permission
        plan = plan_of(scene_of(Coupling(("left", "right"), STIFFNESS)))
        self.states = AxisState(), AxisState()
        self._unit = plan.axes[0].effort_unit
        ports = [
            LedgerAxis(axis, state, Sensed(), permission) for axis, state in zip(plan.axes, self.states, strict=True)
        ]
        self.ledger = Ledger(ports, *ledger_elements(plan, plan.axes), plan.period, lambda *trip: None)
        self._step = bind_ledger(self.ledger, controls=False)

    def move(self, position: float, force: float, law: float) -> None:
        """Latch a position of the left handle, and send a force on both sides; the scene's law asks for `law`."""
        left, right = self.states
        left.position = position
        self._step()
        for state, sent, asked in ((left, force, law), (right, -force, -law)):
            state.target, state.force = round(sent / self._unit), asked


def test_what_a_shaft_gives_while_the_limit_fades_in_is_booked_and_not_judged() -> None:
    """Pulled out by hand against half of its force, and pulled back by all of it: K·s²/4 more comes back.

    So slowly that the leak is small.
    """
    bench, stretch, periods = TiedBench(Permission(fade=0.5)), 0.01, 2000
    for k in range(periods + 1):
        out = 2 * k <= periods
        position = stretch * (2 * k if out else 2 * (periods - k)) / periods
        bench.move(position, -STIFFNESS * position * (0.5 if out else 1.0), -STIFFNESS * position)
    for _ in range(20):
        bench.move(0.0, 0.0, 0.0)
    assert bench.ledger.tally.largest == pytest.approx(0.0, abs=1e-6)
    assert bench.ledger.tally.booked["fade-in"] == pytest.approx(0.25 * STIFFNESS * stretch**2, rel=0.05)


def test_the_controller_damps_by_twice_what_takes_the_leak_and_no_more() -> None:
    """Five times the force on the way out than on the way in is more than all of the damping takes in a period."""
    plan = plan_of(scene_of(Spring("handle", STIFFNESS)))
    (axis,), state, sensed = plan.axes, AxisState(), Sensed()
    port = LedgerAxis(axis, state, sensed, Permission(fade=1.0, unchanged=True))
    ledger = Ledger([port], *ledger_elements(plan, plan.axes), plan.period, lambda *trip: None)
    step, way = bind_ledger(ledger, controls=True), 1e-4
    for number, place in enumerate([*range(1, 40), *range(38, 20, -1)]):
        state.position = place * way
        step()
        asked = -STIFFNESS * place * way * (1.0 if number < 39 else 5.0)
        state.target, state.force = round(asked / axis.effort_unit), asked
    age = 0.5 * plan.period + axis.delay.total
    assert sensed.damped == pytest.approx(2.0 * STIFFNESS * age * way / plan.period, rel=1e-9)


@pytest.mark.parametrize("missing", [1, 2])
def test_the_work_of_a_law_through_a_missing_sample_is_that_of_its_spring(missing: int) -> None:
    """Along a straight line, the force of each period held by the trapezoid, and the last one up to the sample."""
    stiffness, way = 100.0, 12 * 0.05 / 4096 / (1 + missing)
    cycle = Cycle(plan_of(scene_of(Wall("handle", stiffness))))
    for number in range(600):
        cycle(image(t_ns=number * 1_000_000))
    cycle(image(12, t_ns=(600 + missing) * 1_000_000))
    forces = [-stiffness * step * way for step in range(1 + missing)]
    work = sum(0.5 * (one + other) * way for one, other in pairwise(forces)) + forces[-1] * way
    assert cycle.axes["handle"].state.led_work == pytest.approx(work, rel=1e-9)


def test_the_energy_of_sent_torque_counts_the_torque_of_each_period_on_its_way() -> None:
    """Torque that was held before the account began acts only in periods that were not seen."""
    state = SimpleNamespace(position=0.0, steps=1, target=0)
    permission = SimpleNamespace(held=1e3)
    port: Any = SimpleNamespace(axis=SimpleNamespace(effort_unit=0.1), state=state, permission=permission)
    sent = SentTorque(port)
    for target, position in ((5, 0.01), (-3, 0.03), (8, 0.02)):
        state.target, state.position = target, position
        sent.take()
    assert sent.given == pytest.approx(0.5 * 0.01 - 0.3 * 0.02 - 0.8 * 0.01)
    assert sent.path == pytest.approx(0.04)
    state.target, state.position, state.steps = 4, 0.05, 3
    sent.take()
    assert sent.given == pytest.approx(0.5 * 0.01 - 0.3 * 0.02 - 0.8 * 0.01 + 0.03 * (0.4 + 2 * 1e3) / 3)


def test_the_controller_takes_an_excess_back_within_four_periods() -> None:
    """A force that is stronger in one period gives too much energy; the damping of the next one takes a quarter."""
    plan = plan_of(scene_of(Spring("handle", STIFFNESS)))
    (axis,), state, sensed, way = plan.axes, AxisState(), Sensed(), 1e-4
    port = LedgerAxis(axis, state, sensed, Permission(fade=1.0, unchanged=True))
    ledger = Ledger([port], *ledger_elements(plan, plan.axes), plan.period, lambda *trip: None)
    step = bind_ledger(ledger, controls=True)
    whole, share = shares(axis, plan.period)
    assert not whole, "the force acts within the period"
    taken = []
    for place in range(40):
        state.position = place * way
        step()
        taken.append(-sensed.damped * way)
        # The mean force on the way is that of the spring, so that the spring itself gives nothing.
        asked = -STIFFNESS * way * (place + 0.5 + share) + (0.2 if place == 20 else 0.0)
        state.target, state.force = asked / axis.effort_unit, asked  # type: ignore[assignment]
    excess = 0.2 * (1.0 - share) * way
    assert taken[20] == pytest.approx(0.0, abs=0.01 * excess)
    assert taken[21] == pytest.approx(0.25 * excess, rel=0.02)
