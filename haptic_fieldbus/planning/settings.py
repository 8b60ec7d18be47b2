"""A scene with its settings made, one of which may be `max` or `max/N`: the stability limit, or a part of it.

The limit is that of the scene with all other settings made, so it takes two steps: `settled` gives the scene without
the part, and `Settled.at` the final one once somebody has judged the first.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.margins.contact import stiffest_of
from haptic_fieldbus.scenes.catalogue import Setting, load_scene
from haptic_fieldbus.scenes.scene import Scene

PART_OF_LIMIT = re.compile(r"max(?:/(\d+(?:\.\d*)?))?")


@dataclass(frozen=True)
class Settled:
    """A scene with all its settings made but the one that is a part of the limit."""

    origin: str | Path | Scene
    values: Mapping[str, Setting]
    """All settings; the part of the limit as it was written."""
    scene: Scene
    part: str | None
    """The setting that is a part of the limit; None where there is none, and `scene` is final."""

    def at(self, stability: Stability | None) -> Scene:
        """The final scene, by the verdict on `scene`; raises UsageError where it has no limit to take a part of."""
        if self.part is None:
            return self.scene
        text = f"{self.part}={self.values[self.part]}"
        limit = None if stability is None else stability.stiffness_limit.stable
        if not limit or math.isinf(limit):
            raise UsageError(f"{text}: this bench has no stability limit to take a part of")
        divisor = float(str(self.values[self.part]).partition("/")[2] or 1.0)
        if divisor == 0.0:
            raise UsageError(f"{text}: the limit cannot be divided by zero")
        return with_settings(self.origin, {**self.values, self.part: limit / divisor})


def settled(scene: str | Path | Scene, settings: Mapping[str, Setting] | None) -> Settled:
    """Load the scene with its settings; raises SceneError or UsageError for those that cannot be."""
    values = parsed(settings)
    part = _part_of_limit(values)
    found = with_settings(scene, {key: value for key, value in values.items() if key != part})
    limited = stiffest_of(found.couplings)
    if part is not None and limited is not None and part != f"{limited.name}.stiffness":
        raise UsageError(f"{part}={values[part]}: the limit of coupled axes is told for {limited.name}.stiffness alone")
    return Settled(scene, values, found, part)


def with_settings(scene: str | Path | Scene, values: Mapping[str, Setting]) -> Scene:
    """The scene, loaded where it is not yet, with these values."""
    if not isinstance(scene, Scene):
        return load_scene(scene, values)
    if not values:
        return scene
    from haptic_fieldbus.scenes.changed import changed

    return changed(scene, values)


def parsed(settings: Mapping[str, Setting] | None) -> dict[str, Setting]:
    """Settings as the command line writes them: numbers, true and false are no texts."""
    return {key: _parsed(value) if isinstance(value, str) else value for key, value in (settings or {}).items()}


def _parsed(text: str) -> Setting:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


def _part_of_limit(values: Mapping[str, Setting]) -> str | None:
    """The one setting that is a part of the limit; raises UsageError for several, and for one that has no limit."""
    parts = [key for key, value in values.items() if isinstance(value, str) and PART_OF_LIMIT.fullmatch(value)]
    faults = [f"{key}={values[key]}: only a stiffness has a limit" for key in parts if ".stiffness" not in key]
    if len(parts) > 1 or faults:
        raise UsageError("; ".join(faults) or f"only one setting may be a part of the limit, not {', '.join(parts)}")
    return parts[0] if parts else None
