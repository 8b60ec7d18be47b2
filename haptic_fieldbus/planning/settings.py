"""A scene with its settings applied, one of which may be `max` or `max/N`: the stability limit, or a part of it.

The limit is that of the scene with all other settings applied, so it takes two steps: `settled` returns the scene
without that setting, and `Settled.at` the final scene, once the caller has judged the first one.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_fieldbus.errors import UsageError, wrong_kind
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.margins.contact import stiffest_of
from haptic_fieldbus.scenes.catalogue import Setting, load_scene
from haptic_fieldbus.scenes.element import Graded
from haptic_fieldbus.scenes.scene import Scene

PART_OF_LIMIT = re.compile(r"max(?:/(\d+(?:\.\d*)?))?")
"""Form of a setting that is a part of the limit: `max`, `max/2`, `max/1.5`."""


@dataclass(frozen=True)
class Settled:
    """A scene with all settings applied, except one that is a part of the limit."""

    origin: str | Path | Scene
    values: Mapping[str, Setting]
    """All settings; a part of the limit as it was written, such as `max/2`."""
    scene: Scene
    part: str | None
    """Name of the setting that is a part of the limit; None when there is none, so that `scene` is final."""

    def at(self, stability: Stability | None) -> Scene:
        """Return the final scene, given the verdict on `scene`.

        Raises UsageError when there is no finite limit above 0 to take a part of, and for a division by zero.
        """
        if self.part is None:
            return self.scene
        text = f"{self.part}={self.values[self.part]}"
        limit = None if stability is None else stability.stiffness_limit.stable
        # Also a limit of 0, of which each part is 0.
        if not limit or math.isinf(limit):
            raise UsageError(f"{text}: this bench has no stability limit to take a part of")
        divisor = float(str(self.values[self.part]).partition("/")[2] or 1.0)
        if divisor == 0.0:
            raise UsageError(f"{text}: the limit cannot be divided by zero")
        return with_settings(self.origin, {**self.values, self.part: self._value_at(limit / divisor)})

    def _value_at(self, stiffness: float) -> Setting:
        """Return the value of the setting that gives this stiffness [N/m or N·m/rad]."""
        name, _, parameter = str(self.part).rpartition(".")
        element: Any = next((each for each in self.scene.elements if each.name == name), None)
        if parameter == "stiffness" or not isinstance(element, Graded):
            return stiffness
        value: Setting = getattr(element.with_stiffness(stiffness), parameter)
        return value


def settled(scene: str | Path | Scene, settings: Mapping[str, Setting] | None) -> Settled:
    """Load the scene and apply all settings but a part of the limit; raises SceneError or UsageError."""
    values = parsed(settings)
    part = _part_of_limit(values)
    found = with_settings(scene, {key: value for key, value in values.items() if key != part})
    if part is not None:
        _check_scales(part, values[part], found)
    limited = stiffest_of(found.couplings)  # coupled axes are judged by this stiffness alone
    if part is not None and limited is not None and part != f"{limited.name}.stiffness":
        raise UsageError(f"{part}={values[part]}: the limit of coupled axes is told for {limited.name}.stiffness alone")
    return Settled(scene, values, found, part)


def with_settings(scene: str | Path | Scene, values: Mapping[str, Setting]) -> Scene:
    """Return the scene with these values, loading it first if it is a name or a path.

    Raises SceneError for values that the scene cannot have, UsageError for an unknown scene, element or parameter.
    """
    if not isinstance(scene, Scene):
        return load_scene(scene, values)
    if not values:
        return scene
    # Imported here, because a scene that is named or keeps its values does without it.
    from haptic_fieldbus.scenes.changed import changed

    return changed(scene, values)


def parsed(settings: Mapping[str, Setting] | None) -> dict[str, Setting]:
    """Return the settings with texts of a number, `true` or `false` converted; other values stay as they are.

    Raises TypeError for what is no mapping, and for a value that no file could have.
    """
    if not isinstance(settings, Mapping | None):
        raise wrong_kind("settings", 'a mapping such as {"wall.stiffness": 800.0}', settings)
    return {key: _plain(key, value) for key, value in (settings or {}).items()}


def _plain(key: str, value: Setting) -> Setting:
    """Return a value as a file would have it; raises TypeError when none could."""
    value = value.item() if hasattr(value, "item") else value  # a number of numpy
    if not isinstance(value, float | int | str | bool | list | tuple):
        raise wrong_kind(f"settings: {key}", "a number, a text, True or False", value)
    return _parsed(value) if isinstance(value, str) else value


def _parsed(text: str) -> Setting:
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


def _part_of_limit(values: Mapping[str, Setting]) -> str | None:
    """Return the name of the setting that is a part of the limit, or None.

    Raises UsageError for several of them.
    """
    parts = [key for key, value in values.items() if isinstance(value, str) and PART_OF_LIMIT.fullmatch(value)]
    if len(parts) > 1:
        raise UsageError(f"only one setting may be a part of the limit, not {', '.join(parts)}")
    return parts[0] if parts else None


def _check_scales(part: str, value: Setting, scene: Scene) -> None:
    """Raise UsageError unless the setting is a stiffness, or one from which the stiffness of its element follows."""
    name, _, parameter = part.rpartition(".")
    element: Any = next((each for each in scene.elements if each.name == name), None)
    if parameter == "stiffness" or element is None:
        return
    own = getattr(element, parameter, None)
    doubled = element.with_stiffness(2.0 * element.stiffness) if isinstance(element, Graded) else element
    if not isinstance(own, float) or getattr(doubled, parameter) == own:
        raise UsageError(f"{part}={value}: only a stiffness has a limit, or what it follows from")
