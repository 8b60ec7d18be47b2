"""Open-loop response in words, as lines of a key and a text."""

import numpy as np

from haptic_fieldbus.api.open_loop import Array, Response
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.report.words import Line

ROUNDING = 1e-12


def response_lines(response: Response, title: str) -> list[Line]:
    """Return lines on the input, the range of each quantity, the growth of the method, and the verdict."""
    space = response.workspace
    lines = [("response", title), ("result", _range("position", response.position, space.length_unit))]
    lines += [("", _range("force", response.force, space.effort_unit))]
    lines += [("", _range(f"virtual {name}", values, "")) for name, values in response.states.items()]
    if response.spectral_radius is not None:
        radius = f"{response.method}: spectral radius {rounded(response.spectral_radius, 9)} a step"
        lines.append(("method", f"{radius}, {_growth(response.spectral_radius)}"))
    ended = f"{len(response.time)} samples" + (", then no finite number" if response.diverged else "")
    return [*lines, ("verdict", f"{'diverged' if response.diverged else 'finite'}: {ended}")]


def _range(name: str, values: Array, unit: str) -> str:
    if not len(values):
        return f"{name}: none"
    low, high = float(np.min(values)), float(np.max(values))
    # An end that is far below the other is rounding.
    low, high = (0.0 if abs(end) < ROUNDING * max(-low, high) else end for end in (low, high))
    return f"{name} {rounded(low)} to {rounded(high)} {unit}".rstrip()


def _growth(radius: float) -> str:
    """Return how a free motion evolves when each step multiplies it by the spectral radius."""
    # Methods that conserve energy have a radius of 1 up to rounding in the eigenvalues.
    if abs(radius - 1.0) <= 1e-9:
        return "a free motion neither grows nor decays"
    return "a free motion grows" if radius > 1.0 else "a free motion decays"
