"""The running plan: one input image in, one output image out, once a period.

The public names of this package are imported on first use, so that a program imports only the modules that it uses.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.cycle.cycle import Cycle, columns, decoded_columns
    from haptic_fieldbus.cycle.laws import law_of
    from haptic_fieldbus.cycle.safety import Permission, TripKind, bind_limiter
    from haptic_fieldbus.signals import LinkFlag

_HOMES = {
    "cycle.cycle": "Cycle columns decoded_columns",
    "cycle.laws": "law_of",
    "cycle.safety": "Permission TripKind bind_limiter",
    "signals": "LinkFlag",
}
__all__ = ["Cycle", "LinkFlag", "Permission", "TripKind", "bind_limiter", "columns", "decoded_columns", "law_of"]


def __getattr__(name: str) -> object:
    """Import a name when it is first used (PEP 562)."""
    home = next((module for module, names in _HOMES.items() if name in names.split()), None)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"haptic_fieldbus.{home}"), name)
