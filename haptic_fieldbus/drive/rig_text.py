"""The text of a rig file, for a bench that is known already: the inverse of `load_rig`.

Values that are the default of their key are left out, so the file says what is particular about the bench. What is
measured in a unit has it beside it.
"""

from collections.abc import Iterator
from dataclasses import Field, fields, is_dataclass
from typing import Any

from haptic_fieldbus.documents.edits import quoted, table_name
from haptic_fieldbus.drive.rig import Rig, RigAxis
from haptic_fieldbus.signals import Workspace

_UNITS = {
    "bitrate": "bit/s",
    "rated_torque": "N·m",
    "torque_constant": "N·m/A",
    "rated_current": "A",
    "peak_current": "A",
    "inertia": "kg·m², motor and handle, at the motor shaft as all here",
    "viscous_damping": "N·m·s/rad",
    "coulomb_friction": "N·m",
    "metres_per_revolution": "m of the handle in a turn of the motor",
}
_OF_HANDLE = {
    Workspace.LINEAR: {"effort": "N", "speed": "m/s", "position": "m", "drift": "m", "acceleration": "m/s²"},
    Workspace.ROTARY: {"effort": "N·m", "speed": "rad/s", "position": "rad", "drift": "rad", "acceleration": "rad/s²"},
}


def rig_text(rig: Rig, heading: str) -> str:
    """Return the text of a rig file; `heading` is a comment at its beginning, of one line or more."""
    comment = "".join(f"# {line}\n" for line in heading.splitlines())
    tables = [text for name, section in rig.bus.items() for text in _table(("bus", name), section, _UNITS)]
    for name, axis in rig.axis.items():
        tables += _table(("axis", name), axis, _units(axis))
    return "\n".join([comment, *tables])


def _units(axis: RigAxis) -> dict[str, str]:
    of_handle = _OF_HANDLE[axis.mechanism.workspace]
    return _UNITS | of_handle | {"sign_effort": of_handle["effort"]}


def _table(path: tuple[str, ...], value: Any, units: dict[str, str]) -> Iterator[str]:
    """Yield a table and then the tables in it; a table without a line is left out."""
    held = {each.name: getattr(value, each.name) for each in fields(value) if not _is_default(each, value)}
    lines = [
        f"{key} = {_text(one)}" + (f"  # {units[key]}" if key in units else "")
        for key, one in held.items()
        if not is_dataclass(one)
    ]
    if lines:
        yield "\n".join([f"[{table_name(path)}]", *lines, ""])
    for key, one in held.items():
        if is_dataclass(one):
            yield from _table((*path, key), one, units)


def _is_default(each: Field[Any], value: Any) -> bool:
    held = getattr(value, each.name)
    return held is None or held == each.default or held == {}


def _text(value: object) -> str:
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value).replace("e-0", "e-")
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{table_name((key,))} = {_text(one)}' for key, one in value.items())} }}"
    return f"[{', '.join(map(_text, value))}]" if isinstance(value, tuple) else repr(value)
