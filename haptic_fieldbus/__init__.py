"""Servo drives as haptic interfaces: virtual walls, springs and masses, rendered over CANopen.

>>> import haptic_fieldbus
>>> result = haptic_fieldbus.run("wall", duration=1.0)
>>> result.missed_cycles
0

Names are imported when they are first used, so that `import haptic_fieldbus` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.api import plan, response, run, stability
    from haptic_fieldbus.api.open_loop import Response
    from haptic_fieldbus.assessing.result import Result
    from haptic_fieldbus.planning.plan import Plan
    from haptic_fieldbus.running.changes import Changes

_HOMES = {
    "plan": "haptic_fieldbus.api",
    "response": "haptic_fieldbus.api",
    "run": "haptic_fieldbus.api",
    "stability": "haptic_fieldbus.api",
    "Changes": "haptic_fieldbus.running.changes",
    "Plan": "haptic_fieldbus.planning.plan",
    "Response": "haptic_fieldbus.api.open_loop",
    "Result": "haptic_fieldbus.assessing.result",
}

__all__ = ["Changes", "Plan", "Response", "Result", "plan", "response", "run", "stability"]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
