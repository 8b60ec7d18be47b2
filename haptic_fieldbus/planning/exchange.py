"""Exchange of a plan with its drives: the rate, the wait of each bus for the others, and the way of its exchange.

A bus may be able to exchange feedback and set-points in several ways. The one that bears the stiffest scene on this
bench is taken. Where all bear the same, or nothing is known (no stiffness, an unknown bench), it is the first that the
protocol names.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.rig import BusSection, Rig
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.plan import BusPlan
from haptic_fieldbus.planning.verdicts import grouped, on_bus
from haptic_fieldbus.protocols.protocol import FieldbusProtocol, Members
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.protocols.traffic import BusTraffic

Drafts = Callable[[float | None], list[AxisPlan]]
"""Returns the drafts of all axes at a period [s]; None: at none."""
_ROUNDS = 2
"""Times that the waits of several buses are found."""


@dataclass(frozen=True)
class _Bus:
    """One bus with its axes."""

    protocol: FieldbusProtocol
    section: BusSection
    members: Members

    def ways(self, rate: float | None, waiting: float) -> Sequence[BusTraffic]:
        return self.protocol.ways(self.section, self.members, rate, waiting)


def plan_buses(drafts_at: Drafts, rig: Rig, rate: float | None) -> tuple[BusPlan, ...]:
    """Return the buses with their traffic at `rate` [Hz], in the order in which the axes name them.

    Without a rate it is the one that the chosen way has by itself, with several buses the lowest of them. All buses
    begin together, and computing begins when the slowest has its feedback; the others wait for it. Raises
    BusOverloadError when a bus cannot carry this.
    """
    drafts = drafts_at(None)
    buses = {
        name: _Bus(protocol_named(rig.bus[name].protocol), rig.bus[name], _members(name, drafts))
        for name in dict.fromkeys(draft.rig.bus for draft in drafts)
    }
    # First without any wait, because the waits follow from the feedback times, and these can change with a wait.
    together = _together(buses, dict.fromkeys(buses, 0.0), drafts_at, rate)
    for _ in range(_ROUNDS):
        last = max(traffic.feedback_time for traffic in together.values())
        waits = {name: last - traffic.feedback_time for name, traffic in together.items()}
        together = _together(buses, waits, drafts_at, rate) if any(waits.values()) else together
    # A rate that the fullest bus can carry fits all, so the rate that its error proposes is right for all.
    fullest = min(together, key=lambda name: together[name].highest_rate)
    together[fullest].check(fullest if len(together) > 1 else "")
    return tuple(
        BusPlan(name, rig.bus[name].protocol, traffic, tuple(draft.name for draft in drafts if draft.rig.bus == name))
        for name, traffic in together.items()
    )


def _members(name: str, drafts: Sequence[AxisPlan]) -> Members:
    return {draft.name: (draft.profile, draft.traffic) for draft in drafts if draft.rig.bus == name}


def _together(
    buses: Mapping[str, _Bus], waits: Mapping[str, float], drafts_at: Drafts, rate: float | None
) -> dict[str, BusTraffic]:
    """Return the traffic of each bus, whose feedback waits so long for that of other buses [s]."""
    if rate is None and len(buses) > 1:
        rate = _common_rate([bus.ways(None, waits[name])[0].rate for name, bus in buses.items()])
    return _stiffest({name: bus.ways(rate, waits[name]) for name, bus in buses.items()}, drafts_at)


def _common_rate(rates: Sequence[float]) -> float:
    """Return the rate of several buses [Hz]; its period is in whole milliseconds, which every drive can take."""
    return 1e3 / math.ceil(1e3 / min(rates))


def _stiffest(ways: Mapping[str, Sequence[BusTraffic]], drafts_at: Drafts) -> dict[str, BusTraffic]:
    """Return the way of each bus by which the scene can be the stiffest, the first of several that are equal."""
    chosen = {name: each[0] for name, each in ways.items()}
    for name, each in ways.items():
        if len(each) > 1:
            margins = [_margin({**chosen, name: way}, drafts_at) for way in each]
            chosen[name] = each[margins.index(max(margins))]
    return chosen


def _margin(traffics: Mapping[str, BusTraffic], drafts_at: Drafts) -> float:
    """Return the least limit of stability over stiffness of all axes; ∞ when none is known."""
    period = round(1e9 / next(iter(traffics.values())).rate) * 1e-9
    axes = [on_bus(draft, traffics[draft.rig.bus], period) for draft in drafts_at(period)]
    return min((group.rough_margin() for group in grouped(axes, period)), default=math.inf)
