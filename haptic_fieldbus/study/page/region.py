"""Section on the K–B region, measured and predicted."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap

from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report.drawing import GREEN, INK, VERMILION, dress, side_by_side, svg
from haptic_fieldbus.study.measure.region import LARGEST, Ending, Plane, Region, border, plane, region
from haptic_fieldbus.study.page.html import Context, Entry, Section, paragraph, picture, table

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
    document = svg(side_by_side(planes, _plane_panel, 4.2, ncols=5))
    share = min(plane.agreement for plane in planes)
    told = "all handles" if share == 1.0 else f"{percent(share, 3)} of the handles"
    caption = (
        f"{len(planes[0].axis)}² handles in each panel. Colours: measured. Dashed: the quadrants. Solid: prediction "
        f"by describing functions for motions of that size; {told} more than 5 % of the plane away from it agree."
    )
    return paragraph(PLANE_EXPLAINED) + picture("friction-plane", document, caption), document


def _plane_panel(panel: Axes, plane: Plane) -> None:
    """Draw the measured endings, the predicted border and the quadrants."""
    colours = ListedColormap([COLOURS[outcome][0] for outcome in Ending])
    panel.pcolormesh(plane.axis, plane.axis, plane.outcome, cmap=colours, vmin=-0.5, vmax=2.5, shading="nearest",
                     rasterized=True)  # fmt: skip
    for colour, label in COLOURS.values():  # empty areas, for the legend
        panel.fill_between([], [], color=colour, label=label)
    beta = np.linspace(0.0, 0.5, 50)
    panel.plot(beta, border(plane.start, beta), color="#0072B2", linewidth=2.0, label="predicted: grows below")
    panel.axvline(0.5, color=INK, linewidth=1.0, linestyle="--", label="quadrants")
    panel.axhline(0.5, color=INK, linewidth=1.0, linestyle="--")
    panel.set_xlim(0.0, LARGEST)
    panel.set_ylim(0.0, LARGEST)
    dress(
        panel,
        f"released {exactly(plane.start)} counts away",
        "damping over K·T: β = b/(K·T) [1]",
        "friction over K·D: σ = fc/(K·D) [1]",
    )
    panel.grid(visible=False)


QUICK, FULL = (32, 3000), (120, 20_000)
"""Points of each axis of a K–B region, and periods of each run."""
QUICK_PLANE, FULL_PLANE = (20, 2000), (60, 6000)
"""Points of each axis of a friction plane, and periods of each run."""

EXPLAINED = """A bilateral wall of stiffness K and damping B (velocity by backward difference) on the shipped bench
without a hand. Each pixel is one loop after a flick, computed in the batch engine: blue where the motion decays,
orange where it grows. Lines are predictions: from the eigenvalues of one exact period (stable), and from the
condition of Colgate and Schenkel, extended to delay and torque loop (passive). With delay, damping raises the limit
up to a point and then lowers it. Passive is much stricter than stable, because it holds for every hand."""


def region_section(context: Context) -> Section:
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
    document = svg(side_by_side(found, _panel, 4.4, ncols=4))
    caption = (
        f"{points}² loops of {periods} periods in each panel. Measured: blue decays, orange grows. Lines: predicted."
    )
    return Section(
        "region",
        "Stiffness and damping: the region that is stable",
        paragraph(EXPLAINED) + picture("region", document, caption) + _table(found) + sticking,
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
    panel.plot(region.damping, scale * region.passive_limit, color=GREEN, linewidth=2.0, linestyle="--",
               label="predicted: passive below")  # fmt: skip
    # Empty areas, for the legend: a mesh has no entry of its own there.
    panel.fill_between([], [], color="#cfe5f2", label="measured: fades")
    panel.fill_between([], [], color="#f8dcc4", label="measured: grows", edgecolor=VERMILION)
    panel.set_xlim(0.0, region.damping[-1])
    panel.set_ylim(0.0, scale * region.stiffness[-1])
    dress(panel, region.title, "virtual damping [N·s/m]", "virtual stiffness [N/mm]")
    panel.grid(visible=False)


def _table(regions: Sequence[Region]) -> str:
    rows: list[list[Entry]] = [
        [
            region.title,
            *map(
                float, (region.stable_limit[0], region.stable_limit.max(), region.damping[region.stable_limit.argmax()])
            ),
            float(region.passive_limit.max()),
            percent(region.agreement, 4),
        ]
        for region in regions
    ]
    headings = ("bench", "stable without damping [N/m]", "stable at best [N/m]", "with damping [N·s/m]",
                "passive at best [N/m]", "measured as predicted")  # fmt: skip
    return table(headings, rows)
