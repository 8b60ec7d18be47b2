"""Rows of a run: their units, their lines in a text, tables of Arrow."""

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.errors import require
from haptic_fieldbus.recordings.provenance import METADATA, Provenance

if TYPE_CHECKING:
    import pyarrow

UNIT = b"unit"
"""Key of the metadata of a field."""


def arrow_table(
    columns: Mapping[str, Any], units: Mapping[str, str], provenance: Provenance | None = None
) -> "pyarrow.Table":
    """Return columns of one length as a table of Arrow; raises UsageError without pyarrow."""
    require("pyarrow", "data")
    import pyarrow

    arrays = {name: pyarrow.array(values) for name, values in columns.items()}
    fields = [
        pyarrow.field(name, array.type, metadata={UNIT: units[name].encode()} if units.get(name) else None)
        for name, array in arrays.items()
    ]
    kept = {} if provenance is None else {METADATA.encode(): provenance.text().encode()}
    return pyarrow.table(list(arrays.values()), schema=pyarrow.schema(fields, metadata=kept))


UNITS = {
    "linear": {"position": "m", "velocity": "m/s", "force": "N", "command": "N"},
    "rotary": {"position": "rad", "velocity": "rad/s", "force": "N·m", "command": "N·m"},
}
"""Units of computed columns by the mechanism of their axis; other columns are raw values of the drive."""


def column_units(columns: Iterable[str], provenance: Provenance | None) -> dict[str, str]:
    """Return the unit of each column that has one; those of positions and forces follow from the rig."""
    axes = {} if provenance is None else tomllib.loads(provenance.rig.text)["axis"]
    found = {}
    for column in columns:
        axis, _, name = column.rpartition(".")
        kind = axes.get(axis, {}).get("mechanism", {}).get("kind", "")
        units = {"age_ns": "ns", **UNITS.get(kind, {})} if axis else {"t_ns": "ns", "time": "s"}
        if name in units:
            found[column] = units[name]
    return found


def heading(columns: Sequence[str]) -> bytes:
    """Return the first line of a file of rows."""
    return (",".join(columns) + "\n").encode()


def row_line(row: Sequence[float]) -> bytes:
    """Return the line of a row: the shortest texts that read back as the same numbers, whole ones without ".0"."""
    return (",".join([repr(value).removesuffix(".0") for value in row]) + "\n").encode()
