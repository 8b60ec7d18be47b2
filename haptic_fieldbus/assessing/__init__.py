"""Assessment of a run: record, torque error, verdict and result.

The names of this room for rooms above it are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.assessing.loop_report import LoopReport, Record
    from haptic_fieldbus.assessing.torque_error import ErrorSums

_HOMES = {"LoopReport": "loop_report", "Record": "loop_report", "ErrorSums": "torque_error"}
__all__ = ["ErrorSums", "LoopReport", "Record"]


def __getattr__(name: str) -> object:
    """Import a name when it is first used (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
