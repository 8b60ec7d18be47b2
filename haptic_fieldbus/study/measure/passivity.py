"""What the passivity controller does to a wall: how its oscillation decays or grows, what it feels like, and its cost.

A handle is let go beside a bilateral wall, on the shipped bench without Coulomb friction, which would hold small
motions. How much larger each turn is than the one before tells how stable the loop is; where it is 1 lies the limit.
The error is that of a tap with the hand of the simulation on the wall of the library.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from haptic_fieldbus.assessing.result import Result, Trace
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.study.measure.bench import Tools

AXES = (SceneAxis("handle", Workspace.LINEAR),)
START_FORCE = 6.0
"""Force at which the handle is let go [N]."""
FADED_IN = 0.6
"""Time from which on turns are measured [s]."""
FELT = Wall("handle", 600.0, 0.02)
"""Wall of the tap."""


@dataclass(frozen=True)
class Decay:
    """Growth of an oscillation in a wall of `share` of its stability limit, and the cost of the controller if any."""

    share: float
    controlled: bool
    growth: float
    """Size of a turn over that of the turn before, on average."""
    peak: float | None = None
    """Largest force of the controller [N]."""
    energy: float | None = None
    """Energy that it took [J]."""


@dataclass(frozen=True)
class Felt:
    """A tap on the wall of the library."""

    controlled: bool
    error: float | None
    """Rms force error over rms force in contact."""
    energy: float | None
    """Energy that the error gave to the hand [J]."""
    peak: float | None
    """Largest force of the controller [N]."""
    periods: float | None
    """Share of the periods in which it damped."""


def decays(tools: Tools, shares: Iterable[float], duration: float) -> Iterable[Decay]:
    """Yield the decay at each share of the stability limit, without and with the controller."""
    rig = _smooth(tools)
    limit = _limit(tools, rig)
    for share in shares:
        stiffness = share * limit
        wall = Wall("handle", stiffness, position=START_FORCE / stiffness, sides="bilateral")
        for scene in _both(wall):
            result = tools.run(scene, rig, bus="sim", hand="none", duration=duration, force=True)
            cost = result.passivity[0].controller
            growth = _growth(result.traces[0], wall.position)
            if cost is None:
                yield Decay(share, scene.controlled, growth)
            else:
                yield Decay(share, scene.controlled, growth, cost.peak, cost.energy)


def felt(tools: Tools, duration: float) -> list[Felt]:
    """Return a tap on the wall without and with the controller."""
    rig = _endless(tools)
    return [_felt(scene, tools.run(scene, rig, bus="sim", hand="tap", duration=duration)) for scene in _both(FELT)]


def limit_share(found: Iterable[Decay], *, controlled: bool) -> tuple[float, float] | None:
    """Return the neighbouring shares of which oscillations decay at the first and grow at the second; None: nowhere."""
    rows = [each for each in found if each.controlled == controlled]
    for below, above in pairwise(rows):
        if below.growth <= 1.0 < above.growth:
            return below.share, above.share
    return None


def _both(wall: Wall) -> list[Scene]:
    plain = Scene("wall", "", AXES, (wall,))
    return [plain, replace(plain, passivity="controller")]


def _felt(scene: Scene, result: Result) -> Felt:
    error, cost = result.torque_error, result.passivity[0].controller
    contact = None if error is None else error.contact
    peak, periods = (None, None) if cost is None else (cost.peak, cost.share)
    return Felt(scene.controlled, contact, result.energy_generated, peak, periods)


def _endless(tools: Tools) -> Rig:
    """Return the shipped bench with an endless way: a hand that taps carries the handle off it after some contacts."""
    rig = tools.plan("wall").rig
    axes = {name: replace(axis, limits=replace(axis.limits, position=None)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes)


def _smooth(tools: Tools) -> Rig:
    """Return the same bench without Coulomb friction."""
    rig = _endless(tools)
    return replace(rig, axis={name: replace(axis, coulomb_friction=0.0) for name, axis in rig.axis.items()})


def _limit(tools: Tools, rig: Rig) -> float:
    """Return the limit of stability of a wall on that bench [N/m]."""
    stability = tools.plan(Scene("wall", "", AXES, (FELT,)), rig, bus="sim").stability
    if stability is None or stability.stiffness_limit.stable is None:
        raise ValueError("a wall on the shipped bench has a limit of stability")
    return stability.stiffness_limit.stable


def _growth(trace: Trace, position: float) -> float:
    """Return the mean ratio of a turn to the one before, from the largest distances between crossings."""
    x = trace.position[trace.times > FADED_IN] - position
    cuts = np.flatnonzero(np.diff(np.sign(x)))
    sizes = [float(np.abs(x[a + 1 : b + 1]).max()) for a, b in pairwise(cuts)]
    # Two half turns make a turn; turns below a tenth of the first are those of encoder counts.
    kept = [size for size in sizes if size > 0.1 * sizes[0]] if sizes else []
    return float((kept[-1] / kept[0]) ** (2.0 / (len(kept) - 1))) if len(kept) > 1 else 0.0
