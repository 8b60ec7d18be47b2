"""The open loop: the force of a scene for a prescribed motion of the handle, as in a lecture.

The handle starts at rest, with virtual masses at rest at its position. A step moves it at the first sample, t = 0, and
finds the masses at rest at the old position. Nothing is fed back, so a growth comes from the method alone.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
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


@dataclass
class _Answer:
    """The response of one element: force `(n_samples,)`, states by name, spectral radius of its step."""

    force: Array
    states: dict[str, Array] = field(default_factory=dict)
    spectral_radius: float | None = None


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
    position = motion.at(time)
    answers = _Answers(elements, period, task.method or DEFAULT_METHOD, task.estimator or DEFAULT_ESTIMATOR)
    return replace(answers.to(time, position, motion.rest, axis.workspace), alias=motion.alias(period))


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


class _Answers:
    """The elements of one axis, simulated one after another."""

    def __init__(self, elements: tuple[Element, ...], period: float, method: str, estimator: str) -> None:
        self._elements, self._period = elements, period
        self._method, self._estimator = method, estimator

    def to(self, time: Array, position: Array, rest: float, workspace: Workspace) -> Response:
        """Return the sum of all forces; the samples end where the first element diverges."""
        velocity = self._velocity(position, rest)
        answers = []
        for element in self._elements:
            with own_faults(element):
                answers.append(self._answer(element, position, velocity, rest))
        rows = min([len(answer.force) for answer in answers], default=len(time))
        force = np.sum([answer.force[:rows] for answer in answers], axis=0) if answers else np.zeros(rows)
        finite = np.isfinite(force)
        rows = rows if finite.all() else int(np.argmin(finite))
        radii = [answer.spectral_radius for answer in answers if answer.spectral_radius is not None]
        states = {name: values[:rows] for name, values in self._states(answers)}
        return Response(
            time[:rows],
            position[:rows],
            force[:rows],
            states,
            max(radii, default=None),
            rows < len(time),
            workspace,
            self._method if radii else None,
        )

    def _states(self, answers: list[_Answer]) -> Iterator[tuple[str, Array]]:
        named = [(element, answer) for element, answer in zip(self._elements, answers, strict=True) if answer.states]
        for number, (element, answer) in enumerate(named):
            for name, values in answer.states.items():
                yield f"{element.name}.{name}" if number else name, values

    def _velocity(self, position: Array, rest: float) -> Array:
        """Return the velocity `(n_samples,)` as the loop would estimate it; zeros when no element needs it."""
        if not any(Signal.VELOCITY in element.needs for element in self._elements):
            return np.zeros_like(position)
        from haptic_fieldbus.numerics.estimators import bind, chosen

        # The sample at rest goes first, so that the estimate at t = 0 already contains the step.
        estimate, period_ns = bind(self._estimator, self._period), round(1e9 * self._period)
        timed, places = chosen(self._estimator).estimator.timed, [rest, *position.tolist()]
        return np.array([estimate(x, k * period_ns) if timed else estimate(x) for k, x in enumerate(places)])[1:]

    def _answer(self, element: Element, position: Array, velocity: Array, rest: float) -> _Answer:
        if isinstance(element, DynamicElement):
            return self._dynamic(element, np.stack([position, velocity], axis=1), rest)
        elapsed_ns = round(1e9 * self._period) * np.arange(len(position))
        at_rest = {Signal.POSITION: rest, Signal.VELOCITY: 0.0, Signal.ELAPSED_NS: 0}
        signals = {Signal.POSITION: position, Signal.VELOCITY: velocity, Signal.ELAPSED_NS: elapsed_ns}
        law = law_of(element, self._period, self._method)
        # A first call at rest: the memory begins at the position before the motion.
        law(*[at_rest[signal] for signal in element.needs])
        if not element.needs:
            return _Answer(np.full(len(position), law()))
        return _Answer(_run(law, [signals[signal] for signal in element.needs]))

    def _dynamic(self, element: DynamicElement, inputs: Array, rest: float) -> _Answer:
        from haptic_fieldbus.numerics import integrators
        from haptic_fieldbus.numerics.integrators.method import follow

        space = element.dynamics
        one = integrators.discretise(space, self._period, self._method)
        # Growth without bound is reported by `diverged`, not by warnings.
        with np.errstate(over="ignore", invalid="ignore"):
            found = follow(one, inputs, (integrators.rest(space)[0] * rest).tolist())
        first = getattr(element, "state_names", STATE_NAMES)
        names = [*first, *(f"state {number}" for number in range(len(first) + 1, space.order + 1))][: space.order]
        states = {name: found.states[:, place] for place, name in enumerate(names)}
        return _Answer(found.outputs[:, 0], states, spectral_radius(one.system.a))


def _run(law: Callable[..., float], inputs: Sequence[NDArray[Any]]) -> Array:
    """Return the forces of a law along its inputs, up to the first that is not finite."""
    forces: list[float] = []
    with suppress(OverflowError):  # math raises it where numpy would give infinity
        for row in zip(*(values.tolist() for values in inputs), strict=True):
            if not math.isfinite(force := law(*row)):
                break
            forces.append(force)
    return np.array(forces)
