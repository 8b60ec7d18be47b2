"""Sections on stiff and extreme cases: their results, and how much of each tolerance they use."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from time import perf_counter

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, VERMILION, card_panel, figure, svg
from haptic_fieldbus.study.case import Case, CaseResult
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.page.html import WIDE_CARD, Card, Cell, Context, Section, paragraph, picture, table

# All stiff and extreme cases by margin, in one figure: how much of what is permitted each of them needs.

FAMILIES = {
    "integrators": "integrators, extreme masses",
    "closed_loop": "walls and bodies in the loop",
    "lags": "torque lag",
    "sharing": "Z-width, energy, contact",
    "ledger": "energy, passivity",
    "friction": "friction, encoder counts",
    "sensing": "sensing",
    "timing": "lost samples, ticks, Modbus",
    "elements": "stiff elements",
    "slopes": "stiff elements",
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
    function = case.func if isinstance(case, partial) else case
    module = function.__module__.rpartition(".")[2]
    return FAMILIES.get(module, module.replace("_", " "))


def margin_of(result: CaseResult) -> float:
    """Return the permitted over the found deviation; ∞ for an exact case, 0 for a case that fails otherwise."""
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
        margin = margin_of(result)
        place = EXACT if math.isinf(margin) else min(max(margin, 2.0 * WORST), FURTHEST)
        panel.plot(place, rows.index(family_of(cases[name])), marker, color=colour, markersize=5, alpha=0.75,
                   markeredgewidth=0)  # fmt: skip
    for place, row in enumerate(rows):
        exact = sum(family_of(cases[name]) == row and math.isinf(margin_of(found[name])) for name in found)
        panel.text(2.0 * EXACT, place, f"{exact}" if exact > 1 else "", va="center", size=6.5, color=GREEN)
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
                       color=VERMILION if failed else "#444444")  # fmt: skip


def closest(found: Mapping[str, CaseResult]) -> list[str]:
    """Return the cases with a margin, the smallest margin first."""
    known = [name for name, result in found.items() if not math.isinf(margin_of(result))]
    return sorted(known, key=lambda name: margin_of(found[name]))


def _frame(panel: Axes, rows: Sequence[str]) -> None:
    """Scale the axes, shade the range of failures, and separate the exact cases."""
    panel.set_xscale("log")
    panel.set_xlim(WORST, 10.0 * EXACT)
    panel.axvspan(WORST, 1.0, color="#fbeee6", linewidth=0, zorder=0)
    panel.axvline(1.0, color=VERMILION, linewidth=1.0, zorder=1)
    panel.axvspan(3.0 * FURTHEST, 10.0 * EXACT, color="#eef6f2", linewidth=0, zorder=0)
    panel.set_yticks(range(len(rows)), rows)
    panel.set_ylim(len(rows) - 0.4, -0.6)
    card_panel(panel, "", "margin: deviation permitted over deviation found [1]", "")
    ticks = [10.0**power for power in range(0, 11, 2)]
    panel.set_xticks([*ticks, EXACT], [*(rounded(tick) for tick in ticks), "exact"])
    panel.minorticks_off()
    panel.text(0.32, -0.35, "fails", ha="center", va="center", size=7, color=GREY)


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


def stability_section(context: Context) -> Section:
    """Run the chosen cases and return their section."""
    chosen = {name: case for name, case in CASES.items() if context.is_chosen(name)}
    found = {}
    for name, case in context.with_progress(chosen.items(), lambda item: f"case {item[0]}"):
        found[name] = run_case(case, context.quick)
        context.add("stability_cases", {"name": name, **asdict(found[name][0])})
    results = {name: result for name, (result, _) in found.items()}
    document = svg(draw(CASES, results))
    return Section(
        "stability",
        "Stiff and extreme cases",
        paragraph(EXPLAINED) + _table(found),
        (_finding(results),),
        {"margins": document},
        card=Card("Is the loop stable in stiff and extreme cases?", picture("margins", document, TOLD)),
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
    rows: list[list[str | Cell]] = [
        [
            name,
            Cell("✓ passed", "good") if result.passed else Cell("✗ failed", "bad"),
            result.expected,
            result.measured,
            f"{result.oracle}; within: {result.tolerance}" if result.tolerance else result.oracle,
            "–" if result.used is None else percent(result.used),
            f"{seconds:.2f}",
        ]
        for name, (result, seconds) in results.items()
    ]
    return table(
        ("case", "verdict", "expected", "measured", "checked by", "share of tolerance", "time [s]"),
        rows,
        text_columns=5,
    )
