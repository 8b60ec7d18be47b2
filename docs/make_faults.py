"""Write docs/reference/faults.md, the kinds of faults as their dataclasses say: `python docs/make_faults.py`."""

import inspect
import sys
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.sim import faults

FILE = Path(__file__).resolve().parent / "reference" / "faults.md"
GROUPS = {
    "Frames and the bus": faults.LineFault,
    "Answers and other masters on Modbus": faults.AnswerFault,
    "Drive and node": faults.DriveFaultKind,
    "Host computer": faults.HostFault,
    "Hand": faults.HandFault,
    "Present from power-on": faults.LastingFault,
}
WITHOUT = {
    "duration": "without end",
    "count": "all",
    "vendor_id": "the right one",
    "product_code": "the right one",
    "factor": "never",
}
"""Meaning of an omitted key whose default is None."""
CODES = ("code", "object", "can_id", "vendor_id", "product_code")
"""Keys whose values are read as hexadecimal numbers."""
SHARED = ("kind", "node", "bus")
"""Keys that are told once for all kinds."""

HEAD = """\
# Fault injection: kinds of faults

This page lists all kinds of `[[fault]]` for `run --faults FILE` on a simulated bench. The guide is
[Simulate faults](../how-to/simulate_faults.md). `simulate --faults FILE` accepts the faults of drives and hands.

| key of every kind | meaning |
|---|---|
| `kind` | one of the kinds below |
| `at` | s after *operation enabled*; counting restarts if a drive is enabled again before the first fault |
| `node` | node-ID of the affected drive, or of the drive whose frames are affected; if omitted: every drive |
| `bus` | name of the affected bus of the rig; if omitted: every bus |

Kinds of *Present from power-on* have no `at`. The key `frames` selects the service of the affected frames: {services}.

The faults under *Frames and the bus* exist on CANopen only. So do the faults of a drive that name TPDOs, RPDOs, SYNC,
heartbeat, emergency, SDO or a second node. A kind that no bus of the run supports is refused.

The FMEA lists the [undetected cases](fmea.md#undetected-set-points-of-another-modbus-master) of `foreign_set_points`,
with the time for which each acts and a test.

`make docs` writes this page.
"""


def page() -> str:
    """The text of the page."""
    head = HEAD.format(services=", ".join(f"`{each}`" for each in get_args(faults.FrameGroup)))
    return "\n".join([head, *(line for title in GROUPS for line in _group(title))]).rstrip() + "\n"


def _group(title: str) -> Iterator[str]:
    yield f"## {title}\n"
    yield "| kind | effect | keys |\n|---|---|---|"
    for kind in get_args(GROUPS[title]):
        hints = get_type_hints(kind, include_extras=True)
        (name,) = get_args(hints["kind"])
        keys = [_key(field, hints[field.name]) for field in fields(kind) if field.name not in SHARED]
        what = " ".join((inspect.getdoc(kind) or "").split())
        yield f"| `{name}` | {what} | {'<br>'.join(key for key in keys if key) or '–'} |"
    yield ""


def _key(field: Field[Any], hint: Any) -> str:
    """A key with its range and default."""
    if field.name == "at":
        return ""
    words = "one of the services above" if field.name == "frames" else _words(hint, hexadecimal=field.name in CODES)
    default = "" if field.default is MISSING else f", default {_default(field.name, field.default)}"
    return f"`{field.name}`{f' {words}' if words else ''}{default}"


def _default(name: str, value: object) -> str:
    if value is None:
        return WITHOUT[name]
    if value == ():
        return "none"
    if name in CODES:
        return f"{value:#x}"
    return exactly(value) if isinstance(value, float) else f"`{value}`" if isinstance(value, str) else str(value)


def _words(hint: Any, *, hexadecimal: bool) -> str:
    """The range that a value may have."""
    if tuple in (get_origin(hint), *(get_origin(part) for part in get_args(hint))):
        return "up to eight octets"
    for part in (hint, *get_args(hint)):
        bounds = getattr(part, "__metadata__", ())
        lowest = [bound.ge for bound in bounds if hasattr(bound, "ge")]
        highest = [bound.le for bound in bounds if hasattr(bound, "le")]
        if lowest and highest:
            show = hex if hexadecimal else _number
            return f"{show(lowest[-1])} to {show(highest[-1])}"
    return ""


def _number(value: float) -> str:
    return exactly(float(value))


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
