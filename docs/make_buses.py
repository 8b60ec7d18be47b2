"""Write docs/how-to/one_scene_on_four_buses.md: one scene planned and run on four buses: `python docs/make_buses.py`.

All runs are in virtual time, so that the figures are those of no machine.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus import api
from haptic_fieldbus.numerals import percent, rounded, rounded_limit
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.study.page.buses import BUSES

FILE = Path(__file__).resolve().parent / "how-to" / "one_scene_on_four_buses.md"
STIFFNESS, HAND, DURATION = 60.0, "tap", 3.0
"""The wall that all of them can render [N/m], the hand and the time [s]."""

TEXT = """\
# One scene on four buses

The same wall, the same motor and the same hand, once on CANopen and three times on Modbus. What differs is how often
the loop can exchange feedback and set-point, and how long a torque is under way. The table is written by `make docs`,
from plans and runs in virtual time; the figures are the same on every machine.

{table}

*Time on the bus* is that of all frames of one period with the silence between them, and their share of the period.
*Age* is half a period and the longest delay; the limit is about b/(T/2 + delay), with b = 1.58 N·s/m of friction at
this handle. *Felt error* is that of `run wall --hand {hand}` at {stiffness} N/m, a wall soft enough for all four: the
share of the force by which a hand in motion feels another one than that of the scene. Below 8 % nobody can tell.

```sh
haptic-fieldbus stability wall --bus sim-modbus-rtu@115200
haptic-fieldbus run wall --bus sim-modbus-rtu@115200 --hand {hand} --set wall.stiffness={stiffness}
```

## What it says

- **A wall of 600 N/m, as the library has it, is one for CANopen and for TCP.** On a serial line it is refused, with
  the number that would be stable. `--set wall.stiffness=max/2` asks for half of whatever the limit is.
  At 115200 bit/s a push of 6 N is then more than 80 mm deep in the wall, beyond the 0.1 m of the bench; the run
  tells so (`handle from 0 to …, … deep in wall`, in JSON `travel`), and `--hand tap` stays within.
- **Ten times the bit rate is not ten times the stiffness.** At 1 Mbit/s the characters of a period take a third of a
  millisecond, and silence and the drive's answer take the rest: a drive that needs less silence than the standard's
  1.75 ms gains more than one with a faster line. `silence` in the rig and in the profile says so.
- **Which requests are best depends on the line.** On TCP a request that reads and another one that writes within the
  same period are better; on a serial line the period counts most, and one request does both, with the torque of the
  period before. [Why](../explanation/modbus.md)
- **CANopen and TCP are equal here by chance.** Both have half a millisecond from the latch of the encoder to the
  torque: CANopen waits for the drive's next control tick, TCP for two ways through the network. What is recommended
  differs more, since the generic profile of CANopen leaves open to what its control tick is locked.
- **The answer time of your drive is not that of this table.** The generic drive answers after {answer_time} ms. Many
  take 1 to 5 ms; then read the limit of your own profile.
"""


@dataclass(frozen=True)
class Row:
    """A bus with its plan, and the error of a run on it."""

    name: str
    plan: Plan
    error: float | None

    def cells(self) -> Iterator[str]:
        """Yield the cells of the row."""
        plan, traffic = self.plan, self.plan.buses[0].traffic
        found = plan.stability
        yield self.name
        yield f"{rounded(plan.rate)} Hz"
        yield traffic.exchange or "SYNC, TPDO, RPDO"
        yield f"{rounded(1e3 * traffic.load / plan.rate)} ms, {percent(traffic.load)}"
        yield f"{rounded(1e3 * (0.5 * plan.period + plan.delay.transport))} ms"
        yield _limit(None if found is None else found.stiffness_limit.stable)
        yield _limit(None if found is None else found.recommended)
        yield "–" if self.error is None else percent(self.error)


def _limit(limit: float | None) -> str:
    return "–" if limit is None else f"{rounded_limit(limit)} N/m"


def rows() -> Iterator[Row]:
    """Yield a row for each bus."""
    for name, (bus, drive) in BUSES.items():
        result = api.run(
            "wall", bus=bus, drive=drive, hand=HAND, duration=DURATION, settings={"wall.stiffness": STIFFNESS}
        )
        error = None if result.torque_error is None else result.torque_error.contact
        yield Row(name, api.plan("wall", bus=bus, drive=drive), error)


def page() -> str:
    """Return the text of the page."""
    head = ("bus", "rate", "exchange", "time on the bus", "age", "stable to", "recommended to", "felt error")
    lines = [head, ("---",) * len(head), *(tuple(row.cells()) for row in rows())]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return TEXT.format(table=table, hand=HAND, stiffness=f"{STIFFNESS:g}", answer_time=0.2)


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
