"""Write docs/reference/rig_files.md, the keys of rig files as their schema says: `python docs/make_rig_files.py`."""

import inspect
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import ClassVar, get_args, get_type_hints

from key_tables import default, meanings, of_a_file, value

from haptic_fieldbus.drive.plausible import OF_HANDLE, RANGES, Typical
from haptic_fieldbus.drive.rig import RigAxis
from haptic_fieldbus.protocols.registry import BUILT_IN, protocol_named

FILE = Path(__file__).resolve().parent / "reference" / "rig_files.md"

HEAD = """\
# Rig files

A rig file describes your bench: its buses, and for each axis the drive, the motor and the mechanism. It is a TOML file:

```toml
[bus.can0]
interface = "socketcan"
channel = "can0"
bitrate = 1_000_000

[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 6.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3

[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05

[axis.handle.limits]
effort = 20.0
speed = 1.0
position = [-0.10, 0.10]
```

`haptic-fieldbus run wall --rig rig.toml` renders a scene on this bench. With `--bus sim` it simulates the same bench.
An axis of the scene uses the axis of the rig with the same name; `--axis knob=handle` assigns another one.
`haptic-fieldbus simulate --write-rig rig.toml` writes a rig file.

**Units.** A number is SI. A string with a unit is valid too: `rated_torque = "94 mN·m"`, `inertia = "60 g·cm²"`,
`bitrate = "500 kbit/s"`, `position = ["-10 cm", "10 cm"]`. Values are at the motor shaft, except `limits`, which are at
the handle: N, m/s, m for a linear mechanism; N·m, rad/s, rad for a rotary one. A unit of another quantity is refused;
the message names the expected unit.

**CAN adapters.** `interface` is an [interface of
python-can](https://python-can.readthedocs.io/en/stable/interfaces.html). `channel` is the channel of this interface, a
string or a number (`channel = 0`). The table `arguments` holds further arguments of the interface:

```toml
[bus.desk]
interface = "socketcand"
channel = "can0"
arguments = { host = "192.168.1.20", port = 29536 }
```

**Modbus.** `interface` is "modbus-tcp" with `HOST:PORT` as `channel`, or "modbus-rtu" with a serial device as
`channel`. The `node` of an axis is its unit id.

```toml
[bus.line]
interface = "modbus-rtu"
channel = "/dev/ttyUSB0"
baud = 115_200
silence = "0.3 ms"

[bus.network]
interface = "modbus-tcp"
channel = "192.168.0.10:502"
round_trip = "0.4 ms"
```

**Missing keys.** A missing key has the default below; a key without a default is unknown. A run needs `rated_torque`,
`inertia`, `viscous_damping` and `coulomb_friction`: without them no limit is known. `haptic-fieldbus identify` measures
the last three, and runs without them. Any other run is refused, and the message names the missing keys; with `--force`
it has at most 5 % of rated torque.

**Limits.** `haptic-fieldbus plan wall --rig rig.toml` prints the limits of the run. If the rig has no limits, it
suggests limits to start with.

**Errors in the file.** Each command that reads the file prints all its errors at once, with line, key, value and the
expected value, and ends with status 2.

`make docs` writes the tables. Editors can use the [JSON Schema](schemas/rig.schema.json), which has the same keys.
"""


RANGES_HEAD = """\
<a id="values-that-benches-have"></a>

## Plausible values

A value outside its range below is refused. The message states the range, and the unit in which the value would be
inside:
for `rated_torque = 400` it suggests 400 mN·m. If your bench really has such a value, list its key in the axis:

```toml
i_know = ["inertia", "mechanism.metres_per_revolution"]
```

The ranges extend well beyond the smallest and the largest motor that were considered: a brushless motor of 10 mm
(Orbray BMS10) and an AC servo motor of 5 kW (Yaskawa SGMSH-50). They are narrow enough to detect an error by a factor
of 1000. `coulomb_friction` must be below `rated_torque`. `torque_constant` times `rated_current` must equal
`rated_torque` within a factor of 10. An error inside the range is detected if the drive reports its rated torque or
current: these must match the rig within 2 %.
"""


def page() -> str:
    """Return the text of the page."""
    return "\n".join([HEAD, *_lines()]).rstrip() + "\n"


def _lines() -> Iterator[str]:
    for protocol in BUILT_IN:
        yield from _table(protocol_named(protocol).section, ("bus", "NAME"), f", protocol {protocol}")
    yield from _table(RigAxis, ("axis", "NAME"))
    yield from _ranges()


def _ranges() -> Iterator[str]:
    """Yield the section of the plausible values."""
    yield RANGES_HEAD
    yield "| key | range | reason | suggested units |\n|---|---|---|---|"
    rows: list[tuple[str, Typical]] = list(RANGES.items())
    for space, ranges in OF_HANDLE.items():
        rows += [(f"{key}, {space.value}", each) for key, each in ranges.items()]
    for key, each in rows:
        yield f"| {key} | {each.text} | {each.why} | {_asked(each)} |"
    yield ""


def _asked(each: Typical) -> str:
    return ", ".join(unit for _, unit in each.slips)


def _table(schema: type, path: tuple[str, ...], which: str = "") -> Iterator[str]:
    """Yield the section of a table, and then those of the tables in it; `which` tells it from one of the same name."""
    yield f"## `[{'.'.join(path)}]`{which}{_kind(schema)}\n"
    yield f"{of_a_file(inspect.getdoc(schema) or '')}\n"
    told, inner = meanings(schema), _tables(schema)
    values = [field for field in fields(schema) if field.name not in inner]
    if values:
        yield "| key | value | default | meaning |\n|---|---|---|---|"
        for field in values:
            cells = (f"`{field.name}`", value(schema, field.name), default(field), told[field.name])
            yield f"| {' | '.join(cells)} |"
        yield ""
    for name, members in inner.items():
        for member in members:
            yield from _table(member, (*path, name))


def _kind(schema: type) -> str:
    """Return the end of a heading that tells the members of a union apart."""
    kind = get_type_hints(schema).get("kind")
    return f', `kind = "{get_args(kind)[0]}"`' if kind else ""


def _tables(schema: type) -> dict[str, list[type]]:
    """Return the keys of a table whose values are tables, with the dataclasses that those may be."""
    hints = {name: hint for name, hint in get_type_hints(schema).items() if hint is not ClassVar}
    found = {name: [each for each in (hint, *get_args(hint)) if is_dataclass(each)] for name, hint in hints.items()}
    return {name: [each for each in each_of if isinstance(each, type)] for name, each_of in found.items() if each_of}


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
