"""What the energy ledgers of a run have seen, and what the passivity controller cost."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.numerals import in_unit, percent
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.traffic import Json


@dataclass(frozen=True)
class Controlled:
    """Cost of the passivity controller."""

    energy: float
    """Energy that its damping took from the handle [J]."""
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
    """The ledger of one axis, or of the axes that couplings tie together; energies in J."""

    axes: tuple[str, ...]
    largest: float
    """Most that an account was above what is granted; a run ends above the limit."""
    limit: float
    booked: Mapping[str, float]
    """Energy given during the fade-in, live changes and gaps, by the reason."""
    controller: Controlled | None
    """None in a scene without the controller."""

    def to_json(self) -> Json:
        return {
            "axes": list(self.axes),
            "largest_j": self.largest,
            "limit_j": self.limit,
            "booked_j": dict(self.booked),
            "controller": None if self.controller is None else self.controller.to_json(),
        }


def passivities(plan: Plan, cycle: Cycle, cycles: int) -> Iterator[Passivity]:
    """Yield what each ledger has seen in `cycles` periods of operation enabled."""
    for ledger in cycle.ledgers:
        tally, controller = ledger.tally, None
        if plan.scene.controlled:
            unit = ledger.axes[0].workspace.effort_unit
            controller = Controlled(tally.taken, tally.strongest, tally.damped / cycles if cycles else 0.0, unit)
        names = tuple(axis.name for axis in ledger.axes)
        yield Passivity(names, tally.largest, tally.limit, dict(tally.booked), controller)


def cost_text(found: Passivity) -> str | None:
    """Return what the controller cost in a sentence; None without one."""
    cost = found.controller
    if cost is None:
        return None
    return (
        f"the controller took {in_unit(cost.energy, 'J')} from the hand, with at most "
        f"{in_unit(cost.peak, cost.unit)}, in {percent(cost.share)} of the periods"
    )
