"""Write docs/reference/modbus_profiles.md: the shipped Modbus profiles and the keys that one can have.

`python docs/make_modbus_profiles.py`; the keys are those of the dataclasses, the drives those of `profiles/`.
"""

import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

from key_tables import default, meanings, of_a_file, value

from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.protocols.modbus.profile import (
    IdentityRegister,
    LineSection,
    ModbusMotion,
    ModbusProfile,
    ModbusTorque,
    ModeSection,
    PowerSection,
    Register,
    WatchdogSection,
    WrittenRegister,
)

FILE = Path(__file__).resolve().parent / "reference" / "modbus_profiles.md"
SECTIONS: dict[str, type] = {
    "`[line]`, required": LineSection,
    "`[power]`, required": PowerSection,
    "`[torque]`, required": ModbusTorque,
    "`[position]`, `[velocity]`, at least one required": ModbusMotion,
    "`[mode]`": ModeSection,
    "`[watchdog]`": WatchdogSection,
    "A register": Register,
    "`[[setup]]` and `watchdog.writes`, one entry per register": WrittenRegister,
    "`[[identity]]`, one entry per register": IdentityRegister,
}
HEAD = """\
# Modbus drive profiles

A profile of a Modbus drive lists its registers and the timing of its line. `[drive]`, `[timing]` and `[sources]` are
the tables of [every profile](../../profiles/README.md#keys); the other tables are below. An address is the address on
the wire, which counts from 0. Manuals often print a number that is higher by one.

```sh
haptic-fieldbus profiles show simplex_motion
haptic-fieldbus profiles check simplex_motion
```

## Shipped drives

None of the profiles was tested on hardware by this project. `generic_cia402_modbus` has a register table of our own,
that of the simulated drive. The other profiles follow the vendors' published documents.
"""
UNITS = """\
## Units

A torque has one of the [units of every profile](../../profiles/README.md#units-of-torque), or one of these:

| unit | one step |
|---|---|
| `µN·m`, `mN·m`, `N·m` | that torque |
| `full_scale/32767` | `torque.full_scale` of the profile, divided by 32767 |
| `mN` | that force, for a linear motor |

The position unit `µm` is for a linear motor too. In a rig a linear motor has a linear mechanism with any
`metres_per_revolution`. Values at the motor shaft are then those of a wheel that travels this distance per turn.

## Power tables

With `power.table = "cia402"`, status and command are statusword and controlword of CiA 402. `"rows"` is for a mode
register or an opcode: each row has the bits of the status under a mask, their state of CiA 402, and the command for
this state. A status that matches no row is *unknown*; the master then sends `power.off`. `power.reset` is the command
that clears a fault. The master sends it only after a watchdog proof, when the drive is in fault because its master was
silent.

```toml
[power]
status = { address = 399, type = "uint16" }
command = { address = 399, type = "uint16" }
table = "rows"
off = 0
rows = [
    { mask = 0xFFFF, bits = 0, state = "switch on disabled", controlword = 40 },
    { mask = 0xFFFF, bits = 40, state = "operation enabled", controlword = 40 },
]
```

## The command stream of Iris ORCA

The vendor's library sends force with function 100. One answer then returns position, force and temperature. The profile
uses plain registers instead, because two facts are not published: the handshake by which function 65 opens the stream,
and the reaction of the motor to the end of the stream. The same library states that force mode needs a stream. The
profile assumes that writing FORCE_CMD in each period counts as a stream. If it does not, set-points do not act, and the
run trips for this reason.

## Errors in a profile

`profiles check` prints all errors of a profile at once, with key and line. It detects:

- two keys for one register
- a type or a unit that cannot be scaled
- function codes without a read function, or without a function that can write the target torque
- serial settings of a drive without a serial line
- an echo without its register
- `usable = false` without a reason

`make docs` writes the tables. Editors can use the [JSON Schema](schemas/profile.modbus.schema.json), which has the same
keys.
"""


def page() -> str:
    """Return the text of the page."""
    return "\n".join([HEAD, *_drives(), *_sections(), UNITS]).rstrip() + "\n"


def _drives() -> Iterator[str]:
    yield "| profile | drive | lines | functions | set-point | power table | watchdog | evidence |"
    yield "|---|---|---|---|---|---|---|---|"
    for profile in map(load_profile, profile_names()):
        if isinstance(profile, ModbusProfile):
            yield f"| {' | '.join(_cells(profile))} |"
    yield ""


def _cells(profile: ModbusProfile) -> Iterator[str]:
    yield f"`{profile.name}`" + ("" if profile.drive.usable else ", not usable")
    yield profile.title
    yield " and ".join(profile.line.transports).upper().replace(" AND ", " and ")
    yield ", ".join(map(str, profile.line.functions))
    yield f"{profile.torque.target.address:04X}h, `{profile.torque.target.unit}`"
    yield profile.power.table
    yield "none" if profile.watchdog is None else f"{profile.watchdog.time.address:04X}h"
    yield profile.drive.evidence


def _sections() -> Iterator[str]:
    for heading, schema in SECTIONS.items():
        told = meanings(schema)
        yield f"## {heading}\n\n{of_a_file(schema.__doc__ or '')}\n"
        yield "| key | value | default | meaning |\n|---|---|---|---|"
        for field in fields(schema):
            cells = (f"`{field.name}`", value(schema, field.name), default(field), told.get(field.name, ""))
            yield f"| {' | '.join(cells)} |"
        yield ""


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
