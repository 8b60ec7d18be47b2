"""One period: the cycle beside a wall written by hand with the same guards, and a whole simulated run."""

import math
import struct
import subprocess
import sys
from collections.abc import Callable
from time import perf_counter

from rows import Row, cost, show

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.cycle import Cycle

PERIODS = 10_000


def by_hand() -> Callable[[bytes], bytes]:
    """Decode, guard, wall, limit, fade, slew, encode, as one function without any choice."""
    unpack, pack = struct.Struct("<qIHHHi").unpack_from, struct.Struct("<Hh").pack
    unit, effort_unit = 0.05 / 4096, 0.4 / 1000 / (0.05 / (2 * math.pi))
    before = position = 0.0
    fade = 0.0

    def period(image: bytes) -> bytes:
        nonlocal before, position, fade
        _, _, flags, _, statusword, counts = unpack(image)
        if flags or statusword & 0x6F != 0x27:
            return pack(0, 0)
        here = counts * unit
        if abs(here - position) > 0.01:
            return pack(0, 0)
        position = here
        force = -600.0 * (here - 0.02) if here > 0.02 else 0.0
        if not math.isfinite(force):
            return pack(0, 0)
        if fade < 1.0:
            fade = min(1.0, fade + 0.002)
            force *= fade
        force = min(max(force, -50.0), 50.0)
        before = min(max(force, before - 10.0), before + 10.0)
        return pack(0x0F, round(before / effort_unit))

    return period


def cycle_row() -> Row:
    image = struct.pack("<qIHHHi", 0, 100_000, 0, 0, 0x0637, 2000)
    cycle, reference = Cycle(plan("wall")), by_hand()
    return Row("cycle", cost(lambda: cycle(image), 1000), cost(lambda: reference(image), 1000))


def simulation_row() -> Row:
    """A simulated period, everything included, beside starting Python (10 ms on the machine of reference)."""
    starts = [_python_starts() for _ in range(10)]
    begun = perf_counter()
    run("wall", duration=PERIODS / 1000.0)
    return Row(
        "simulated period, beside 1/1000 of a Python start", (perf_counter() - begun) / PERIODS, min(starts) / 1000
    )


def _python_starts() -> float:
    begun = perf_counter()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    return perf_counter() - begun


if __name__ == "__main__":
    show([cycle_row(), simulation_row()])
