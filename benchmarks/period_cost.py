"""One period: the cycle beside a wall written by hand with the same guards, and a whole simulated run."""

import math
import struct
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count
from itertools import cycle as endless
from time import perf_counter

from rows import Figure, Pair, Row, cost, show

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.cycle.cycle import Cycle

PERIODS = 10_000
COUNTS = 2000
"""Encoder counts of the handle, in the wall."""
FADE_IN = 1000
"""Periods after which force has faded in."""


def by_hand() -> Callable[[bytes], bytearray]:
    """The wall as one function without any choice, with every guard of the cycle.

    Link flags and stale feedback, power state, the encoder's wrap, speed, acceleration, workspace, stall,
    the echo of the set-point, the energy of a contact, a finite force, fade-in, effort and slew.
    """
    unpack, pack_into = struct.Struct("<qIHHHih").unpack_from, struct.Struct("<Hh").pack_into
    unit, effort_unit = 0.05 / 4096, 0.4 / 1000 / (0.05 / (2 * math.pi))
    lowest, highest = -math.inf, math.inf
    position, zero, before, fade, gain, stale = COUNTS * unit, 0, 0.0, 0.0, 1.0, False
    late, later = math.exp(-0.4e-3 * 2 * math.pi * 1000), math.exp(-0.6e-3 * 2 * math.pi * 1000)
    target = older = moved_ns = side = 0
    torque = way = energy = 0.0
    output = bytearray(4)

    def released() -> bytearray:
        pack_into(output, 0, 0, 0)
        return output

    def period(image: bytes) -> bytearray:
        nonlocal before, position, fade, target, older, torque, way, moved_ns, energy, side
        t_ns, _, flags, _, statusword, counts, shown = unpack(image)
        if flags or stale or statusword & 0x6F != 0x27:
            return released()
        counts -= zero
        if not -0x8000_0000 <= counts <= 0x7FFF_FFFF:
            counts = (counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        here = counts * unit
        if not (-0.01 <= here - position <= 0.01 and lowest <= here <= highest):
            return released()
        if not -0.001 <= here - position - way <= 0.001:
            return released()
        way, position = here - position, here
        if way:
            moved_ns = t_ns
            energy += way * (effort_unit * (0.56 * older + 0.44 * target) - 0.64 * way)
            if energy > 0.0056:
                return released()
        if target * side <= 0:
            energy, side = 0.0, target
        if t_ns - moved_ns > 90_000_000_000:
            return released()
        torque = target + (older + (torque - older) * late - target) * later
        if not -30.0 <= shown - torque <= 30.0 and fade >= 1.0:
            return released()
        force = -600.0 * (here - 0.02) if here > 0.02 else 0.0
        if not math.isfinite(force):
            return released()
        if fade < 1.0:
            fade = min(1.0, fade + 0.002)
            force *= fade
        if not -50.0 <= force <= 50.0:
            force = 50.0 if force > 50.0 else -50.0
        if not -10.0 <= force - before <= 10.0:
            force = before + (10.0 if force > before else -10.0)
        before, older = force, target
        target = round(force * gain / effort_unit)
        pack_into(output, 0, 0x0F, target)
        return output

    return period


def cycle_pair(stack: ExitStack) -> Pair:
    """Decode to encode in contact with a wall, faded in, while the handle moves by a few counts."""
    pack, latches = struct.Struct("<qIHHHih").pack, count(0, 1_000_000)
    cycle, reference = Cycle(plan("wall")), by_hand()
    for counts in range(0, COUNTS + 1, 20):
        _, sent = struct.unpack("<Hh", cycle(pack(next(latches), 100_000, 0, 0, 0x0637, counts, 0)))
    for _ in range(FADE_IN):
        image = pack(next(latches), 100_000, 0, 0, 0x0637, COUNTS, sent)  # what was sent comes back
        _, sent = struct.unpack("<Hh", cycle(image))
        same = struct.unpack("<Hh", reference(image)) == (0x0F, sent)
    if not same:
        raise SystemExit("the cycle and the loop by hand do not agree")

    # A handle that stands still for long is another way through the cycle: its force is limited.
    ways = endless((0, 1, 2, 3, 4, 3, 2, 1))

    begin = next(latches)

    def each(step: Callable[[bytes], bytearray]) -> Callable[[], bytearray]:
        own = count(begin, 1_000_000)  # a pause between two rounds would be a gap of the feedback
        # Every image has a time of its own: one that comes again is a fault, and another way through the cycle.
        return lambda: step(pack(next(own), 100_000, 0, 0, 0x0637, COUNTS + next(ways), sent))

    ours, theirs = each(cycle.step), each(reference)
    return lambda: (cost(ours, 1000), cost(theirs, 1000))


FIGURES = (Figure("cycle of a wall on one axis", "the same loop and guards by hand", 2.4, cycle_pair),)


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
    ours, by_hand_too = cycle_pair(ExitStack())()
    show([Row("cycle", ours, by_hand_too, FIGURES[0].bound), simulation_row()])
