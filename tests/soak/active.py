"""Active elements under gaps: walls that give energy while feedback is lost again and again, and their sound twins.

The law that is checked here is of its own. From the true motion of the shaft and the true torque of the motor, which
the simulation knows at 16 points a period, follows the work of the motor in each contact. A sound wall gives at most
what its hold leaks, and what the force of before acts along the ways that nobody sees, F·∫|dx| over the gaps. A run
whose motor gave more than that and 10 mJ in each of its contacts within a second has ended within this second. An
element that does not state its energy may give back later what it took: of its contacts, all since the begin of the run
count too. The run of the same wall without its source ends by no energy at all.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from random import Random
from typing import Any, ClassVar

import numpy as np

from haptic_fieldbus import api
from haptic_fieldbus.assessing.result import Result, Trace
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import Law
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace
from haptic_fieldbus.sim.faults import AnswerLost, Fault, MissingTpdos
from tests.builders import endless_rig
from tests.invariants.attach import watched

SURFACE, TURNED = 0.02, 2e-5
"""[m]: of the wall, and by which the handle is on its way out."""
DURATION = 4.0
PERMITTED = 0.010
"""[J] in a contact, beyond all that a sound wall may give: the limit of the package is 5 mJ and a count's worth."""
AGE = 2.5
"""[periods] of the oldest force on the bus that is the latest; it grants a leak, so that more is no harm."""
ENERGY = ("energy limit", "energy forgiven", "energy of held torque")


@dataclass(frozen=True)
class Uneven:
    """A wall that pushes with one share of its spring on the way in, and another on the way out."""

    axis: str
    stiffness: float
    inwards: float
    outwards: float
    name: str = "uneven"
    needs: ClassVar = (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        deepest = 0.0

        def law(position: float) -> float:
            nonlocal deepest
            depth = max(position - SURFACE, 0.0)
            deepest = max(deepest, depth) if depth else 0.0
            return -self.stiffness * depth * (self.outwards if depth < deepest - TURNED else self.inwards)

        return law

    def linearised(self) -> StateSpace:
        return gain([[-self.stiffness, 0.0]])


@dataclass(frozen=True)
class Stated(Uneven):
    """The same wall, which states the energy of a sound one."""

    def stored(self, position: float) -> float:
        return 0.5 * self.stiffness * max(position - SURFACE, 0.0) ** 2


@dataclass(frozen=True)
class ActiveCase:
    """Parts of one run."""

    seed: int
    element: Uneven
    hand: str
    bus: str
    rate: float
    fade_in: float
    faults: tuple[Fault, ...]
    missing: int
    """Samples in each gap."""

    @property
    def sound(self) -> "ActiveCase":
        """The same run without its source."""
        return replace(self, element=replace(self.element, inwards=1.0, outwards=1.0))


def active_case(seed: int) -> ActiveCase:
    """Draw a source of a fifth to four fifths, how often feedback is lost and for how long, hand, bus and fade-in."""
    random = Random(f"active/{seed}")
    kind, source = random.choice((Uneven, Stated)), random.uniform(0.2, 0.8)
    inwards, outwards = random.choice(((1.0, 1.0 + source), (1.0 - source, 1.0)))
    modbus = random.random() < 0.2
    bus, rate = ("sim-modbus-tcp", 250.0) if modbus else ("sim", random.choice((1000.0, 500.0)))
    stiffness = random.uniform(100.0, 200.0) if modbus else random.uniform(200.0, 600.0)
    # At most a seventh of the samples, so that what is lost is no reason to end by itself.
    missing = 2 if modbus else random.randrange(2, 21)
    every = max(7.0 * missing / rate, random.uniform(0.05, 0.4))
    lost = AnswerLost if modbus else MissingTpdos
    name: Any = "answer_lost" if modbus else "missing_tpdos"
    first = random.uniform(0.1, 1.0)
    faults = tuple(lost(name, first + every * number, missing) for number in range(int((DURATION - first) / every)))
    hand, fade_in = random.choice(("tap", "push", "sine")), random.choice((0.1, 0.5))
    return ActiveCase(seed, kind("handle", stiffness, inwards, outwards), hand, bus, rate, fade_in, faults, missing)


def rendered(case: ActiveCase) -> Result | None:
    """Run a case, and return its result however it ended; None where it was refused."""
    scene = Scene("uneven", "for the soak", (SceneAxis("handle", Workspace.LINEAR),), (case.element,))
    try:
        return api.run(
            scene,
            endless_rig(scene, "generic_cia402_modbus" if "modbus" in case.bus else "maxon_epos4", case.bus),
            bus=case.bus,
            rate=case.rate,
            hand=case.hand,
            duration=DURATION,
            fade_in=case.fade_in,
            seed=case.seed,
            faults=case.faults,
            force=True,
        )
    except HapticFieldbusError as ended:
        return getattr(ended, "result", None)


def excesses(trace: Trace, case: ActiveCase, age: float) -> Iterator[tuple[float, float]]:
    """Yield for each contact its end [s], and what the motor gave beyond what a sound wall gives [J]."""
    force, x, t = trace.force, trace.position, trace.times
    way, time = np.diff(x), np.diff(t)
    begins = np.array([getattr(fault, "at", 0.0) for fault in case.faults])
    gap = (case.missing + 2) / case.rate
    unseen = np.any((t[:-1, None] >= begins) & (t[:-1, None] < begins + gap), axis=1)
    mean = 0.5 * (force[1:] + force[:-1])
    touching = np.abs(force) > 0.05
    for begin, end in pairwise(np.flatnonzero(np.diff(touching.astype(int)))):
        if touching[begin + 1]:
            part = slice(begin, end + 1)
            leak = case.element.stiffness * age * way[part] ** 2 / time[part]
            hidden = np.abs(force[part]).max() * np.abs(way[part][unseen[part]]).sum()
            yield float(t[end]), float((mean[part] * way[part]).sum() - leak.sum() - hidden)


def wrong_with(case: ActiveCase) -> list[str]:
    """Return what is broken in a run and in its sound twin."""
    broken = list[str]()
    with watched() as found:
        for each in (case, case.sound):
            result = rendered(each)
            if result is None:
                broken.append(f"seed {case.seed}: was refused")
                continue
            trips = [trip.name for trip in result.trips]
            if each.element == case.sound.element:
                if set(trips) & set(ENERGY):
                    broken.append(f"seed {case.seed}: a sound wall ended by {', '.join(trips)}")
            elif result.traces and not trips:
                broken += _unpunished(result, case)
    return broken + [f"seed {case.seed}: {law}: {sentence}" for law, sentence in found.broken]


def _unpunished(result: Result, case: ActiveCase) -> Iterator[str]:
    """Yield the second in which a run that went on gave too much."""
    given = list(excesses(result.traces[0], case, AGE / case.rate))
    for last, _ in given:
        within = [excess for end, excess in given if last - 1.0 < end <= last]
        in_all = sum(excess for end, excess in given if end <= last)
        spent = isinstance(case.element, Stated) or in_all > PERMITTED * len(within)
        if last <= DURATION - 1.0 and sum(within) > PERMITTED * len(within) and spent:
            yield f"seed {case.seed}: {1e3 * sum(within):.1f} mJ in {len(within)} contacts until {last:.3f} s, no trip"
            return
