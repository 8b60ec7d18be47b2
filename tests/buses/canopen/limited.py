"""Benches whose drive holds a torque limit of its own, and shelves of drives of which some have no serial number."""

from collections.abc import Iterator
from dataclasses import replace
from random import Random

from haptic_fieldbus.drive.rig import Limits
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from tests.builders import WALL, plan_of, rig_of
from tests.buses.canopen.benches import Bench

MAX_TORQUE, SERIAL = (0x6072, 0), (0x1018, 4)
HALF = 500
"""The limit of the axis [‰ of rated torque]."""
RUNS = 12
"""Runs on a shelf of drives."""


def half_plan(*, raised: bool = False, real: bool = False, wanted: float = 0.5) -> Plan:
    """A wall on an axis that may use half of the rated torque, or another share."""
    effort = wanted * plan_of().axes[0].rated_effort
    rig = rig_of(WALL, limits=Limits(effort=effort), raise_max_torque=raised)
    if real:
        rig = replace(rig, bus={"bus": CanSection("socketcan", "can0")})
    return plan_of(rig=rig)


def bench_of(
    held: int,
    *,
    raised: bool = False,
    real: bool = False,
    wanted: float = 0.5,
    entry: tuple[int, int] = MAX_TORQUE,
) -> Bench:
    """A bench whose drive holds a limit [‰ of rated torque]."""
    bench = Bench(half_plan(raised=raised, real=real, wanted=wanted))
    bench.drive.objects[entry] = held.to_bytes(2, "little")
    return bench


class Shelf:
    """Drives of one model, each with the limit that a person has set last; a run may be killed or end in order.

    A drive with a number gets back its own limit; one without keeps what was in it when the run began.
    """

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        # Two that were never given a number, one with all ones, and two with numbers of their own.
        self.serials = (0, 0, 0xFFFF_FFFF, 1, 2)
        self.held = [self.random.choice((1000, 3000)) for _ in self.serials]
        self.own = list(self.held)

    def wrong_with_a_run(self) -> Iterator[str]:
        """Run on one of the drives; yield what it does not do."""
        place, wanted = self.random.randrange(len(self.serials)), self.random.choice((300, 400, HALF))
        if self.random.random() < 0.3:
            self.held[place] = self.own[place] = self.random.choice((600, 1000, 3000))
        bench = bench_of(self.held[place], real=True, raised=True, wanted=1e-3 * wanted)
        bench.drive.objects[SERIAL] = self.serials[place].to_bytes(4, "little")
        bench.open()
        if (limit := bench.drive.value(*MAX_TORQUE)) != wanted:
            yield f"drive {place} has the limit {limit} ‰ in a run that asks for {wanted} ‰"
        if self.random.random() < 0.4:  # killed
            self.held[place] = bench.drive.value(*MAX_TORQUE)
            return
        if not bench.bus.stop():
            yield f"drive {place} was not stopped"
        left, self.held[place] = self.held[place], bench.drive.value(*MAX_TORQUE)
        due = left if self.serials[place] in (0, 0xFFFF_FFFF) else self.own[place]
        if self.held[place] != due:
            yield f"drive {place} holds {self.held[place]} ‰ after a run, and {due} ‰ is due"
