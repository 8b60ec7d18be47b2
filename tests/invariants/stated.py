"""What a plan has stated, as plain numbers: limits, places of words in frames, and deadlines.

Everything comes from the JSON of `plan --json`, from the numbers of the rig, and from the profile's own figures.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from tests.invariants.words import CONTROLWORD, OCTETS, STATUSWORD, TARGET_TORQUE

Json = Mapping[str, Any]


@dataclass(frozen=True)
class Place:
    """Where a word stands: identifier of the frame, its length, and the offset in it [octets]."""

    can_id: int
    length: int
    offset: int


@dataclass(frozen=True)
class StatedAxis:
    """One axis; torque in N·m at the motor shaft."""

    name: str
    node: int
    controlword: Place
    target: Place
    statusword: Place
    torque: float
    slew: float
    """[N·m/s]"""
    fade_in: float
    holding: float
    """[N·m] that a hand may be left alone with."""
    age: float
    speed: float
    """[m/s or rad/s] of the handle."""
    jump: float
    """Smallest second difference of the position that is surely noticed, in counts."""
    lag: float
    """[s] of the torque loop."""


@dataclass(frozen=True)
class Stated:
    """What was stated for one bus."""

    period: float
    axes: tuple[StatedAxis, ...]
    deadlines: Mapping[str, float]
    """[s] from an event to zero torque, by the cause; a cause that nothing notices is not there."""


def stated(
    plan: Json,
    period: float,
    ratios: Mapping[str, float],
    counts: Mapping[str, int],
    lags: Mapping[str, float],
    frictions: Mapping[str, float],
) -> Stated:
    """Read a plan; by axis: ratio [m or rad of the handle in a rad], counts a revolution, lag [s], friction [N·m]."""
    pdos = list(plan["pdos"] or ())
    limits: dict[str, dict[str, float]] = {}
    for row in plan["limits"]:
        limits.setdefault(row["axis"], {})[row["limit"]] = row["value"]
    # Axes and their PDOs stand in the same order.
    nodes = dict(zip(limits, dict.fromkeys(pdo["node"] for pdo in pdos), strict=True))
    return Stated(
        period,
        tuple(
            _axis(name, nodes[name], pdos, limits[name], abs(ratios[name]), counts[name], lags[name], frictions[name])
            for name in limits
        ),
        {row["cause"]: 1e-3 * row["stated_ms"] for row in plan["deadlines"] if row["stated_ms"] is not None},
    )


def _axis(
    name: str,
    node: int,
    pdos: Iterable[Json],
    limits: Mapping[str, float],
    ratio: float,
    counts: int,
    lag: float,
    friction: float,
) -> StatedAxis:
    own = [pdo for pdo in pdos if pdo["node"] == node]
    force = limits.get("force", limits.get("torque"))
    assert force is not None, f"axis {name} has no limit of its force: {list(limits)}"
    return StatedAxis(
        name,
        node,
        _place(own, CONTROLWORD),
        _place(own, TARGET_TORQUE),
        _place(own, STATUSWORD),
        # Work is the same on both sides of the mechanism: a force times its metres in a radian is a torque.
        force * ratio,
        limits["slew"] * ratio,
        limits["fade-in of the limit"],
        # Where friction is larger, a motor may break away before its sign is seen: a tenth more than friction.
        max(limits["force at standstill"] * ratio, 1.1 * friction),
        limits["age of feedback"],
        limits["speed"],
        limits.get("jump in a period", float("inf")) / (ratio * 6.283185307179586 / counts),
        lag,
    )


def _place(pdos: Iterable[Json], wanted: str) -> Place:
    for pdo in pdos:
        offset = 0
        for mapped in pdo["mapped"]:
            index = mapped.partition(":")[0]
            if index == wanted:
                return Place(pdo["cob_id"], pdo["octets"], offset)
            offset += OCTETS[index]
    raise AssertionError(f"{wanted} is in no PDO")
