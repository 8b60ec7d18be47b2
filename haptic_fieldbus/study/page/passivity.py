"""Section on the passivity controller: stability, feel and cost of a wall with and without it."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from haptic_fieldbus import Result, Rig, Scene, SceneAxis, Workspace
from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.report.drawing import BLUE, INK, ORANGE, dress, figure, name_lines, svg
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.measure.bench import Tools
from haptic_fieldbus.study.page.html import Context, Section, paragraph, picture, table

# What the passivity controller does to a wall: how its oscillation decays or grows, what it feels like, and its cost.
#
# A handle is let go beside a bilateral wall, on the shipped bench without Coulomb friction, which would hold small
# motions. How much larger each turn is than the one before tells how stable the loop is; where it is 1 lies the limit.
# The error is that of a tap with the hand of the simulation on the wall of the library.

AXES = (SceneAxis("handle", Workspace.LINEAR),)
START_FORCE = 6.0
"""Force on the handle when it is released [N]."""
FADED_IN = 0.6
"""Start of the measurement of turns [s]."""
FELT = Wall("handle", 600.0, 0.02)
"""Wall of the tap."""


@dataclass(frozen=True)
class Decay:
    """Growth of an oscillation in a wall of `share` of its stability limit, and the cost of the controller if any."""

    share: float
    controlled: bool
    growth: float
    """Mean ratio of the size of a turn to that of the turn before."""
    peak: float | None = None
    """Largest force of the controller [N]."""
    energy: float | None = None
    """Energy absorbed by the controller [J]."""


@dataclass(frozen=True)
class WallTap:
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
    rig = _endless(tools)
    rig = replace(rig, axis={name: replace(axis, coulomb_friction=0.0) for name, axis in rig.axis.items()})
    limit = _limit(tools, rig)
    for share in shares:
        stiffness = share * limit
        wall = Wall("handle", stiffness, position=START_FORCE / stiffness, sides="bilateral")
        for scene in _both(wall):
            result = tools.run(scene, rig, bus="sim", hand="none", duration=duration, force=True)
            cost = result.passivity[0].controller
            growth = _growth(result, wall.position)
            if cost is None:
                yield Decay(share, scene.controlled, growth)
            else:
                yield Decay(share, scene.controlled, growth, cost.peak, cost.energy)


def felt(tools: Tools, duration: float) -> list[WallTap]:
    """Return a tap on the wall without and with the controller."""
    rig = _endless(tools)
    return [_felt(scene, tools.run(scene, rig, bus="sim", hand="tap", duration=duration)) for scene in _both(FELT)]


def limit_share(found: Iterable[Decay], *, controlled: bool) -> tuple[float, float] | None:
    """Return two neighbouring shares: oscillations decay at the first and grow at the second. None: no such pair."""
    rows = [each for each in found if each.controlled == controlled]
    for below, above in pairwise(rows):
        if below.growth <= 1.0 < above.growth:
            return below.share, above.share
    return None


def _both(wall: Wall) -> list[Scene]:
    plain = Scene("wall", "", AXES, (wall,))
    return [plain, replace(plain, passivity="controller")]


def _felt(scene: Scene, result: Result) -> WallTap:
    error, cost = result.torque_error, result.passivity[0].controller
    contact = None if error is None else error.contact
    peak, periods = (None, None) if cost is None else (cost.peak, cost.share)
    return WallTap(scene.controlled, contact, result.energy_generated, peak, periods)


def _endless(tools: Tools) -> Rig:
    """Return the shipped bench without end of travel: a tapping hand drifts beyond the travel after some contacts."""
    rig = tools.plan("wall").rig
    axes = {name: replace(axis, limits=replace(axis.limits, position=None)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes)


def _limit(tools: Tools, rig: Rig) -> float:
    """Return the limit of stability of a wall on that bench [N/m]."""
    stability = tools.plan(Scene("wall", "", AXES, (FELT,)), rig, bus="sim").stability
    if stability is None or stability.stiffness_limit.stable is None:
        raise ValueError("a wall on the shipped bench has a limit of stability")
    return stability.stiffness_limit.stable


def _growth(result: Result, position: float) -> float:
    """Return the mean ratio of a turn to the one before, from the largest distances between crossings."""
    (trace,) = result.traces
    x = trace.position[trace.times > FADED_IN] - position
    cuts = np.flatnonzero(np.diff(np.sign(x)))
    sizes = [float(np.abs(x[a + 1 : b + 1]).max()) for a, b in pairwise(cuts)]
    # Two half turns make a turn; turns below a tenth of the first are those of encoder counts.
    kept = [size for size in sizes if size > 0.1 * sizes[0]] if sizes else []
    return float((kept[-1] / kept[0]) ** (2.0 / (len(kept) - 1))) if len(kept) > 1 else 0.0


QUICK, FULL = (0.5, 0.95, 1.05, 3.0), (0.25, 0.5, 0.75, 0.95, 1.05, 1.3, 1.6, 2.0, 2.5, 3.0)
"""Shares of the stability limit; both reports contain the shares around a finding, so both give the same finding."""
DURATION, TAPPED = 2.0, 4.0
"""Length of each run, and of the tap [s of virtual time]."""
NAMES = {False: "observer alone", True: "controller"}
COLOURS = {False: ORANGE, True: BLUE}

EXPLAINED = """With <code>passivity = "controller"</code> damping absorbs the energy that sampling and delay add, as
far as the observer measures it: held torque times the displacement after it, compared with the energy stored in the
elements. The left figure and the first table: a handle is released beside a bilateral wall, on the shipped bench
without Coulomb friction; below 1 each swing is smaller than the one before. The second table: a tap on the wall of
the library, where the bench would absorb that energy anyway. There the controller only changes the feel."""


def passivity_section(context: Context) -> Section:
    """Measure decays and a tap, without and with the controller, and return their section."""
    shares = QUICK if context.quick else FULL
    found: list[Decay] = []
    for share in context.with_progress(shares, lambda share: f"passivity, {rounded(share)} of the limit"):
        found += decays(context.tools, (share,), DURATION)
    taps = felt(context.tools, TAPPED)
    document = svg(draw(found))
    caption = "Growth per swing over stiffness, as a share of the limit. Above the line the motion grows."
    body = [paragraph(EXPLAINED), picture("passivity", document, caption), _decay_table(found), _felt_table(taps)]
    return Section(
        "passivity",
        "Passivity controller",
        "".join(body),
        (_finding(found, taps),),
        {"passivity": document},
        {"decay": [asdict(each) for each in found], "tap": [asdict(each) for each in taps]},
    )


def draw(found: Sequence[Decay]) -> Figure:
    """Return a figure of the growth with and without the controller."""
    drawn = figure(3.4)
    panel = drawn.subplots()
    for controlled, name in NAMES.items():
        rows = [each for each in found if each.controlled == controlled]
        panel.plot([each.share for each in rows], [each.growth for each in rows], "o-", color=COLOURS[controlled],
                   label=name)  # fmt: skip
    panel.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    dress(panel, "a handle released beside a wall", "stiffness over the stability limit [1]", "growth per swing [1]")
    name_lines(drawn)
    return drawn


def _decay_table(found: Sequence[Decay]) -> str:
    headings = ("stiffness over its limit", "growth per swing", "with the controller", "its largest force [N]",
                "energy it took [mJ]")  # fmt: skip
    rows = [
        [plain.share, plain.growth, damped.growth, damped.peak, _scaled(1e3, damped.energy)]
        for plain, damped in zip(found[::2], found[1::2], strict=True)
    ]
    return table(headings, rows, text_columns=0)


def _felt_table(taps: Sequence[WallTap]) -> str:
    headings = ("a tap with", "error in contact, % of force", "energy put in [mJ]", "its largest force [N]",
                "periods in which it damps [%]")  # fmt: skip
    return table(headings, (
        [NAMES[tap.controlled], _scaled(100.0, tap.error), _scaled(1e3, tap.energy), tap.peak,
         _scaled(100.0, tap.periods)]
        for tap in taps
    ))  # fmt: skip


def _scaled(factor: float, value: float | None) -> float | None:
    """Return a multiple of a value; None if the value is unknown."""
    return None if value is None else factor * value


def _finding(found: Sequence[Decay], taps: Sequence[WallTap]) -> str:
    plain, controlled = limit_texts(found)
    told = f"A handle released beside a wall swings with growing amplitude {plain}, with the controller {controlled}"
    before, after = (tap.error for tap in taps)
    if before is None or after is None:
        return f"{told}."
    return (
        f"{told}; a tap on the wall of the library has a force error of {percent(before)}, and of {percent(after)} "
        "with the controller."
    )


def limit_texts(found: Sequence[Decay]) -> tuple[str, str]:
    """Return the shares at which oscillations begin to grow, without and with the controller, in words."""
    return _limit_text(found, controlled=False), _limit_text(found, controlled=True)


def _limit_text(found: Sequence[Decay], *, controlled: bool) -> str:
    limit = limit_share(found, controlled=controlled)
    if limit is None:
        return f"at no stiffness up to {rounded(found[-1].share)} times the limit of stability"
    below, above = limit
    return f"at {rounded(above)} times the limit of stability, and not at {rounded(below)} times"
