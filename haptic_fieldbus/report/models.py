"""The linear model of an environment in words, as lines of a key and a text."""

import math

from haptic_fieldbus.api.model import EnvironmentModel, LinearModel, Poles
from haptic_fieldbus.numerals import in_unit, rounded
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.numerics.transfer import difference_equation, fraction
from haptic_fieldbus.report.words import Line

DIGITS = 9
"""Digits of matrices, poles and growth: what a step of 1 ms does is in the fourth and beyond."""
LETTERS = {"position": "x", "velocity": "v"}


def model_lines(model: EnvironmentModel) -> list[Line]:
    """Return lines on the continuous and the discrete system, and on the growth of each method."""
    order = model.continuous.space.order
    states = f"{order} virtual states z" if order else "no virtual states"
    inputs = "position x and velocity v of the puck"
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
        growth = ", ".join(f"{method} {_growth(value)}" for method, value in model.growth.items())
        lines.append(("growth", f"of a free motion in a step, its spectral radius: {growth}"))
    return lines


def _natural(pole: complex) -> str:
    """Return the natural frequency of a pair of conjugate poles."""
    frequency = abs(pole) / (2.0 * math.pi)
    turns = f"{rounded(abs(pole))} rad/s, {rounded(frequency)} Hz, a period of {rounded(1.0 / frequency)} s"
    return f"natural frequency {turns}, damping ratio {rounded(-pole.real / abs(pole))}"


def _growth(value: float | None) -> str:
    return "no step" if value is None else rounded(value, DIGITS)


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
