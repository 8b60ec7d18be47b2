"""The open loop: the force of a scene for a prescribed motion of the handle, as in a lecture.

The handle starts at rest, with virtual masses at rest at its position. A step moves it at the first sample, t = 0, and
finds the masses at rest at the old position. Nothing is fed back, so a growth comes from the method alone.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api.arguments import asked_of
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.defaults import (
    DEFAULT_AMPLITUDE,
    DEFAULT_ESTIMATOR,
    DEFAULT_METHOD,
    DEFAULT_MOTION,
    DEFAULT_MOTION_DURATION,
    DEFAULT_RATE,
)
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics.linear import StateSpace
from haptic_fieldbus.numerics.sampled import spectral_radius
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import check_rendering, parsed, with_settings
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.element import CouplingElement, DynamicElement, Element, Law
from haptic_fieldbus.scenes.own_faults import own_faults
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace

if TYPE_CHECKING:
    from haptic_fieldbus.numerics.estimators import Estimator
    from haptic_fieldbus.numerics.integrators import Integrator

# Prescribed motions of the handle: a step, a ramp, a sine, or the rows of a file.

Array = NDArray[np.float64]
Signals = Mapping[Signal, NDArray[Any]]
"""Feedback along a motion by its signal, `(n_samples,)` each."""

INPUT_FORMS = "step, ramp, sine@HZ or FILE.csv with the columns time and position"
LARGEST_FREQUENCY = 1e9
"""[Hz]"""


@dataclass(frozen=True, eq=False)
class PrescribedMotion:
    """A motion: the position `rest` before it [m or rad], and `at` from times `(n,)` [s] to positions `(n,)`."""

    rest: float
    at: Callable[[Array], Array]
    duration: float = DEFAULT_MOTION_DURATION
    frequency: float | None = None
    """Of a sine [Hz]."""

    def alias(self, period: float) -> float | None:
        """Return the frequency [Hz] that samples every `period` [s] show of a sine; None where it is its own."""
        if self.frequency is None or self.frequency < 0.5 / period:
            return None
        # A sine of half the rate is sampled where it is 0.
        return 0.0 if self.frequency == 0.5 / period else abs(math.remainder(self.frequency, 1.0 / period))


def motion_of(name: str | Path, amplitude: float) -> PrescribedMotion:
    """Return the motion of a name (`INPUT_FORMS`).

    Raises UsageError when there is none, and DocumentError for a file without one.
    """
    if not math.isfinite(amplitude):
        raise UsageError(f"amplitude {exactly(amplitude)}: expected a number")
    text = str(name)
    if text == "step":
        return PrescribedMotion(0.0, lambda time: np.full_like(time, amplitude))
    if text == "ramp":
        return PrescribedMotion(0.0, lambda time: amplitude * time)
    if text.startswith("sine@"):
        frequency = _frequency(text)
        turn = 2.0 * math.pi * frequency
        return PrescribedMotion(0.0, lambda time: amplitude * np.sin(turn * time), frequency=frequency)
    if Path(text).suffix == ".csv":
        return _recorded(Path(text), amplitude)
    raise UsageError(f'no input "{text}"; there are: {INPUT_FORMS}')


def _frequency(text: str) -> float:
    try:
        frequency = float(text.partition("@")[2])
    except ValueError:
        frequency = math.nan
    if not 0.0 < frequency <= LARGEST_FREQUENCY:
        expected = f"a frequency above 0 in Hz, at most {exactly(LARGEST_FREQUENCY)}, for example sine@2"
        raise UsageError(f'input "{text}": expected {expected} after @')
    return frequency


def _recorded(path: Path, amplitude: float) -> PrescribedMotion:
    """Return a motion on straight lines between the rows of a file; its first time becomes 0."""
    from haptic_fieldbus.documents.samples import read_samples  # a motion without a file does without it

    rows = read_samples(path, ("position",))
    # Where an amplitude is too large for the positions, the response ends before its first sample.
    with np.errstate(over="ignore"):
        first, places = rows.times[0], amplitude * rows.values
    return PrescribedMotion(
        float(places[0]), lambda time: np.interp(first + time, rows.times, places), float(rows.times[-1] - first)
    )


MOST_SAMPLES = 2_000_000
"""Most samples of a response; all of them are kept in memory."""
STATE_NAMES = ("position", "velocity")
"""Names of the first two virtual states of an element that does not name its own; further states are numbered."""


@dataclass(frozen=True, kw_only=True)
class OpenLoop:
    """The prescribed motion of the handle."""

    input: str | Path = DEFAULT_MOTION
    """The motion: step, ramp, sine@HZ, or a file with the columns time and position."""
    amplitude: float = DEFAULT_AMPLITUDE
    """Size of the motion [m or rad]; the positions of a file are multiplied by it."""
    duration: float | None = None
    """Duration [s]; None is that of the file, or one second."""


@dataclass(frozen=True, eq=False)
class Response:
    """Time [s], position of the handle [m or rad] and force on it [N or N·m], each of shape `(n_samples,)`."""

    time: Array = field(repr=False)
    position: Array = field(repr=False)
    force: Array = field(repr=False)
    states: Mapping[str, Array] = field(repr=False)
    """Virtual states `(n_samples,)` by name; the states of a second element have the name of the element as prefix."""
    spectral_radius: float | None
    """The largest of all elements, for one step of the method; None without virtual states."""
    diverged: bool
    """True if a value was not finite; the samples end before it."""
    workspace: Workspace = Workspace.LINEAR
    method: str | None = None
    alias: float | None = None
    """Alias frequency [Hz] of a sine above half the rate; None for any other motion."""

    def to_json(self) -> dict[str, object]:
        """Return the object that `response --json` prints."""
        return {
            "time": self.time.tolist(),
            "position": self.position.tolist(),
            "force": self.force.tolist(),
            "states": {name: values.tolist() for name, values in self.states.items()},
            "spectral_radius": self.spectral_radius,
            "diverged": self.diverged,
        }


def response(
    scene: str | Path | Scene,
    *,
    rate: float | None = None,
    settings: Mapping[str, Setting] | None = None,
    method: "str | Integrator | None" = None,
    estimator: "str | Estimator | None" = None,
    input: str | Path = DEFAULT_MOTION,
    amplitude: float = DEFAULT_AMPLITUDE,
    duration: float | None = None,
) -> Response:
    """Return the force on the scene's first axis for a prescribed motion; axes coupled to it stand still.

    `input` is "step", "ramp" (reaches `amplitude` after one second), "sine@HZ" or a file with the columns time and
    position; `amplitude` multiplies the positions. `rate` is in Hz, `duration` in s; a file has a duration of its own.
    Raises DocumentError or UsageError.
    """
    return open_loop(*asked_of("response", locals(), Task, OpenLoop))


@own_faults()
def open_loop(task: Task, asked: OpenLoop) -> Response:
    """Return the response of the scene of a task, as `response` does."""
    duration, motion = asked.duration, motion_of(asked.input, asked.amplitude)
    check_request(rate=task.rate, duration=DEFAULT_MOTION_DURATION if duration is None else duration)
    period, axis, elements = rendered_axis(task)
    # Both ends are sampled.
    samples = round((motion.duration if duration is None else duration) / period) + 1
    if samples > MOST_SAMPLES:
        expected = f"expected at most {MOST_SAMPLES}: a shorter duration"
        raise UsageError(f"{samples} samples of {exactly(period)} s; {expected}")
    time = period * np.arange(samples, dtype=np.float64)
    position, method = motion.at(time), task.method or DEFAULT_METHOD
    needs_velocity = any(Signal.VELOCITY in element.needs for element in elements)
    estimator = (task.estimator or DEFAULT_ESTIMATOR) if needs_velocity else None
    signals: Signals = {
        Signal.POSITION: position,
        Signal.VELOCITY: _velocity(position, motion.rest, period, estimator),
        Signal.ELAPSED_NS: round(1e9 * period) * np.arange(samples),
    }
    forces, states, radii = list[Array](), dict[str, Array](), list[float]()
    for element in elements:
        if missing := [signal.value for signal in element.needs if signal not in signals]:
            raise UsageError(f"element {element.name} needs {missing[0]}, which a prescribed motion does not have")
        with own_faults(element):
            force, own, radius = _answer(element, signals, motion.rest, period, method)
        forces.append(force)
        states |= {f"{element.name}.{name}" if states else name: values for name, values in own.items()}
        radii += [] if radius is None else [radius]
    rows = min(map(len, forces), default=samples)  # they end where the first element diverges
    force = np.sum([each[:rows] for each in forces], axis=0) if forces else np.zeros(rows)
    finite = np.isfinite(force)
    rows = rows if finite.all() else int(np.argmin(finite))
    states = {name: values[:rows] for name, values in states.items()}
    return Response(
        time[:rows], position[:rows], force[:rows], states, max(radii, default=None), rows < samples, axis.workspace,
        method if radii else None, motion.alias(period),
    )  # fmt: skip


def rendered_axis(task: Task) -> tuple[float, SceneAxis, tuple[Element, ...]]:
    """Return the period [s], the first axis of the scene, and its elements, with couplings felt at this axis alone.

    Raises DocumentError or UsageError.
    """
    rate = DEFAULT_RATE if task.rate is None else task.rate
    check_request(rate=rate)
    check_rendering(task)
    period = round(1e9 / rate) * 1e-9
    scene = with_settings(task.scene, parsed(task.settings)).at_period(period)
    axis = scene.axes[0]
    grounded = (GroundedCoupling(axis.name, each) for each in scene.couplings if axis.name in each.axes)
    return period, axis, (*scene.of_axis(axis.name), *grounded)


@dataclass(frozen=True)
class GroundedCoupling:
    """A coupling as felt on one of its axes while the other stands still at 0."""

    axis: str
    coupling: CouplingElement

    @property
    def name(self) -> str:
        return self.coupling.name

    @property
    def needs(self) -> tuple[Signal, ...]:
        return self.coupling.needs

    def begin(self, period: float) -> Law:
        """Return the law of the force on this axis, by the signals of this axis alone."""
        law, place = self.coupling.begin(period), self.coupling.axes.index(self.axis)
        still = (0,) * len(self.needs)
        return lambda *own: law(*((*still, *own) if place else (*own, *still)))[place]

    def linearised(self) -> StateSpace:
        """Return the part of the coupling that acts from this axis on itself."""
        space, place = self.coupling.linearised(), self.coupling.axes.index(self.axis)
        own = slice(2 * place, 2 * place + 2)
        return StateSpace(space.a, space.b[:, own], space.c[place : place + 1], space.d[place : place + 1, own])


def _velocity(position: Array, rest: float, period: float, estimator: str | None) -> Array:
    """Return the velocity `(n_samples,)` as the loop would estimate it; zeros without an estimator."""
    if estimator is None:
        return np.zeros_like(position)
    from haptic_fieldbus.numerics.estimators import bind, chosen

    # The sample at rest goes first, so that the estimate at t = 0 already contains the step.
    estimate, period_ns = bind(estimator, period), round(1e9 * period)
    timed, places = chosen(estimator).estimator.timed, [rest, *position.tolist()]
    return np.array([estimate(x, k * period_ns) if timed else estimate(x) for k, x in enumerate(places)])[1:]


def _answer(
    element: Element, signals: Signals, rest: float, period: float, method: str
) -> tuple[Array, dict[str, Array], float | None]:
    """Return force `(n_samples,)`, virtual states by name, and spectral radius of a step of one element."""
    if isinstance(element, DynamicElement):
        return _dynamic(element, signals, rest, period, method)
    at_rest = {Signal.POSITION: rest, Signal.VELOCITY: 0.0, Signal.ELAPSED_NS: 0}
    law = law_of(element, period, method)
    # A first call at rest: the memory begins at the position before the motion.
    law(*[at_rest[signal] for signal in element.needs])
    if not element.needs:
        return np.full(len(signals[Signal.POSITION]), law()), {}, None
    return _run(law, [signals[signal] for signal in element.needs]), {}, None


def _dynamic(
    element: DynamicElement, signals: Signals, rest: float, period: float, method: str
) -> tuple[Array, dict[str, Array], float]:
    from haptic_fieldbus.numerics import integrators
    from haptic_fieldbus.numerics.integrators.method import follow

    space, inputs = element.dynamics, np.stack([signals[Signal.POSITION], signals[Signal.VELOCITY]], axis=1)
    one = integrators.discretise(space, period, method)
    # Growth without bound is reported by `diverged`, not by warnings.
    with np.errstate(over="ignore", invalid="ignore"):
        found = follow(one, inputs, (integrators.rest(space)[0] * rest).tolist())
    first = getattr(element, "state_names", STATE_NAMES)
    names = [*first, *(f"state {number}" for number in range(len(first) + 1, space.order + 1))][: space.order]
    states = {name: found.states[:, place] for place, name in enumerate(names)}
    return found.outputs[:, 0], states, spectral_radius(one.system.a)


def _run(law: Callable[..., float], inputs: Sequence[NDArray[Any]]) -> Array:
    """Return the forces of a law along its inputs, up to the first that is not finite."""
    forces: list[float] = []
    with suppress(OverflowError):  # math raises it where numpy would give infinity
        for row in zip(*(values.tolist() for values in inputs), strict=True):
            if not math.isfinite(force := law(*row)):
                break
            forces.append(force)
    return np.array(forces)
