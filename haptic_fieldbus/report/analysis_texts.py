"""Stability limits, models, responses and estimates in words, as lines of a key and a text."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from haptic_fieldbus.api.estimation import INTEGRATION, Estimation
from haptic_fieldbus.api.model import EnvironmentModel, LinearModel, Poles
from haptic_fieldbus.api.open_loop import Response
from haptic_fieldbus.api.stability_limits import UNCERTAIN, Judgement
from haptic_fieldbus.margins import Plant, Stability, Verdict
from haptic_fieldbus.margins.bodies import HungBody
from haptic_fieldbus.numerals import (
    Line,
    OutputRow,
    exactly,
    in_unit,
    lines_of,
    object_of,
    percent,
    rounded,
    rounded_limit,
)
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.numerics.transfer import difference_equation, fraction
from haptic_fieldbus.planning import explain
from haptic_fieldbus.planning.plan import assumed_texts
from haptic_fieldbus.planning.refusal import passivity_condition, verdict_text
from haptic_fieldbus.protocols.traffic import Delay
from haptic_fieldbus.report.texts import parameter_units
from haptic_fieldbus.signals import Workspace

# Open-loop response in words, as lines of a key and a text.

ROUNDING = 1e-12


def response_lines(response: Response, title: str) -> list[Line]:
    """Return lines on the input, the range of each quantity, the growth of the method, and the verdict."""
    space = response.workspace
    lines = [("response", title), ("result", _extremes("position", response.position, space.length_unit))]
    units = {"position": space.length_unit, "velocity": f"{space.length_unit}/s"}
    lines += [("", _extremes("force", response.force, space.effort_unit))]
    for name, values in response.states.items():
        unit = next((unit for word, unit in units.items() if name.endswith(word)), "")
        lines.append(("", _extremes(f"virtual {name}", values, unit)))
    if response.spectral_radius is not None:
        radius = f"{response.method}: spectral radius {rounded(response.spectral_radius, 9)} per step"
        lines.append(("method", f"{radius}, {_growth_words(response.spectral_radius)}"))
    ended = f"{len(response.time)} samples" + (", then not finite" if response.diverged else "")
    return [*lines, ("verdict", f"{'diverged' if response.diverged else 'finite'}: {ended}")]


def _extremes(name: str, values: NDArray[np.float64], unit: str) -> str:
    if not len(values):
        return f"{name}: none"
    low, high = float(np.min(values)), float(np.max(values))
    # An end that is far below the other is rounding.
    low, high = (0.0 if abs(end) < ROUNDING * max(-low, high) else end for end in (low, high))
    return f"{name} {rounded(low)} to {rounded(high)} {unit}".rstrip()


def _growth_words(radius: float) -> str:
    """Return how a free motion evolves when each step multiplies it by the spectral radius."""
    # Methods that conserve energy have a radius of 1 up to rounding in the eigenvalues.
    if abs(radius - 1.0) <= 1e-9:
        return "a free motion neither grows nor decays"
    return "a free motion grows" if radius > 1.0 else "a free motion decays"


# The linear model of an environment in words, as lines of a key and a text.

DIGITS = 9
"""Digits of matrices, poles and growth: a step of 1 ms changes the fourth and later ones."""
LETTERS = {"position": "x", "velocity": "v"}


def model_lines(model: EnvironmentModel) -> list[Line]:
    """Return lines on the continuous and the discrete system, and on the growth of each method."""
    order = model.continuous.space.order
    states = f"{order} virtual states z" if order else "no virtual states"
    inputs = "position x and velocity v of the handle"
    lines = [("model", f"axis {model.axis}: {states}, inputs {inputs}, output F on it; SI")]
    lines += _lines("continuous", "dz/dt = A z + B (x, v), F = C z + D (x, v)", model.continuous, "s")
    lines += [("", _natural(pole)) for pole in model.continuous.poles.tolist() if pole.imag > 0.0]
    ways = [f"virtual states by {model.method}"] if model.integrated.order else []
    if order > model.integrated.order:
        ways.append("the memory of an element by its own exact step")
    if model.continuous.space.uses_velocity:
        ways.append(f"velocity by {model.estimator}")
    by = f", {', '.join(ways)}" if ways else ""
    lines += _lines("discrete", f"x[n] to F[n] at {in_unit(model.period, 's')}{by}", model.discrete, "z")
    (function,) = model.discrete.transfer_functions.values()
    lines.append(("", difference_equation(function, "x", "F")))
    if model.integrated.order:
        steps = {name: "no step" if by is None else rounded(by, DIGITS) for name, by in model.growth.items()}
        growth = ", ".join(f"{method} {by}" for method, by in steps.items())
        lines.append(("growth", f"spectral radius of one step: {growth}"))
    return lines


def _natural(pole: complex) -> str:
    """Return the natural frequency of a pair of conjugate poles."""
    frequency = abs(pole) / (2.0 * math.pi)
    turns = f"{rounded(abs(pole))} rad/s, {rounded(frequency)} Hz, a period of {rounded(1.0 / frequency)} s"
    return f"natural frequency {turns}, damping ratio {rounded(-pole.real / abs(pole))}"


def _lines(key: str, title: str, model: LinearModel, variable: str) -> list[Line]:
    space = model.space
    named = [("A", space.a), ("B", space.b), ("C", space.c), ("D", space.d)] if space.order else [("D", space.d)]
    lines = [(key, title), *(("", f"{name} {matrix_text(matrix)}") for name, matrix in named)]
    if space.order:
        lines.append(("", f"poles {poles_text(model.poles)}"))
    for name, function in model.transfer_functions.items():
        lines.append(("", f"F/{LETTERS[name]} = {fraction(function, variable)}"))
    return lines


def matrix_text(matrix: Matrix) -> str:
    """Return a matrix by its rows."""
    rows = (", ".join(rounded(value, DIGITS) for value in row) for row in matrix.tolist())
    return f"[{', '.join(f'[{row}]' for row in rows)}]"


def poles_text(poles: Poles) -> str:
    """Return poles, a pair of conjugates as one, each with its modulus."""
    upper = [pole for pole in poles.tolist() if pole.imag >= 0.0]
    return ", ".join(f"{_complex(pole)} (modulus {rounded(abs(pole), DIGITS)})" for pole in upper)


def _complex(pole: complex) -> str:
    # A part that is far below the other is rounding.
    real, imaginary = (0.0 if abs(part) < 1e-12 * abs(pole) else part for part in (pole.real, pole.imag))
    if not imaginary:
        return rounded(real, DIGITS)
    start = f"{rounded(real, DIGITS)} " if real else ""
    return f"{start}± {rounded(imaginary, DIGITS)}j"


# An estimate from a signal in words, as lines of a key and a text.

UNEVEN = 0.01
"""Smallest relative deviation of the times between rows that counts as uneven."""


def estimate_lines(found: Estimation, file: str) -> list[Line]:
    """Return lines on the signal, the estimate, and noise, delay and drift of the estimator."""
    signal, estimate = found.signal, found.estimate
    duration = float(signal.times[-1] - signal.times[0])
    sampled = f"{len(signal.times)} rows, {rounded(duration)} s at {rounded(1.0 / found.period, 6)} Hz"
    late = f", samples up to {percent(found.unevenness)} of a period early or late"
    uneven = late if found.unevenness > UNEVEN else ""
    return [
        ("signal", f"{file}: {_range(signal.quantity, signal.values)}, in steps of {rounded(found.resolution)}"),
        ("", f"{sampled}{uneven}"),
        ("estimator", found.estimator),
        ("result", _range(estimate.quantity, estimate.values)),
        ("noise", _noise(found)),
        ("delay", _delay(found)),
        ("drift", _drift(found, duration)),
    ]


def _range(name: str, values: NDArray[np.float64]) -> str:
    return f"{name} {rounded(float(np.min(values)))} to {rounded(float(np.max(values)))}"


def _noise(found: Estimation) -> str:
    gain = found.estimate.noise_gain
    if gain is None:
        return "no value: the estimator is not linear; its noise depends on the motion"
    amplified = f"white noise of 1 in {found.signal.quantity} is {rounded(gain)} in {found.estimate.quantity}"
    return f"gain {rounded(gain)}: {amplified}" + (" at the end" if found.estimator == INTEGRATION else "")


def _delay(found: Estimation) -> str:
    delay = found.estimate.delay
    if delay is None:
        return "no value: it depends on the motion"
    if not delay:
        return "no delay for slow changes"
    periods = rounded(delay / found.period)
    return f"{in_unit(delay, 's')}, {periods} period{'' if periods == '1' else 's'}, for slow changes of velocity"


def _drift(found: Estimation, duration: float) -> str:
    drift = found.estimate.drift
    if drift is None:
        return "no drift: the estimator forgets old samples"
    if not drift:
        return "no drift from readings without steps; a velocity offset still adds up"
    wrong = f"from readings rounded to a step, each wrong by up to {rounded(0.5 * found.resolution)}"
    return f"up to {rounded(drift)} in {rounded(duration)} s {wrong}; with rounding down this is the average shortfall"


# Stability limits of a loop in words, as lines of a key and a text.

# A passive hand is one that gives off no more energy than it took up.
MEANING = {
    Verdict.PASSIVE: "stable with every passive hand",
    Verdict.STABLE: "small motions decay wherever {held} can hold the handle; not passive",
    Verdict.LIMIT_CYCLE: "the handle moves to and fro over one encoder count without end",
    Verdict.UNSTABLE: "motion grows until a limit acts",
}


ABOVE = "above the limit; small motions decay with the nominal values, and may grow with others"


def stability_lines(judgement: Judgement) -> list[Line]:
    """Return lines on scene, device, delay, limits with full and reduced friction, and the verdict."""
    return lines_of(stability_rows(judgement))


def stability_json(judgement: Judgement) -> dict[str, object]:
    """Return the object that `stability --json` prints."""
    return object_of(stability_rows(judgement), (*judgement.stability.to_json(), "assumed", "ways"))


def stability_rows(judgement: Judgement) -> Iterator[OutputRow]:
    """Yield all rows on a judgement, in the order of its text."""
    stability, space = judgement.stability, judgement.workspace
    unit, ways, assumed = parameter_units(space)["stiffness"], judgement.ways, judgement.assumed
    yield from (OutputRow(key=key, value=value) for key, value in stability.to_json().items())
    yield OutputRow("scene", [f"{judgement.scene.name}: {_asked(stability, unit, space)}{_axis(judgement)}"])
    yield from _devices(judgement)
    yield OutputRow("ways", (way.text() for way in ways), "ways", [way.to_json() for way in ways])
    yield from (OutputRow("assumed", [text]) for text in assumed_texts(assumed))
    yield OutputRow(key="assumed", value=list(assumed))
    yield OutputRow("limit", [explain.limit_text(stability)])
    yield OutputRow("", explain.worst_texts(stability, space, judgement.group))
    yield OutputRow("nominal", _nominal(judgement))
    yield OutputRow("radius", [f"spectral radius {rounded(stability.spectral_radius, 9)} (below 1 decays)"])
    yield OutputRow("place", explain.place_texts(stability, space))
    is_limited = math.isfinite(stability.effort)
    held = f"up to {in_unit(stability.effort, space.effort_unit)}" if is_limited else "a hand"
    above = stability.verdict is Verdict.STABLE and not stability.is_inside
    meaning = ABOVE if above else MEANING[stability.verdict].format(held=held)
    yield OutputRow("verdict", [f"{verdict_text(stability)}: {meaning}"])


def _devices(judgement: Judgement) -> Iterator[OutputRow]:
    """Yield a row for the device of each axis judged, and one for the delays and the period."""
    spaces = {axis.name: axis.workspace for axis in judgement.scene.axes}
    members = judgement.group.members
    for member in members:
        name = f"{member.name}: " if len(members) > 1 else ""
        texts = [_device(member.plant, spaces[member.name])]
        texts += [_load(body, spaces[member.name]) for body in member.bodies]
        yield OutputRow("device", [f"{name}{text}" for text in texts])
        # A device has no parts of its delay, and ideal torque.
        delay = judgement.delays.get(member.name) or Delay(member.delay, 0.0, 0.0, 0.0)
        yield OutputRow("delay", [f"{name}{explain.delay_text(delay, judgement.stability.period_s)}"])


def notes(judgement: Judgement) -> list[Line]:
    """Return the reasons for limits of 0, and the substitute of a nonlinear estimator; no lines when none applies."""
    plant, found = judgement.stability.plant, []
    if judgement.stability.stiffness_limit.quantisation == 0.0:
        step = in_unit(plant.resolution, judgement.workspace.length_unit)
        found.append(("note", f"quantisation limit 0: no Coulomb friction bridges one {_step(plant)} of {step}"))
    if plant.tachometer:
        found.append(("note", "passive limit 0: with a sampled velocity no stiffness is passive"))
    if judgement.linear_estimator is not None:
        found.append(("note", f"{judgement.estimator} is not linear; checked with {judgement.linear_estimator}"))
    return found


def _asked(stability: Stability, unit: str, workspace: Workspace) -> str:
    """Return the stiffness and damping of the scene."""
    parts = [] if stability.stiffness is None else [f"stiffness {rounded_limit(stability.stiffness)} {unit}"]
    if stability.damping:
        parts.append(f"damping {exactly(stability.damping)} {parameter_units(workspace)['damping']}")
    return ", ".join(parts) or "no stiffness"


def _axis(judgement: Judgement) -> str:
    """Return which axes were judged; empty when the scene has only one."""
    if judgement.group.couplings:
        return f" · coupling {', '.join(member.name for member in judgement.group.members)}"
    return f" · axis {judgement.axis} has the smallest margin" if len(judgement.scene.axes) > 1 else ""


def _device(plant: Plant, workspace: Workspace) -> str:
    """Return the parameters of a device that are not 0."""
    units = parameter_units(workspace)
    parts = [
        f"mass {rounded(plant.mass)} {units['mass']}",
        f"damping {rounded(plant.damping)} {units['damping']}",
        f"Coulomb friction {in_unit(plant.coulomb, workspace.effort_unit)}",
        f"{_step(plant)} {in_unit(plant.resolution, workspace.length_unit)}",
        f"torque loop {rounded(1e3 * plant.torque_lag)} ms",
    ]
    values = (plant.mass, plant.damping, plant.coulomb, plant.resolution, plant.torque_lag)
    return ", ".join(part for part, value in zip(parts, values, strict=True) if value)


def _load(body: HungBody, workspace: Workspace) -> str:
    """Return a load behind a compliant transmission."""
    units = parameter_units(workspace)
    link = f"{rounded(body.stiffness)} {units['stiffness']} and {rounded(body.damping)} {units['damping']}"
    return f"load behind {link}: mass {rounded(body.mass)} {units['mass']}"


def _step(plant: Plant) -> str:
    """Return the name of one step of the measured position."""
    return "tachometer step" if plant.tachometer else "encoder count"


def _nominal(judgement: Judgement) -> Iterator[str]:
    """Yield the limits at the nominal values, last with the share `UNCERTAIN` of the friction."""
    yield from explain.nominal_texts(judgement.stability)
    # Friction raises the limits, and is the least certain figure of a device: the line shows how much depends on it.
    less, unit = judgement.group.weakened(UNCERTAIN).stability.stiffness_limit, judgement.stability.unit
    if less.stable is not None and less.passive is not None:
        # With stated friction, passivity is told once, with its condition.
        passive = "" if passivity_condition(judgement.stability) else f", {explain.passive_to(less.passive, unit)}"
        share = f"with {exactly(UNCERTAIN)} times damping and Coulomb friction"
        yield f"{share}: stable {explain.up_to(less.stable, unit)}{passive}"
