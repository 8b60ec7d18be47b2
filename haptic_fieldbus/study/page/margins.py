"""All stiff and extreme cases by margin, in one figure: how much of what is permitted each of them needs."""

import math
from collections.abc import Mapping, Sequence
from functools import partial

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, VERMILION
from haptic_fieldbus.study.case import Case, CaseResult
from haptic_fieldbus.study.page.style import WIDE_CARD, card_panel, figure

FAMILIES = {
    "integrators": "integrators",
    "extremes": "extreme masses, overflow",
    "closed_loop": "mass in the loop",
    "several_bodies": "several bodies",
    "closed_loop_walls": "walls at the limit, delay",
    "lags": "torque lag",
    "sharing_width": "Z-width, filters",
    "sharing": "energy, passivity",
    "ledger": "energy, passivity",
    "sharing_contact": "contact, letting go",
    "friction": "friction, encoder counts",
    "sensing": "sensing",
    "instants": "lost samples, ticks",
    "elements": "stiff elements",
    "slopes": "stiff elements",
    "stated": "stated limits, score",
    "drive": "faults, gaps, clock",
    "gap": "faults, gaps, clock",
    "modbus": "Modbus, a period late",
}
"""Rows of the figure by the module of a case; a module that is not here has a row by its own name."""
WORST, FURTHEST, EXACT = 0.1, 1e10, 1e12
"""Margins at both ends of the frame, and the place of what is exact, or judged by yes or no."""
TOLD = """Each mark is a case; its margin is the deviation that is permitted over the one that was found. Left of 1 a
case fails. Cases without a number, such as a refusal in exact words, and those without any deviation stand at the
right. Beside each row stands its closest case."""


def family_of(case: Case) -> str:
    """Return the row of a case."""
    function = case.func if isinstance(case, partial) else case
    module = function.__module__.rpartition(".")[2]
    return FAMILIES.get(module, module.replace("_", " "))


def margin_of(result: CaseResult) -> float:
    """Return what is permitted over what was found; ∞ for what is exact, 0 for a case that fails otherwise."""
    if not result.passed and (result.used is None or result.used <= 1.0):
        return 0.0
    return 1.0 / result.used if result.used else math.inf


def draw(cases: Mapping[str, Case], found: Mapping[str, CaseResult]) -> Figure:
    """Return a figure with a row for each family and a mark for each case."""
    drawn = figure(*WIDE_CARD)
    panel = drawn.subplots()
    seen = {family_of(cases[name]) for name in found}
    rows = [*(row for row in dict.fromkeys(FAMILIES.values()) if row in seen), *sorted(seen - set(FAMILIES.values()))]
    for name, result in found.items():
        colour, marker = (BLUE, "o") if result.passed else (VERMILION, "X")
        colour = GREEN if result.passed and math.isinf(margin_of(result)) else colour
        panel.plot(_place(result), rows.index(family_of(cases[name])), marker, color=colour, markersize=5, alpha=0.75,
                   markeredgewidth=0)  # fmt: skip
    for place, row in enumerate(rows):
        exact = sum(family_of(cases[name]) == row and math.isinf(margin_of(found[name])) for name in found)
        panel.text(2.0 * EXACT, place, f"{exact}" if exact > 1 else "", va="center", size=6.5, color=GREEN)
    _frame(panel, rows)
    _name_closest(panel, rows, cases, found)
    return drawn


def _place(result: CaseResult) -> float:
    margin = margin_of(result)
    return EXACT if math.isinf(margin) else min(max(margin, 2.0 * WORST), FURTHEST)


def _name_closest(panel: Axes, rows: Sequence[str], cases: Mapping[str, Case], found: Mapping[str, CaseResult]) -> None:
    """Name the closest case of each row beside it, with its margin; or all that failed in it."""
    ordered = closest(found)
    for place, row in enumerate(rows):
        names = [name for name in ordered if family_of(cases[name]) == row]
        failed = [name for name in names if not found[name].passed]
        margin = f" {rounded(margin_of(found[names[0]]))}" if names and not failed else ""
        panel.annotate(", ".join(failed or names[:1]) + margin, (1.0, place), xycoords=panel.get_yaxis_transform(),
                       xytext=(5, 0), textcoords="offset points", va="center", size=7.2,
                       color=VERMILION if failed else "#444444")  # fmt: skip


def closest(found: Mapping[str, CaseResult]) -> list[str]:
    """Return the cases that have a margin, the closest first."""
    known = [name for name, result in found.items() if not math.isinf(margin_of(result))]
    return sorted(known, key=lambda name: margin_of(found[name]))


def _frame(panel: Axes, rows: Sequence[str]) -> None:
    """Scale the axes, shade where cases fail, and set what is exact apart."""
    panel.set_xscale("log")
    panel.set_xlim(WORST, 10.0 * EXACT)
    panel.axvspan(WORST, 1.0, color="#fbeee6", linewidth=0, zorder=0)
    panel.axvline(1.0, color=VERMILION, linewidth=1.0, zorder=1)
    panel.axvspan(3.0 * FURTHEST, 10.0 * EXACT, color="#eef6f2", linewidth=0, zorder=0)
    panel.set_yticks(range(len(rows)), rows)
    panel.set_ylim(len(rows) - 0.4, -0.6)
    card_panel(panel, "", "margin: deviation permitted over deviation found", "")
    ticks = [10.0**power for power in range(0, 11, 2)]
    panel.set_xticks([*ticks, EXACT], [*(rounded(tick) for tick in ticks), "exact"])
    panel.minorticks_off()
    panel.text(0.32, len(rows) - 0.75, "fails", ha="center", size=7, color=GREY)
