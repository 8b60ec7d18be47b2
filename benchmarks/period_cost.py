"""One period: the cycle beside scenes written by hand with the same guards, and a whole simulated run."""

import math
import struct
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count, islice
from itertools import cycle as endless
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

from rows import Figure, Pair, Row, cost, show

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.cycle.cycle import Cycle

PERIODS = 10_000
COUNTS = 2000
"""Encoder counts of the handle, in the wall."""
TWIST = 250
"""Encoder counts of each handle at a shaft, in opposite directions."""
FADE_IN = 1000
"""Periods after which force has faded in."""
MASS = """\
description = "A mass on a spring, so heavy that it stays where it is"
[axis.handle]
workspace = "linear"
[[element]]
kind = "sprung_mass"
axis = "handle"
stiffness = 200.0
mass = 1e9
"""
ONE, TWO = struct.Struct("<qIHHHih"), struct.Struct("<qIHHIHHHihHih")
"""Images of one axis, and of two."""
WAYS = (0, 1, 2, 3, 4, 3, 2, 1)
"""Motion of the handle in contact [counts]; one that stands still for long is another way through the cycle."""


def sign_by_hand() -> Callable[[float, float], bool]:
    """Return a function of the mean torque and the place of a block: whether the motion goes against the torque."""
    places: deque[float] = deque(maxlen=5)
    torques: deque[float] = deque(maxlen=4)
    agreement = excitation = 0.0

    def opposed(torque: float, here: float) -> bool:
        nonlocal agreement, excitation
        torques.append(torque)
        places.append(here)
        if len(places) < 5:
            return False
        oldest, old, _, new, newest = places
        inertial = 2000.0 * (newest - 2.0 * new + 2.0 * old - oldest)
        first, second, third, fourth = torques
        change = 0.5 * (fourth + third - second - first)
        agreement = 0.95 * agreement + inertial * change
        excitation = 0.95 * excitation + change * change
        return excitation > 100.0 and agreement < -0.5 * excitation

    return opposed


def by_hand() -> tuple[Callable[[bytes], bytearray], Callable[[], str]]:
    """The wall as one function without any choice, with every guard of the cycle; and the guard that tripped, or "".

    A guard that needs a longer answer in the cycle only ends the run here.
    """
    unpack, pack_into = ONE.unpack_from, struct.Struct("<Hh").pack_into
    unit, effort_unit = 0.05 / 4096, 0.4 / 1000 / (0.05 / (2 * math.pi))
    lowest, highest, zero, missing, doubt = -0.1, 0.1, 0, 0, False
    pulses: Callable[[float], float] | None = None
    late, later = math.exp(-0.4e-3 * 2 * math.pi * 1000), math.exp(-0.6e-3 * 2 * math.pi * 1000)
    target = older = side = moved_ns = fresh_ns = total = 0
    position, left = COUNTS * unit, 5
    way = energy = torque = before = fade = shift = 0.0
    cap = math.inf
    sent: deque[int] = deque([0] * 3, maxlen=3)
    opposed, tripped, output = sign_by_hand(), "", bytearray(4)

    def released(guard: str) -> bytearray:
        nonlocal tripped
        tripped = tripped or guard
        pack_into(output, 0, 0, 0)
        return output

    def period(image: bytes) -> bytearray:
        nonlocal before, position, fade, target, older, torque, way, moved_ns, energy, side, fresh_ns, total, left
        if tripped:
            return released(tripped)
        t_ns, age_ns, flags, _, statusword, counts, shown = unpack(image)
        # Link flags and missing samples.
        if flags or missing:
            return released("link")
        # Power state.
        if statusword & 0x6F != 0x27:
            return released("power state")
        # A sample in time.
        if fresh_ns and not 500_000 < t_ns - fresh_ns < 1_500_000:
            return released("time of the sample")
        if age_ns > 30_000_000:
            return released("age of the sample")
        fresh_ns = t_ns
        # The encoder's wrap.
        counts -= zero
        if not -0x8000_0000 <= counts <= 0x7FFF_FFFF:
            counts = (counts + 0x8000_0000 & 0xFFFF_FFFF) - 0x8000_0000
        here = counts * unit
        moved = here - position
        # Speed, workspace, acceleration.
        if not (-0.01 <= moved <= 0.01 and lowest <= here <= highest):
            return released("speed or place")
        if not -0.001 <= moved - way <= 0.001:
            return released("acceleration")
        way, position = moved, here
        if moved:
            # Energy of the contact.
            moved_ns = t_ns
            energy += moved * (effort_unit * (0.56 * older + 0.44 * target) - 0.64 * moved)
            if energy > 0.0056:
                return released("energy")
        elif t_ns - moved_ns > 90_000_000_000:
            return released("stall")
        if target * side <= 0:
            energy, side = 0.0, target
        # The echo of the set-point, and the targets it may still show.
        torque = target + (older + (torque - older) * late - target) * later
        if (doubt or not -30.0 <= shown - torque <= 30.0) and fade >= 1.0:
            return released("echo")
        sent.appendleft(target)
        # The law, at the place where it is after gaps.
        place = here - shift
        force = -600.0 * (place - 0.02) if place > 0.02 else 0.0
        if not -math.inf < force < math.inf:
            return released("force")
        # Fade-in, effort, cap, pulses of a test, slew.
        if fade < 1.0:
            fade = min(1.0, fade + 0.002)
            force *= fade
        if not -50.0 <= force <= 50.0:
            force = 50.0 if force > 50.0 else -50.0
        if not -cap <= force <= cap:
            force = cap if force > cap else -cap
        if pulses is not None:
            force = pulses(force)
        if not -10.0 <= force - before <= 10.0:
            force = before + (10.0 if force > before else -10.0)
        before, older = force, target
        target = round(force / effort_unit)
        pack_into(output, 0, 0x0F, target)
        # Sign watch, in blocks of five periods.
        if not left:
            if opposed(total / 5, here):
                return released("sign")
            total, left = 0, 5
        total += target
        left -= 1
        return output

    return period, lambda: tripped


