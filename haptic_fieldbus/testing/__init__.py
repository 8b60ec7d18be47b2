"""Simulated drives for tests of masters, and contracts of own parts.

`haptic_fieldbus.pytest_plugin` makes fixtures of the drives. Those on Modbus are in `testing.modbus`, so that tests on
CAN do without pymodbus. `check_element`, `check_estimator`, `check_integrator` and `check_hand` hold a part to its
contract; nothing here needs pytest.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import is_dataclass
from itertools import product
from typing import Any, cast

import numpy as np

from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.documents.own_parts import told_at
from haptic_fieldbus.errors import wrong_kind
from haptic_fieldbus.numerics import estimators
from haptic_fieldbus.numerics.estimators import Estimator
from haptic_fieldbus.numerics.integrators import Integrator, rest
from haptic_fieldbus.numerics.integrators.method import follow
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, expm
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.scenes.element import (
    AnyElement,
    CouplingElement,
    DynamicElement,
    MemoryElement,
    StaticElement,
    is_varying,
)
from haptic_fieldbus.scenes.own_faults import shape_fault
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim.hand import Hand, hand_faults
from haptic_fieldbus.testing.bench import DriveRequest as DriveRequest
from haptic_fieldbus.testing.bench import FaultPlan as FaultPlan
from haptic_fieldbus.testing.bench import SimulatedDrive as SimulatedDrive
from haptic_fieldbus.testing.bench import Time as Time
from haptic_fieldbus.testing.bench import VirtualCanBus as VirtualCanBus
from haptic_fieldbus.testing.bench import plan_faults as plan_faults

PERIOD = 1e-3
"""Period of the loop that a part is tried in [s]."""
FURTHER = 1e-9
"""Step of the difference quotients [m or rad]."""
REACH = (0.0, 0.03)
"""Middle and amplitude of the motions that an element is tried with, unless others are given [m or rad]."""
GROWN = 1e-8
"""Growth of a spectral radius beyond 1 that is more than rounding."""
Reach = tuple[float, float]
Check = Callable[..., Iterator[str]]


def check_element(element: AnyElement, reach: Reach = REACH) -> None:
    """Try an element, and raise AssertionError with all that breaks its contract.

    `reach` is middle and amplitude of the positions at which the element is used [m or rad]. Raises TypeError for an
    object that is no element, and for another reach.
    """
    wanted = ("name", "needs", "linearised")
    on_an_axis = hasattr(element, "axis") or hasattr(element, "axes")
    if isinstance(element, type) or not on_an_axis or not all(hasattr(element, each) for each in wanted):
        raise wrong_kind("element", f"an object with {', '.join(wanted)}, axis or axes, a law", element)
    match reach:
        case (int() | float() as middle, int() | float() as amplitude) if math.isfinite(middle) and 0 < amplitude < 1e6:
            pass
        case _:
            raise wrong_kind("reach", "a middle, and an amplitude above 0 and below 1e6", reach)
    _judge(element, (_form, _needs_and_linear_model, _steepness, _bounds, _force, _not_a_number), reach)


def check_estimator(estimator: Estimator) -> None:
    """Try a velocity estimator with its default parameters, and raise AssertionError with all that breaks its contract.

    Raises TypeError for an object of another class.
    """
    _judge_as(Estimator, estimator, _velocity, _linear_system)


def check_integrator(integrator: Integrator) -> None:
    """Try a method on oscillators and decays, and raise AssertionError with all that breaks its contract.

    Raises TypeError for an object of another class.
    """
    _judge_as(Integrator, integrator, _rest, _claims, _limits)


def check_hand(hand: Hand) -> None:
    """Raise AssertionError with all reasons why a hand cannot be simulated.

    Raises TypeError for an object of another class.
    """
    _judge_as(Hand, hand, hand_faults)


def _judge_as(kind: type, part: object, *checks: Check) -> None:
    """Judge a part of this class; raises TypeError for another object."""
    if not isinstance(part, kind):
        raise wrong_kind(kind.__name__.lower(), f"an object of {kind.__name__}", part)
    _judge(part, checks)


def _judge(part: Any, checks: Iterable[Check], *arguments: Any) -> None:
    """Raise AssertionError with the faults of all checks; an error in the code of the part is a fault of it."""
    faults: list[str] = []
    for check in checks:
        try:
            faults += check(part, *arguments)
        except Exception as error:  # foreign code may raise anything
            faults.append(f"{check.__name__.strip('_').replace('_', ' ')}: {told_at(error)}")
    if faults:
        raise AssertionError("\n".join(f"{part.name}: {fault}" for fault in faults))


# An element.


def axis_count(element: AnyElement) -> int:
    """Return the number of axes that an element acts on."""
    return 2 if isinstance(element, CouplingElement) else 1


def law(element: Any) -> Any:
    """Return the law of an element with a fresh memory, at `PERIOD`."""
    return element.begin(PERIOD) if isinstance(element, CouplingElement) else law_of(element, PERIOD)


def feedback(element: AnyElement, values: list[float]) -> Iterator[list[Any]]:
    """Yield all combinations of the values for the signals that an element needs; time goes on."""
    signals = element.needs * axis_count(element)
    for number, combination in enumerate(product(values, repeat=len(signals))):
        yield [
            1_000_000 * number if signal is Signal.ELAPSED_NS else value
            for signal, value in zip(signals, combination, strict=True)
        ]


def _numbers(found: Any) -> tuple[Any, ...]:
    return found if isinstance(found, tuple) else (found,)


def _form(element: Any, reach: Reach) -> Iterator[str]:
    """Check the class: a frozen dataclass with one law, and a text as its name."""
    if not isinstance(element.name, str):
        yield f"name: expected a text, not {element.name!r}"
    if not is_dataclass(element) or not cast(Any, element).__dataclass_params__.frozen:
        yield "expected a frozen dataclass"
    kinds = (StaticElement, MemoryElement, DynamicElement, CouplingElement)
    found = [kind.__name__ for kind in kinds if isinstance(element, kind)]
    if len(found) != 1:
        yield f"expected one of force, begin and dynamics, found the members of {' and '.join(found) or 'none'}"


def _needs_and_linear_model(element: AnyElement, reach: Reach) -> Iterator[str]:
    """Check that each signal is needed once, and the shapes of the linear model."""
    fault = shape_fault(element)
    if fault:
        yield fault
        return
    if len(set(element.needs)) != len(element.needs):
        yield f"needs a signal twice: {', '.join(map(str, element.needs))}"
    space, axes = element.linearised(), axis_count(element)
    expected = ((space.order, 2 * axes), (axes, space.order), (axes, 2 * axes))
    if (space.b.shape, space.c.shape, space.d.shape) != expected:
        yield f"linearised() has matrices B, C, D of the shapes {space.b.shape}, {space.c.shape}, {space.d.shape}"
    if space.uses_velocity and Signal.VELOCITY not in element.needs:
        yield "linearised() uses the velocity, which the element does not need"


def _steepness(element: Any, reach: Reach) -> Iterator[str]:
    """Check at 997 places that the force at rest is nowhere steeper than its bounds, or than `linearised`."""
    if not isinstance(element, StaticElement) or Signal.POSITION not in element.needs:
        return
    (middle, amplitude), felt = reach, law(element)

    def force(position: float) -> float:
        return float(felt(*[position if signal is Signal.POSITION else 0 for signal in element.needs]))

    stated = -float(element.linearised().d[0, 0])
    for share in np.linspace(-1.0, 1.0, 997) + 1e-4 / math.sqrt(2.0):
        x = middle + amplitude * share
        slope = (force(x - FURTHER) - force(x + FURTHER)) / (2.0 * FURTHER)
        low, high = element.local(x - FURTHER, x + FURTHER).stiffness if is_varying(element) else (-math.inf, stated)
        slack = 1e-3 * abs(stated) + 1e-4
        if not low - slack <= slope <= high + slack:
            yield f"stiffness {slope:.6g} at {x:.6g}, but it states {low:.6g} to {high:.6g}"
            return


def _bounds(element: Any, reach: Reach) -> Iterator[str]:
    """Check the bounds of `local` between random places."""
    if not is_varying(element):
        return
    (middle, amplitude), random, felt = reach, np.random.default_rng(11), law(element)
    others = [0.0] * (len(element.needs) - 1)
    for low, high in np.sort(middle + amplitude * random.uniform(-1.5, 1.5, (12, 2))).tolist():
        bounds, x = element.local(low, high), np.linspace(low, high, 300)
        force = np.array([felt(float(each), *others) for each in x])
        slope = -np.diff(force) / np.diff(x)
        stiff, strong = 1e-6 * (1.0 + np.abs(bounds.stiffness).max()), 1e-9 * (1.0 + np.abs(force).max())
        if slope.min() < bounds.stiffness[0] - stiff or slope.max() > bounds.stiffness[1] + stiff:
            yield f"stiffness {slope.min():.6g} to {slope.max():.6g} from {low:.6g} to {high:.6g}, beyond its bounds"
        if force.min() < bounds.force[0] - strong or force.max() > bounds.force[1] + strong:
            yield f"force {force.min():.6g} to {force.max():.6g} from {low:.6g} to {high:.6g}, beyond its bounds"


def _force(element: AnyElement, reach: Reach) -> Iterator[str]:
    """Check that the force is a finite float at any motion, and that each law starts afresh."""
    call = law(element)
    for values in feedback(element, [-1e3, -0.1, 0.0, 5e-324, 0.1, 1e3]):
        found = _numbers(call(*values))
        if len(found) != axis_count(element) or not all(type(each) is float and math.isfinite(each) for each in found):
            yield f"force {found} at {values}; expected {axis_count(element)} finite float"
            break
    motion = list(feedback(element, [-0.01, 0.02]))
    first, beside = law(element), law(element)
    together = [(first(*values), beside(*values)) for values in motion]
    afterwards = law(element)
    if any(not one == other == afterwards(*values) for (one, other), values in zip(together, motion, strict=True)):
        yield "two laws of it give different forces for one motion: the memory of one acts on the other"


def _not_a_number(element: AnyElement, reach: Reach) -> Iterator[str]:
    """Check that not-a-number goes through and that a motion without end raises nothing: the cycle trips on both."""
    signals = element.needs * axis_count(element)
    if all(each is Signal.ELAPSED_NS for each in signals):
        return
    found = law(element)(*[0 if signal is Signal.ELAPSED_NS else math.nan for signal in signals])
    if not any(math.isnan(each) for each in _numbers(found)):
        yield f"not-a-number becomes the force {found}; let it through, as max(x, 0.0 * x) does"
    for end in (math.inf, -math.inf):
        felt = law(element)
        for value in (0.0, end, 0.0):
            felt(*[0 if signal is Signal.ELAPSED_NS else value for signal in signals])


# An estimator.


def _steps(estimator: Estimator, positions: Iterable[float]) -> list[Any]:
    """Return what a fresh step says of each position."""
    setup = estimators.ChosenEstimator(estimator, {}).setup(PERIOD, 1e-6)
    step = estimator.start(setup)
    return [step(x, round(1e9 * PERIOD * number)) if estimator.timed else step(x) for number, x in enumerate(positions)]


def _walk() -> list[float]:
    """Return positions of a handle that goes to and fro, in counts of 1 µm."""
    ways = np.cumsum(np.random.default_rng(3).normal(0.0, 2e-5, 400))
    found: list[float] = (np.round(ways / 1e-6) * 1e-6).tolist()
    return found


def _velocity(estimator: Estimator) -> Iterator[str]:
    """Check the velocities of a walk, at rest and at constant speed."""
    found = _steps(estimator, _walk())
    if not all(type(each) is float and math.isfinite(each) for each in found):
        yield "a velocity is not a finite float"
        return
    if found[0] != 0.0:
        yield f"the first velocity is {found[0]}; expected 0"
    if found != _steps(estimator, _walk()):
        yield "two fresh steps give different velocities: the memory of one acts on the other"
    if any(_steps(estimator, [0.25] * 200)):
        yield "a velocity other than 0 at rest"
    speed, last = 0.1, _steps(estimator, [0.1 * PERIOD * number for number in range(4000)])[-1]
    if not math.isclose(last, speed, rel_tol=0.02):
        yield f"velocity {last} after 4 s at a constant {speed}"


def _linear_system(estimator: Estimator) -> Iterator[str]:
    """Check that stability is judged by what the loop runs."""
    setup = estimators.ChosenEstimator(estimator, {}).setup(PERIOD, 1e-6)
    if estimator.system is None:
        if estimators.discrete(estimator.stand_in(setup), PERIOD) is None:
            yield f'stand_in "{estimator.stand_in(setup)}" is not linear'
        return
    system, walk = estimator.system(setup), _walk()
    if spectral_radius(system.a) >= 1.0:
        yield "system is not stable"
        return
    state, expected = np.zeros(system.order), []
    for x in np.array(walk) - walk[0]:
        expected.append(float(system.c[0] @ state + system.d[0, 0] * x))
        state = system.a @ state + system.b[:, 0] * x
    found = np.array(_steps(estimator, walk))
    if not np.allclose(found, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max()):
        yield "the step does not do what system says"


# An integrator.


def _oscillator(h: float) -> StateSpace:
    """Return an undamped oscillator of angular frequency h with the handle as its support, (position, velocity)."""
    return StateSpace(
        np.array([[0.0, 1.0], [-h * h, 0.0]]), np.array([[0.0, 0.0], [h * h, 0.0]]), np.array([[1.0, 0.0]]),
        np.array([[-1.0, 0.0]]),
    )  # fmt: skip


def _decay(rate: float) -> StateSpace:
    """Return a decay with a rate [1/s]."""
    return StateSpace(np.array([[-rate]]), np.zeros((1, 2)), np.ones((1, 1)), np.zeros((1, 2)))


def _free_error(integrator: Integrator, steps: int) -> float:
    """Return the error of an undamped oscillator after 1 s without input, from a given state."""
    a = np.array([[0.0, 1.0], [-4.0, 0.0]])
    space = StateSpace(a, np.zeros((2, 2)), np.array([[1.0, 0.0]]), np.zeros((1, 2)))
    begin = np.array([1.0, 0.3])
    found = follow(integrator.discretise(space, 1.0 / steps), np.zeros((steps + 1, 2)), begin).states[-1]
    return float(np.abs(found - expm(a) @ begin).max())


def _driven_error(integrator: Integrator, steps: int) -> float:
    """Return the largest error of an oscillator at rest whose support moves as 1 − cos(2·t), over 1 s."""
    own, driven, t = 3.0, 2.0, np.linspace(0.0, 1.0, steps + 1)
    inputs = np.column_stack([1.0 - np.cos(driven * t), driven * np.sin(driven * t)])
    exact = (np.cos(driven * t) - np.cos(own * t)) / (1.0 - (own / driven) ** 2)
    found = follow(integrator.discretise(_oscillator(own), 1.0 / steps), inputs, (0.0, 0.0)).outputs[:, 0]
    return float(np.abs(found - exact).max())


def _rest(integrator: Integrator) -> Iterator[str]:
    """Check shapes, finite entries, and that virtual states at rest stay there."""
    space = _oscillator(3.0)
    one = integrator.discretise(space, 0.01)
    step = one.increments
    if (step.a.shape, step.b.shape, step.c.shape, step.d.shape) != ((2, 2), (2, 2), (1, 2), (1, 2)):
        yield "increments have other shapes than the system"
        return
    if not all(np.isfinite(each).all() for each in (step.a, step.b, step.c, step.d, *one.state)):
        yield "increments or state have an entry that is not finite"
        return
    state, _ = rest(space)
    inputs: Matrix = np.array([1.0, 0.0])
    if np.abs(step.a @ one.stored(state, inputs) + step.b @ inputs).max() > 1e-9:
        yield "virtual states at rest begin to move"


def _radius(integrator: Integrator, space: StateSpace) -> float:
    return spectral_radius(integrator.discretise(space, 1.0).system.a)


def _limits(integrator: Integrator) -> Iterator[str]:
    """Check that oscillators and decays grow just beyond the limits that the method claims, and not before."""
    for name, space in (("oscillator_limit", _oscillator), ("lag_limit", _decay)):
        limit: float = getattr(integrator, name)
        # Of a limit of 0 nothing is within, and nothing is beyond an infinite one.
        for share, grows in ((1.0 - 1e-3, False), (1.0 + 1e-3, True)):
            h = share * limit if 0.0 < limit < math.inf else 0.1 if grows else 1e3
            found = _radius(integrator, space(h))
            if limit != (math.inf if grows else 0.0) and (found <= 1.0 + GROWN) is grows:
                yield f"{name} {limit:.9g}: spectral radius {found:.9g} at {h:.9g}"


def _claims(integrator: Integrator) -> Iterator[str]:
    """Check growth and order that the method claims."""
    for h in (0.1, 0.5, 1.0):
        found, claimed = _radius(integrator, _oscillator(h)), integrator.oscillator_growth(h)
        if not math.isclose(found, claimed, rel_tol=1e-6):
            yield f"spectral radius {found:.9g} on an oscillator of h = {h}, claimed {claimed:.9g}"
    if integrator.growth is not None:
        found, claimed = _radius(integrator, _decay(0.3)), abs(integrator.growth(-0.3))
        if not math.isclose(found, claimed, rel_tol=1e-9):
            yield f"growth {found:.9g} of a decay with λ·T = -0.3, claimed {claimed:.9g}"
    motions = (("free", _free_error, integrator.free_order), ("driven", _driven_error, integrator.order))
    for motion, error, order in motions:
        coarse, fine = (error(integrator, steps) for steps in (64, 128))
        if coarse > 1e-11 and math.log2(coarse / fine) < order - 0.3:
            yield f"error of a {motion} motion falls with order {math.log2(coarse / fine):.2f}, claimed {order}"
