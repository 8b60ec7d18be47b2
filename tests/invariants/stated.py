"""Statements of a plan as plain numbers: limits, places of words in frames, and deadlines.

Everything comes from the JSON of `plan --json`, from the numbers of the rig, and from the profile's own figures.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.invariants.words import CONTROLWORD, OCTETS, STATUSWORD, TARGETS

Json = Mapping[str, Any]
STILL, PULSES = "force on an encoder that stands still", "pulses that ask the encoder"
SHARE_OF_RATED, AT_THE_HANDLE = 0.15, {"linear": 5.0, "rotary": 0.25}
"""Of torque before the sign is seen, as the documentation promises it: a share of rated torque, and [N or N·m]."""


@dataclass(frozen=True)
class Place:
    """Where a word stands: identifier of the frame, its length, and offset and size of the word in it [octets]."""

    can_id: int
    length: int
    offset: int
    size: int = 2


@dataclass(frozen=True)
class StatedProbe:
    """How the sign is looked for that nobody knows; torque in N·m at the motor shaft."""

    pulses: float
    """The largest one."""
    holding: float
    """Force that the scene is given until then."""
    least: float
    """[s] until the sign can have been seen."""
    permitted: float
    """The largest one that no description of the bench may raise, at the handle: 5 N or 0.25 N·m."""
    share: float
    """The largest share of rated torque likewise; infinity for a drive that does not tell what it is a share of."""


@dataclass(frozen=True)
class StatedQuestion:
    """How an encoder is asked whose counts stand still."""

    torque: float
    """Least torque under which it is asked [N·m at the motor shaft]."""
    pulse: float
    """[N·m at the motor shaft]"""
    seconds: float
    """Time after which one that does not answer ends the run."""


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
    age: float
    speed: float
    """[rad/s] of the motor shaft."""
    jump: float
    """Smallest second difference of the position that is surely noticed, in counts."""
    lag: float
    """[s] of the torque loop."""
    probe: StatedProbe | None
    """None where the sign is known."""
    guard: float
    """[s] after which the drive lets go by itself."""
    blind: float | None
    """[s] for which a set-point of another master may act unseen; None where its messages are heard."""
    unproved: bool
    """Whether nothing is known of the guard, so that it must be proved before force is given on a real bus."""
    question: StatedQuestion | None = None
    """None where the encoder is not asked."""

    @property
    def unseen(self) -> float:
        """Largest torque while the sign is not known."""
        return 0.0 if self.probe is None else min(self.torque, max(self.probe.pulses, self.probe.holding))

    def permitted(self, seconds: NDArray[np.float64], period: float) -> NDArray[np.float64]:
        """The torque that is permitted so long after enabling; it fades in, from `holding` when the sign was seen."""
        # A period for the way to the wire, and one in which the limit rises.
        share = 2.0 * period / self.fade_in
        if self.probe is None:
            return (np.clip(seconds / self.fade_in, 0.0, 1.0) + share) * self.torque
        risen = np.clip((seconds - self.probe.least) / self.fade_in + share, 0.0, 1.0) * self.torque
        began = seconds >= self.probe.least
        return np.where(began, np.maximum(self.unseen, self.probe.holding + risen), self.unseen)


@dataclass(frozen=True)
class Stated:
    """Statements for one bus."""

    period: float
    axes: tuple[StatedAxis, ...]
    deadlines: Mapping[str, float]
    """[s] from an event to zero torque, by the cause; a cause that nothing notices is not there."""
    coupled: bool = True
    """Whether couplings tie the axes, so that what one of them misses all miss."""

    def deadline(self, cause: str) -> float:
        """[s]; ∞ for a cause that only a person ends, as with a drive that does not watch its master."""
        return self.deadlines.get(cause, math.inf)


def stated(
    plan: Json,
    period: float,
    ratios: Mapping[str, float],
    counts: Mapping[str, int],
    lags: Mapping[str, float],
    blind: Mapping[str, float | None],
) -> Stated:
    """Read a plan; by axis: metres or radians of the handle in a radian, counts in a revolution, and lags [s].

    `blind` has the time for which a set-point of another master may act unseen [s].
    """
    pdos = list(plan["pdos"] or ())
    limits: dict[str, dict[str, float]] = {}
    times: dict[str, float] = {}
    for row in plan["limits"]:
        limits.setdefault(row["axis"], {})[row["limit"]] = row["value"]
        if row["limit"] == STILL:
            times[row["axis"]] = row["after_s"]
    probes = {row["axis"]: row for row in plan["sign"] if row["pulses"]}
    guards = {row["axis"]: row for row in plan["guards"]}
    permissions = {row["axis"]: row for row in plan["permissions"]}
    # Axes and their PDOs stand in the same order.
    nodes = dict(zip(limits, dict.fromkeys(pdo["node"] for pdo in pdos), strict=True))
    return Stated(
        period,
        tuple(
            _axis(
                name,
                nodes[name],
                pdos,
                limits[name],
                abs(ratios[name]),
                counts[name],
                lags[name],
                probes.get(name),
                permissions[name],
                guards[name],
                blind[name],
                times.get(name),
            )
            for name in limits
        ),
        {row["cause"]: 1e-3 * row["stated_ms"] for row in plan["deadlines"] if row["stated_ms"] is not None},
        bool(plan.get("couplings", True)),
    )


def _axis(
    name: str,
    node: int,
    pdos: Iterable[Json],
    limits: Mapping[str, float],
    ratio: float,
    counts: int,
    lag: float,
    probe: Json | None,
    permission: Json,
    guard: Json,
    blind: float | None,
    still: float | None,
) -> StatedAxis:
    own = [pdo for pdo in pdos if pdo["node"] == node]
    force = limits.get("force", limits.get("torque"))
    assert force is not None, f"axis {name} has no limit of its force: {list(limits)}"
    return StatedAxis(
        name,
        node,
        _place(own, CONTROLWORD),
        _place(own, *TARGETS),
        _place(own, STATUSWORD),
        # Work is the same on both sides of the mechanism: a force times its metres in a radian is a torque.
        force * ratio,
        limits["slew"] * ratio,
        limits["fade-in of the limit"],
        limits["age of feedback"],
        limits["speed"] / ratio,
        limits.get("jump in a period", float("inf")) / (ratio * 6.283185307179586 / counts),
        lag,
        None if probe is None else _probe(probe, permission, ratio),
        1e-3 * guard["guard_ms"],
        blind,
        guard["unproved"] is not None and guard["capped"] is None,
        None if still is None else StatedQuestion(limits[STILL] * ratio, limits[PULSES] * ratio, still),
    )


def _probe(row: Json, permission: Json, ratio: float) -> StatedProbe:
    largest = max(effort for effort, _ in row["pulses"])
    most = permission["sign_effort"] or AT_THE_HANDLE[permission["workspace"]]
    share = (permission["sign_pulse"] or SHARE_OF_RATED) if row["checked"] else math.inf
    return StatedProbe(largest * ratio, row["permitted_until_then"] * ratio, row["least_s"], most * ratio, share)


def _place(pdos: Iterable[Json], *wanted: str) -> Place:
    for pdo in pdos:
        offset = 0
        for mapped in pdo["mapped"]:
            index = mapped.partition(":")[0]
            if index in wanted:
                return Place(pdo["cob_id"], pdo["octets"], offset, OCTETS[index])
            offset += OCTETS[index]
    raise AssertionError(f"{wanted} is in no PDO")
