"""Sections on stability: stiff and extreme cases, the K–B region, and the passivity controller."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from time import perf_counter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from haptic_fieldbus import Result, Rig, Scene, SceneAxis, Workspace
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report import drawing
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.study.case import Case, CaseResult
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.measure.bench import Tools
from haptic_fieldbus.study.measure.region import LARGEST, Ending, Plane, Region, border, plane, region
from haptic_fieldbus.study.page import html

# All stiff and extreme cases by margin, in one figure: how much of what is permitted each of them needs.

FAMILIES = {
    "integrators": "integrators, extreme masses",
    "closed_loop": "walls and bodies in the loop",
    "sharing": "Z-width, energy, contact",
    "ledger": "energy, passivity",
    "friction": "friction, encoder counts",
    "sensing": "sensing, torque lag",
    "timing": "lost samples, ticks, Modbus",
    "elements": "stiff elements",
    "stated": "stated limits, score",
    "drive": "faults, clock",
}
"""Rows of the figure by the module of a case; a module that is not here has a row by its own name."""
WORST, FURTHEST, EXACT = 0.1, 1e10, 1e12
"""Margins at both ends of the frame, and the place of cases that are exact, or judged by yes or no."""
TOLD = """Each mark is one case. Its margin is the permitted deviation divided by the found deviation: a case left
of 1 fails. Cases without a number, such as a refusal in exact words, and cases without deviation are at the right.
The label beside each row is its closest case."""


def family_of(case: Case) -> str:
    """Return the row of a case."""
    module = (case.func if isinstance(case, partial) else case).__module__.rpartition(".")[2]
    return FAMILIES.get(module, module.replace("_", " "))


def margin_of(result: CaseResult) -> float:
    """Return the permitted over the found deviation; ∞ for an exact case, 0 for a case that fails otherwise."""
    if not result.passed and (result.used is None or result.used <= 1.0):
        return 0.0
    return 1.0 / result.used if result.used else math.inf


def draw(cases: Mapping[str, Case], found: Mapping[str, CaseResult]) -> Figure:
    """Return a figure with a row for each family and a mark for each case."""
    drawn = drawing.figure(*html.WIDE_CARD)
    panel = drawn.subplots()
    seen = {family_of(cases[name]) for name in found}
    rows = [*(row for row in dict.fromkeys(FAMILIES.values()) if row in seen), *sorted(seen - set(FAMILIES.values()))]
    for name, result in found.items():
        colour, marker = (drawing.BLUE, "o") if result.passed else (drawing.VERMILION, "X")
        colour = drawing.GREEN if result.passed and math.isinf(margin_of(result)) else colour
        margin = margin_of(result)
        place = EXACT if math.isinf(margin) else min(max(margin, 2.0 * WORST), FURTHEST)
        panel.plot(place, rows.index(family_of(cases[name])), marker, color=colour, markersize=5, alpha=0.75,
                   markeredgewidth=0)  # fmt: skip
    for place, row in enumerate(rows):
        exact = sum(family_of(cases[name]) == row and math.isinf(margin_of(found[name])) for name in found)
        panel.text(2.0 * EXACT, place, f"{exact}" if exact > 1 else "", va="center", size=6.5, color=drawing.GREEN)
    _frame(panel, rows)
    _name_closest(panel, rows, cases, found)
    return drawn


def _name_closest(panel: Axes, rows: Sequence[str], cases: Mapping[str, Case], found: Mapping[str, CaseResult]) -> None:
    """Name the case closest to its tolerance in each row, with its margin; or all failed cases of the row."""
    ordered = closest(found)
    for place, row in enumerate(rows):
        names = [name for name in ordered if family_of(cases[name]) == row]
        failed = [name for name in names if not found[name].passed]
        margin = f" {rounded(margin_of(found[names[0]]))}" if names and not failed else ""
        panel.annotate(", ".join(failed or names[:1]) + margin, (1.0, place), xycoords=panel.get_yaxis_transform(),
                       xytext=(5, 0), textcoords="offset points", va="center", size=7.2,
                       color=drawing.VERMILION if failed else "#444444")  # fmt: skip


def closest(found: Mapping[str, CaseResult]) -> list[str]:
    """Return the cases with a margin, the smallest margin first."""
    known = [name for name, result in found.items() if not math.isinf(margin_of(result))]
    return sorted(known, key=lambda name: margin_of(found[name]))


def _frame(panel: Axes, rows: Sequence[str]) -> None:
    """Scale the axes, shade the range of failures, and separate the exact cases."""
    panel.set(xscale="log", xlim=(WORST, 10.0 * EXACT))
    panel.axvspan(WORST, 1.0, color="#fbeee6", linewidth=0, zorder=0)
    panel.axvline(1.0, color=drawing.VERMILION, linewidth=1.0, zorder=1)
    panel.axvspan(3.0 * FURTHEST, 10.0 * EXACT, color="#eef6f2", linewidth=0, zorder=0)
    panel.set_yticks(range(len(rows)), rows)
    panel.set_ylim(len(rows) - 0.4, -0.6)
    drawing.card_panel(panel, "", "margin: deviation permitted over deviation found [1]", "")
    ticks = [10.0**power for power in range(0, 11, 2)]
    panel.set_xticks([*ticks, EXACT], [*(rounded(tick) for tick in ticks), "exact"])
    panel.minorticks_off()
    panel.text(0.32, -0.35, "fails", ha="center", va="center", size=7, color=drawing.GREY)


# Section on stiff and extreme cases; a case that raises an error counts as failed, and the others go on.

EXPLAINED = """Cases that break simple code. Each is checked by an independent reference: a closed form, extended
precision, or brute force. <i>Expected</i> is the theory, <i>measured</i> the result of the code."""


def run_case(case: Case, quick: bool) -> tuple[CaseResult, float]:
    """Return the result of a case and the time it took [s]; an exception in the case is reported as its failure."""
    begun = perf_counter()
    try:
        result = case(quick)
        result = replace(result, passed=bool(result.passed))  # a numpy truth is not JSON's
    except Exception as error:  # a case may break in any way; the report goes on and shows it
        result = CaseResult("a result", f"{type(error).__name__}: {error}", False, "none", "")
    return result, perf_counter() - begun


def stability_section(context: html.Context) -> html.Section:
    """Run the chosen cases and return their section."""
    chosen = {name: case for name, case in CASES.items() if context.is_chosen(name)}
    found = {}
    for name, case in context.with_progress(chosen.items(), lambda item: f"case {item[0]}"):
        found[name] = run_case(case, context.quick)
        context.add("stability_cases", {"name": name, **asdict(found[name][0])})
    results = {name: result for name, (result, _) in found.items()}
    document = drawing.svg(draw(CASES, results))
    return html.Section(
        "stability",
        "Stiff and extreme cases",
        html.paragraph(EXPLAINED) + _table(found),
        (_finding(results),),
        {"margins": document},
        card=html.Card("Is the loop stable in stiff and extreme cases?", html.picture("margins", document, TOLD)),
    )


def _finding(results: Mapping[str, CaseResult]) -> str:
    """Return a sentence: number of cases that agree with theory, failed cases, and cases with the smallest margin."""
    failed = [f"<code>{name}</code>" for name, result in results.items() if not result.passed]
    told = f"; failed: {', '.join(failed)}" if failed else ""
    close = [name for name in closest(results) if results[name].passed][:1]
    near = "".join(f"; the closest, <code>{name}</code>, uses {percent(results[name].used or 0.0)} of its tolerance"
                   for name in close)  # fmt: skip
    return f"{len(results) - len(failed)} of {len(results)} stiff and extreme cases agree with theory{told}{near}."


def _table(results: Mapping[str, tuple[CaseResult, float]]) -> str:
    rows: list[list[str | html.Cell]] = [
        [
            name,
            html.Cell("✓ passed", "good") if result.passed else html.Cell("✗ failed", "bad"),
            result.expected,
            result.measured,
            f"{result.oracle}; within: {result.tolerance}" if result.tolerance else result.oracle,
            "–" if result.used is None else percent(result.used),
            f"{seconds:.2f}",
        ]
        for name, (result, seconds) in results.items()
    ]
    headings = ("case", "verdict", "expected", "measured", "checked by", "share of tolerance", "time [s]")
    return html.table(headings, rows, text_columns=5)


# Section on the K–B region, measured and predicted.

# Part of the region section on friction and encoder: the endings of motions of one size.

STARTS = (5.0, 20.0, 100.0)
"""Distances from rest at which motions begin, one for each panel [encoder counts]."""
COLOURS = {
    Ending.RESTS: ("#d3ebe0", "comes to rest"),
    Ending.CYCLES: ("#e7e1ee", "limit cycle over one count"),
    Ending.GROWS: ("#f8dcc4", "grows"),
}
PLANE_EXPLAINED = """<b>Friction and encoder.</b> Over β = b/(K·T) and σ = fc/(K·D), with one encoder count D, the
regions of Diolaiti et al. are the quadrants at ½: passive, locally stable (small motions stick, large ones grow),
limit cycle and unstable. They hold for motions of any size. Here handles are pressed against a wall and released a
given number of counts away, with exact friction and rounding. A motion of size A grows only if sampling adds more
energy per swing than friction absorbs, K·T/2 − b &gt; 4·fc/(π·ω·A). For a larger motion the border is closer to β =
½."""


def part(planes: Sequence[Plane]) -> tuple[str, str]:
    """Return the part as HTML, and the SVG document of its figure."""
    document = drawing.svg(drawing.side_by_side(planes, _plane_panel, 4.2, ncols=5))
    share = min(plane.agreement for plane in planes)
    told = "all handles" if share == 1.0 else f"{percent(share, 3)} of the handles"
    caption = (
        f"{len(planes[0].axis)}² handles in each panel. Colours: measured. Dashed: the quadrants. Solid: prediction "
        f"by describing functions for motions of that size; {told} more than 5 % of the plane away from it agree."
    )
    return html.paragraph(PLANE_EXPLAINED) + html.picture("friction-plane", document, caption), document


def _plane_panel(panel: Axes, plane: Plane) -> None:
    """Draw the measured endings, the predicted border and the quadrants."""
    colours = ListedColormap([COLOURS[outcome][0] for outcome in Ending])
    panel.pcolormesh(plane.axis, plane.axis, plane.outcome, cmap=colours, vmin=-0.5, vmax=2.5, shading="nearest",
                     rasterized=True)  # fmt: skip
    for colour, label in COLOURS.values():  # empty areas, for the legend
        panel.fill_between([], [], color=colour, label=label)
    beta = np.linspace(0.0, 0.5, 50)
    panel.plot(beta, border(plane.start, beta), color="#0072B2", linewidth=2.0, label="predicted: grows below")
    panel.axvline(0.5, color=drawing.INK, linewidth=1.0, linestyle="--", label="quadrants")
    panel.axhline(0.5, color=drawing.INK, linewidth=1.0, linestyle="--")
    panel.set(xlim=(0.0, LARGEST), ylim=(0.0, LARGEST))
    labels = ("damping over K·T: β = b/(K·T) [1]", "friction over K·D: σ = fc/(K·D) [1]")
    drawing.dress(panel, f"released {exactly(plane.start)} counts away", *labels)
    panel.grid(visible=False)


QUICK, FULL = (32, 3000), (120, 20_000)
"""Points of each axis of a K–B region, and periods of each run."""
QUICK_PLANE, FULL_PLANE = (20, 2000), (60, 6000)
"""Points of each axis of a friction plane, and periods of each run."""

REGION_EXPLAINED = """A bilateral wall of stiffness K and damping B (velocity by backward difference) on the shipped
bench
without a hand. Each pixel is one loop after a flick, computed in the batch engine: blue where the motion decays,
orange where it grows. Lines are predictions: from the eigenvalues of one exact period (stable), and from the
condition of Colgate and Schenkel, extended to delay and torque loop (passive). With delay, damping raises the limit
up to a point and then lowers it. Passive is much stricter than stable, because it holds for every hand."""


def region_section(context: html.Context) -> html.Section:
    """Measure three regions and the friction planes, and return their section.

    The regions: the whole region of the bench, its part near the bench's own damping, and the region with one more
    period of delay.
    """
    points, periods = QUICK if context.quick else FULL
    bench = context.bench
    late = replace(bench, delay=bench.delay + bench.period)
    delays = f"{rounded(1e3 * bench.delay)} ms of delay", f"{rounded(1e3 * late.delay)} ms of delay"
    wanted = (
        (delays[0], bench, None),
        (f"closer: small damping, {delays[0]}", bench, 3.0 * bench.plant.damping),
        (f"one period more: {delays[1]}", late, None),
    )
    found = [region(title, of, points, periods, damping)
             for title, of, damping in context.with_progress(wanted, lambda item: f"region, {item[0]}")]  # fmt: skip
    context.progress("region, friction and encoder", 0.9)
    size = QUICK_PLANE if context.quick else FULL_PLANE
    sticking, plane_document = part([plane(start, *size) for start in STARTS])
    agreed = min(each.agreement for each in found)
    told = "every loop" if agreed == 1.0 else f"{percent(agreed, 4)} of the loops"
    document = drawing.svg(drawing.side_by_side(found, _panel, 4.4, ncols=4))
    caption = (
        f"{points}² loops of {periods} periods in each panel. Measured: blue decays, orange grows. Lines: predicted."
    )
    return html.Section(
        "region",
        "Stiffness and damping: the region that is stable",
        html.paragraph(REGION_EXPLAINED) + html.picture("region", document, caption) + _region_table(found) + sticking,
        (
            f"Measured and predicted K–B regions agree on {told}, without a strip of 1 % around the border. Without "
            f"damping the wall is stable up to {rounded(float(found[0].stable_limit[0]))} N/m and passive up to "
            f"{rounded(float(found[0].passive_limit[0]))} N/m.",
        ),
        {"region": document, "friction-plane": plane_document},
        [
            {"title": each.title, "damping": each.damping.tolist(), "stable_limit": each.stable_limit.tolist(),
             "passive_limit": each.passive_limit.tolist(), "agreement": each.agreement}
            for each in found
        ],
    )  # fmt: skip


def _panel(panel: Axes, region: Region) -> None:
    """Draw the measured grid and the predicted limits of a region."""
    scale = 1e-3  # N/m to N/mm
    colours = ListedColormap(["#cfe5f2", "#f8dcc4"])
    panel.pcolormesh(region.damping, scale * region.stiffness, region.grew.T, cmap=colours,
                     vmin=0, vmax=1, shading="nearest", rasterized=True)  # fmt: skip
    panel.plot(
        region.damping, scale * region.stable_limit, color="#0072B2", linewidth=2.0, label="predicted: stable below"
    )
    panel.plot(region.damping, scale * region.passive_limit, color=drawing.GREEN, linewidth=2.0, linestyle="--",
               label="predicted: passive below")  # fmt: skip
    # Empty areas, for the legend: a mesh has no entry of its own there.
    panel.fill_between([], [], color="#cfe5f2", label="measured: fades")
    panel.fill_between([], [], color="#f8dcc4", label="measured: grows", edgecolor=drawing.VERMILION)
    panel.set(xlim=(0.0, region.damping[-1]), ylim=(0.0, scale * region.stiffness[-1]))
    drawing.dress(panel, region.title, "virtual damping [N·s/m]", "virtual stiffness [N/mm]")
    panel.grid(visible=False)


def _region_table(regions: Sequence[Region]) -> str:
    rows: list[list[html.Entry]] = [
        [
            each.title,
            *map(float, (each.stable_limit[0], each.stable_limit.max(), each.damping[each.stable_limit.argmax()])),
            float(each.passive_limit.max()),
            percent(each.agreement, 4),
        ]
        for each in regions
    ]
    headings = ("bench", "stable without damping [N/m]", "stable at best [N/m]", "with damping [N·s/m]",
                "passive at best [N/m]", "measured as predicted")  # fmt: skip
    return html.table(headings, rows)


# Section on the passivity controller: stability, feel and cost of a wall with and without it.

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
            spent = () if cost is None else (cost.peak, cost.energy)
            yield Decay(share, scene.controlled, _growth(result, wall.position), *spent)


def felt(tools: Tools, duration: float) -> list[WallTap]:
    """Return a tap on the wall without and with the controller."""
    rig = _endless(tools)
    return [_felt(scene, tools.run(scene, rig, bus="sim", hand="tap", duration=duration)) for scene in _both(FELT)]


def limit_share(found: Iterable[Decay], *, controlled: bool) -> tuple[float, float] | None:
    """Return two neighbouring shares: oscillations decay at the first and grow at the second. None: no such pair."""
    pairs = pairwise(each for each in found if each.controlled == controlled)
    return next(((low.share, high.share) for low, high in pairs if low.growth <= 1.0 < high.growth), None)


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


PASSIVITY_QUICK, PASSIVITY_FULL = (0.5, 0.95, 1.05, 3.0), (0.25, 0.5, 0.75, 0.95, 1.05, 1.3, 1.6, 2.0, 2.5, 3.0)
"""Shares of the stability limit; both reports contain the shares around a finding, so both give the same finding."""
DURATION, TAPPED = 2.0, 4.0
"""Length of each run, and of the tap [s of virtual time]."""
NAMES = {False: "observer alone", True: "controller"}
PASSIVITY_COLOURS = {False: drawing.ORANGE, True: drawing.BLUE}

PASSIVITY_EXPLAINED = """With <code>passivity = "controller"</code> damping absorbs the energy that sampling and delay
add, as
far as the observer measures it: held torque times the displacement after it, compared with the energy stored in the
elements. The left figure and the first table: a handle is released beside a bilateral wall, on the shipped bench
without Coulomb friction; below 1 each swing is smaller than the one before. The second table: a tap on the wall of
the library, where the bench would absorb that energy anyway. There the controller only changes the feel."""


def passivity_section(context: html.Context) -> html.Section:
    """Measure decays and a tap, without and with the controller, and return their section."""
    shares = PASSIVITY_QUICK if context.quick else PASSIVITY_FULL
    found: list[Decay] = []
    for share in context.with_progress(shares, lambda share: f"passivity, {rounded(share)} of the limit"):
        found += decays(context.tools, (share,), DURATION)
    taps = felt(context.tools, TAPPED)
    document = drawing.svg(draw_passivity(found))
    caption = "Growth per swing over stiffness, as a share of the limit. Above the line the motion grows."
    tables = _decay_table(found) + _felt_table(taps)
    return html.Section(
        "passivity",
        "Passivity controller",
        html.paragraph(PASSIVITY_EXPLAINED) + html.picture("passivity", document, caption) + tables,
        (_passivity_finding(found, taps),),
        {"passivity": document},
        {"decay": [asdict(each) for each in found], "tap": [asdict(each) for each in taps]},
    )


def draw_passivity(found: Sequence[Decay]) -> Figure:
    """Return a figure of the growth with and without the controller."""
    drawn = drawing.figure(3.4)
    panel = drawn.subplots()
    for controlled, name in NAMES.items():
        rows = [each for each in found if each.controlled == controlled]
        shares, growths = [each.share for each in rows], [each.growth for each in rows]
        panel.plot(shares, growths, "o-", color=PASSIVITY_COLOURS[controlled], label=name)
    panel.axhline(1.0, color=drawing.INK, linewidth=0.8, linestyle="--")
    labels = ("stiffness over the stability limit [1]", "growth per swing [1]")
    drawing.dress(panel, "a handle released beside a wall", *labels)
    drawing.name_lines(drawn)
    return drawn


def _decay_table(found: Sequence[Decay]) -> str:
    headings = ("stiffness over its limit", "growth per swing", "with the controller", "its largest force [N]",
                "energy it took [mJ]")  # fmt: skip
    rows = [
        [plain.share, plain.growth, damped.growth, damped.peak, html.multiple(1e3, damped.energy)]
        for plain, damped in zip(found[::2], found[1::2], strict=True)
    ]
    return html.table(headings, rows, text_columns=0)


def _felt_table(taps: Sequence[WallTap]) -> str:
    headings = ("a tap with", "error in contact, % of force", "energy put in [mJ]", "its largest force [N]",
                "periods in which it damps [%]")  # fmt: skip
    return html.table(headings, (
        [NAMES[tap.controlled], html.multiple(100.0, tap.error), html.multiple(1e3, tap.energy), tap.peak,
         html.multiple(100.0, tap.periods)]
        for tap in taps
    ))  # fmt: skip


def _passivity_finding(found: Sequence[Decay], taps: Sequence[WallTap]) -> str:
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
