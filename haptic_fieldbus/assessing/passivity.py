"""Results of the energy accounts of a run, and the cost of the passivity controller."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.energy import CHANGE, PULSES
from haptic_fieldbus.numerals import in_unit, percent
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.traffic import Json


@dataclass(frozen=True)
class Controlled:
    """Cost of the passivity controller."""

    energy: float
    """Energy absorbed by its damping [J]."""
    peak: float
    """Its largest force on the first axis [N or N·m]."""
    share: float
    """Share of the periods in which it damped."""
    unit: str
    """Unit of its force."""

    def to_json(self) -> Json:
        return {"energy_j": self.energy, "peak": self.peak, "unit": self.unit, "share": self.share}


@dataclass(frozen=True)
class Passivity:
    """Energy account of one axis, or of axes that are coupled; energies in J."""

    axes: tuple[str, ...]
    largest: float
    """Largest generated energy; the run trips above `limit`."""
    limit: float
    booked: Mapping[str, float]
    """Energy by reason: granted to live changes and encoder test pulses, or forgiven during fade-in,
    stalls and doubts about the motor direction."""
    controller: Controlled | None
    """None in a scene without the controller."""
    forgiven: float = 0.0
    """Largest energy forgiven within a second; the run trips above `forgiven_limit`."""
    forgiven_limit: float = math.inf
    """Infinity if the account has no limit."""
    held: float = 0.0
    """Largest energy of torque held in gaps, beyond the stored energy and an imperceptible power; the run trips above
    50 mJ."""

    def to_json(self) -> Json:
        return {
            "axes": list(self.axes),
            "largest_j": self.largest,
            "limit_j": self.limit,
            "booked_j": dict(self.booked),
            "forgiven_j": self.forgiven,
            "forgiven_limit_j": self.forgiven_limit if math.isfinite(self.forgiven_limit) else None,
            "held_j": self.held,
            "controller": None if self.controller is None else self.controller.to_json(),
        }


def passivities(plan: Plan, cycle: Cycle, cycles: int) -> Iterator[Passivity]:
    """Yield the results of each ledger after `cycles` periods of operation enabled."""
    for ledger in cycle.ledgers:
        tally, controller = ledger.tally, None
        if plan.scene.controlled:
            unit = ledger.axes[0].workspace.effort_unit
            controller = Controlled(tally.taken, tally.strongest, tally.damped / cycles if cycles else 0.0, unit)
        names, forgiven = tuple(axis.name for axis in ledger.axes), (tally.most, tally.budget)
        yield Passivity(names, tally.largest, tally.limit, ledger.booked, controller, *forgiven, tally.held_most)


def forgiven_text(found: Passivity) -> str | None:
    """Return a sentence on the forgiven energy; None if it is below the limit of generated energy."""
    if found.forgiven <= found.limit:
        return None
    reasons = sorted(reason for reason in found.booked if reason not in (CHANGE, PULSES))
    return (
        f"{in_unit(sum(found.booked[reason] for reason in reasons), 'J')} more went into the handle than the scene "
        f"had stored, because another force than that of the scene acted ({', '.join(reasons)}); at most "
        f"{in_unit(found.forgiven, 'J')} within one second (limit {in_unit(found.forgiven_limit, 'J')})"
    )


def cost_text(found: Passivity) -> str | None:
    """Return a sentence on the cost of the controller; None without a controller."""
    cost = found.controller
    if cost is None:
        return None
    return (
        f"the passivity controller absorbed {in_unit(cost.energy, 'J')} with at most {in_unit(cost.peak, cost.unit)}, "
        f"in {percent(cost.share)} of the periods"
    )
