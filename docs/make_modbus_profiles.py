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
    "`[line]`, needed": LineSection,
    "`[power]`, needed": PowerSection,
    "`[torque]`, needed": ModbusTorque,
    "`[position]`, `[velocity]`, one of them needed": ModbusMotion,
    "`[mode]`": ModeSection,
    "`[watchdog]`": WatchdogSection,
    "A register": Register,
    "`[[setup]]` and `watchdog.writes`, a register each": WrittenRegister,
    "`[[identity]]`, a register each": IdentityRegister,
}
HEAD = """\
# Profiles of Modbus drives

A profile of a Modbus drive says which registers it has and how fast its line is. `[drive]`, `[timing]` and `[sources]`
are those of [every profile](../../profiles/README.md#keys); the other tables are below. An address is the one on the
wire, which counts from 0; manuals often print a number that is one higher.

```sh
haptic-fieldbus profiles show simplex_motion
haptic-fieldbus profiles check simplex_motion
```

## Shipped drives

None of them was tried on hardware here. `generic_cia402_modbus` is a table of our own, that of the simulated drive; the
others rest on what their vendors have published.
"""
UNITS = """\
## Units

A torque has one of the [units of every profile](../../profiles/README.md#units-of-torque), or one of these:

| unit | one step |
|---|---|
| `µN·m`, `mN·m`, `N·m` | that torque |
| `full_scale/32767` | `torque.full_scale` of the profile, divided by 32767 |
| `mN` | that force, of a motor that goes straight |

A position in `µm` is one of a motor that goes straight too. In a rig such a drive has a linear mechanism with any
`metres_per_revolution`, and what is given at the motor shaft is that of a wheel with this way in a turn.

## Power tables

`power.table = "cia402"`: status and command are statusword and controlword of CiA 402. `"rows"`: a mode register or an
opcode; each row has the bits of the status under a mask, the state of CiA 402 that they stand for, and the command that
is sent in it. A status that fits no row is *unknown*, and is answered with `power.off`. `power.reset` is the command
that clears a fault. It is sent after a proof of the watchdog, when a drive is in fault because it was left alone, and
never else.

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

Its vendor's library sends force by function 100, and gets position, force and temperature back with one answer. The
profile uses plain registers instead: what is missing is the handshake by which function 65 opens the stream, and what
the motor does when the stream ends. The same library says that force mode needs a stream; whether writing FORCE_CMD
each period counts as one is assumed. Where it does not, no set-point acts, and the run ends by that.

## Faults

`profiles check` tells all faults at once, with key and line: two keys for one register, a type or a unit that cannot be
scaled, functions with which nothing can be read or no target torque be written, facts of a serial line about a drive
that has none, an echo without its register, `usable = false` without its reason.

The tables are written by `make docs`; the [JSON Schema](schemas/profile.modbus.schema.json) says the same to editors.
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