def wall_pair(stack: ExitStack) -> Pair:
    """Decode to encode in contact with a wall, faded in, while the handle moves by a few counts."""
    return one_axis(Cycle(plan("wall")), same=True)


def mass_pair(stack: ExitStack) -> Pair:
    """Decode to encode with a virtual mass, at a handle that moves by a few counts, beside a wall by hand."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "mass.toml"
        path.write_text(MASS, encoding="utf-8")
        return one_axis(Cycle(plan(path)), same=False)


def one_axis(cycle: Cycle, *, same: bool) -> Pair:
    """Lead the handle into contact, and measure there from decode to encode; `same`: the cycle has the wall too."""
    pack, latches, sent, target = ONE.pack, count(0, 1_000_000), 0, 0
    reference, tripped = by_hand()

    def image(t_ns: int, counts: int, shown: int) -> bytes:
        return pack(t_ns, 100_000, 0, 0, 0x0637, counts, shown)  # what was sent comes back

    for counts in range(0, COUNTS + 1, 20):
        _, sent = struct.unpack("<Hh", cycle(image(next(latches), counts, sent)))
    for t_ns in islice(latches, FADE_IN):
        _, sent = struct.unpack("<Hh", cycle(image(t_ns, COUNTS, sent)))
        _, target = struct.unpack("<Hh", reference(image(t_ns, COUNTS, target)))
    if same and sent != target:
        raise SystemExit("the cycle and the loop by hand do not agree")
    begin = next(latches)

    def each(step: Callable[[bytes], bytearray], shown: int) -> Callable[[], bytearray]:
        own, ways = count(begin, 1_000_000), endless(WAYS)
        # Every image has a time of its own: one that comes again, or a pause between two rounds, is a fault.
        return lambda: step(pack(next(own), 100_000, 0, 0, 0x0637, COUNTS + next(ways), shown))

    return measured(cycle, each(cycle.step, sent), each(reference, target), tripped)


def coupled_pair(stack: ExitStack) -> Pair:
    """Decode to encode with a shaft between two handles, twisted and faded in, beside two walls by hand."""
    cycle, (left, tripped), (right, too) = Cycle(plan("virtual_shaft")), by_hand(), by_hand()
    own, walls, sent, target = count(0, 1_000_000), count(0, 1_000_000), (0, 0), 0

    def ours(counts: int) -> bytearray:
        first, second = (0x0637, counts, sent[0]), (0x0637, -counts, sent[1])
        return cycle.step(TWO.pack(next(own), 100_000, 0, 0, 100_000, 0, 0, *first, *second))

    def theirs(counts: int) -> bytearray:
        image = ONE.pack(next(walls), 100_000, 0, 0, 0x0637, counts, target)
        left(image)
        return right(image)

    for counts in [*range(0, TWIST + 1, 5), *[TWIST] * FADE_IN]:
        _, *targets = struct.unpack("<HhHh", ours(counts))
        sent = targets[0], targets[2]
        _, target = struct.unpack("<Hh", theirs(COUNTS))
    ways = endless(WAYS)
    both = lambda: ours(TWIST + next(ways)), lambda: theirs(COUNTS + next(ways))
    return measured(cycle, *both, lambda: tripped() or too())


def measured(
    cycle: Cycle, ours: Callable[[], object], theirs: Callable[[], object], tripped: Callable[[], str]
) -> Pair:
    """Return the pair of both, which no guard may end."""

    def pair() -> tuple[float, float]:
        costs = cost(ours, 1000), cost(theirs, 1000)
        assert cycle.trip is None, cycle.trip
        assert not tripped(), tripped()
        return costs

    return pair


FIGURES = (
    Figure("cycle of a wall on one axis", "the same loop and guards by hand", 1.35, wall_pair),
    Figure("cycle of a virtual mass on one axis", "a wall with the same guards by hand", 1.9, mass_pair),
    Figure("cycle of two coupled axes", "two walls with the same guards by hand", 3.0, coupled_pair),
)


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
    ours, by_hand_too = wall_pair(ExitStack())()
    show([Row("cycle", ours, by_hand_too, FIGURES[0].bound), simulation_row()])
