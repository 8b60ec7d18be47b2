"""Open-loop response in words, as lines of a key and a text."""

import numpy as np

from haptic_fieldbus.api.open_loop import Array, Response
from haptic_fieldbus.report.words import Line


def responses(found: Response, title: str) -> list[Line]:
    """Return lines on the input, the range of each quantity, the growth of the method, and the verdict."""
    space = found.workspace
    lines = [("response", title), ("result", _range("position", found.position, space.length_unit))]
    lines += [("", _range("force", found.force, space.effort_unit))]
    lines += [("", _range(f"virtual {name}", values, "")) for name, values in found.states.items()]
    if found.spectral_radius is not None:
        radius = f"{found.method}: spectral radius {found.spectral_radius:.9g} a step"
        lines.append(("method", f"{radius}, {_growth(found.spectral_radius)}"))
    ended = f"{len(found.time)} samples" + (", then no finite number" if found.diverged else "")
    return [*lines, ("verdict", f"{'diverged' if found.diverged else 'finite'}: {ended}")]


def _range(name: str, values: Array, unit: str) -> str:
    if not len(values):
        return f"{name}: none"
    low, high = float(np.min(values)), float(np.max(values))
    return f"{name} {low:.4g} to {high:.4g} {unit}".rstrip()


def _growth(radius: float) -> str:
    """Return how a free motion evolves when each step multiplies it by the spectral radius."""
    # Methods that conserve energy have a radius of 1 up to rounding in the eigenvalues.
    if abs(radius - 1.0) <= 1e-9:
        return "a free motion neither grows nor decays"
    return "a free motion grows" if radius > 1.0 else "a free motion decays"
