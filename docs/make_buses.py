"""Write docs/how-to/one_scene_on_four_buses.md: one scene planned and run on four buses: `python docs/make_buses.py`.

All runs are in virtual time, so the figures do not depend on the machine.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus import api
from haptic_fieldbus.numerals import percent, rounded, rounded_limit
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.study.page.cost import BUSES

FILE = Path(__file__).resolve().parent / "how-to" / "one_scene_on_four_buses.md"
STIFFNESS, HAND, DURATION = 60.0, "tap", 3.0
"""Stiffness of a wall that all buses can render [N/m], hand, and duration of the run [s]."""

TEXT = """\
# Compare CANopen and Modbus

This page compares the same wall, motor and hand on four buses: CANopen, Modbus TCP and two Modbus RTU lines. The buses
differ in the rate at which the loop can exchange feedback and set-point, and in the delay of the torque. `make docs`
writes the table from plans and from runs in virtual time. The figures are the same on every machine.

{table}

- *Time on the bus*: all frames of one period with the silence between them, and their share of the period.
- *Age*: half a period plus the longest delay. The stability limit is about b/(T/2 + delay), where b = 1.58 N·s/m is the
  viscous damping at this handle.
- *Stable to*: stiffness up to which the loop is stable with its nominal values. *Limit*: stiffness up to which it is
  stable for every value that the profile leaves open ([the limit](../explanation/stability.md#the-limit)).
- *Felt error*: force error of `run wall --hand {hand}` at {stiffness} N/m, in motion, as a share of the force. All four
  buses can render this soft wall. People notice errors from 8 %.

```sh
haptic-fieldbus stability wall --bus sim-modbus-rtu@115200
haptic-fieldbus run wall --bus sim-modbus-rtu@115200 --hand {hand} --set wall.stiffness={stiffness}
```

## Conclusions

- **The library's wall of 600 N/m needs CANopen or Modbus TCP.** On a serial line it is refused, and the message states
  a stable value. `--set wall.stiffness=max/2` sets half of the limit. At 115200 bit/s, a push of 6 N then moves the
  handle more than 80 mm into the wall, beyond the 0.1 m of the bench, and the run ends with a trip (exit status 3).
  With `--hand tap` the handle stays within the bench.
- **Ten times the bit rate does not give ten times the stiffness.** At 1 Mbit/s the characters of a period take only a
  third of a millisecond. Silence and the drive's answer time take the rest. If your drive needs less silence than the
  1.75 ms of the standard, set `silence` in the rig and in the profile. This gains more than a faster line.
- **The best requests depend on the line.** On TCP, one request reads and another writes within the same period. On a
  serial line a short period matters most: one request reads and writes, and the torque is that of the previous period.
  [Why](../explanation/modbus.md)
- **CANopen and TCP are equal here by chance.** Both need half a millisecond from the latch of the encoder to the
  torque. CANopen waits for the next control tick of the drive. TCP needs two ways through the network. The limit
  differs more, because the generic CANopen profile does not state what its control tick is synchronised to.
- **Your drive may answer later.** The generic drive answers after {answer_time} ms. Many drives take 1 to 5 ms. Compute
  the limit with the profile of your drive.
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
        yield _limit(None if found is None else found.limit.value)
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
    head = ("bus", "rate", "exchange", "time on the bus", "age", "stable to", "limit", "felt error")
    lines = [head, ("---",) * len(head), *(tuple(row.cells()) for row in rows())]
    table = "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
    return TEXT.format(table=table, hand=HAND, stiffness=f"{STIFFNESS:g}", answer_time=0.2)


if __name__ == "__main__":
    FILE.write_text(page(), encoding="utf-8")
    print(FILE, file=sys.stderr)
