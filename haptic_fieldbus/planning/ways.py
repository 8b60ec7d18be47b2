"""Stiffness limits of the ways in which a bus could exchange feedback and set-points: that of the plan, and others."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from haptic_fieldbus.numerals import exactly, rounded, rounded_limit
from haptic_fieldbus.planning.plan import BusPlan, Plan
from haptic_fieldbus.planning.verdicts import on_bus, with_verdicts
from haptic_fieldbus.protocols.traffic import BusTraffic, Json


@dataclass(frozen=True)
class WayLimit:
    """The limit of stability that the weakest axis of a plan has by one way of exchange."""

    bus: str
    exchange: str
    """The way in words."""
    rate: float
    """[Hz]: that of the plan, or the highest that the way sustains."""
    delay: float
    """Longest time from sampling to acting of an axis on the bus, with the lag of the torque loop [s]."""
    limit: float | None
    """[N/m or N·m/rad]; None when no stiffness can be varied, or a bench is unknown."""
    unit: str
    chosen: bool

    def text(self) -> str:
        """Return the way with its limit in words."""
        stable = "" if self.limit is None else f": stable to {rounded_limit(self.limit)} {self.unit}"
        chosen = ", chosen" if self.chosen else ""
        return f"{self.exchange} at {exactly(self.rate)} Hz, delay {rounded(1e3 * self.delay)} ms{stable}{chosen}"

    def to_json(self) -> dict[str, Json]:
        """Return the object of `plan --json` and `stability --json`."""
        return {
            "bus": self.bus,
            "exchange": self.exchange,
            "rate_hz": self.rate,
            "delay_s": self.delay,
            "stiffness_limit": self.limit,
            "chosen": self.chosen,
        }


def way_limits(plan: Plan) -> tuple[WayLimit, ...]:
    """Return the limits of each bus with several ways, the chosen way first; empty where each bus has one way."""
    return tuple(limit for bus in plan.buses for limit in _of_bus(plan, bus))


def _of_bus(plan: Plan, bus: BusPlan) -> Iterator[WayLimit]:
    others = bus.traffic.others()
    if others:
        yield _limit(plan, bus, bus.traffic)
    for traffic in others:
        yield _limit(_by(plan, bus, traffic), bus, traffic)


def _by(plan: Plan, bus: BusPlan, traffic: BusTraffic) -> Plan:
    """Return the plan with one bus exchanging in another way; only its delays, period and verdicts are those."""
    period = round(1e9 / traffic.rate) * 1e-9
    axes = [on_bus(axis, traffic, period) if axis.name in bus.axes else axis for axis in plan.axes]
    return replace(plan, rate=traffic.rate, axes=with_verdicts(axes, period))


def _limit(plan: Plan, bus: BusPlan, traffic: BusTraffic) -> WayLimit:
    weakest, found = plan.weakest, plan.stability
    limit = None if found is None else found.stiffness_limit.stable
    unit = "" if weakest is None else f"{weakest.workspace.effort_unit}/{weakest.workspace.length_unit}"
    delay = max(axis.delay.total for axis in plan.axes if axis.name in bus.axes)
    return WayLimit(bus.name, traffic.exchange, traffic.rate, delay, limit, unit, traffic is bus.traffic)
