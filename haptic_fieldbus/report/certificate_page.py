"""One page of a certificate: what was seen on which bench, and the growth of the contact over its stiffness."""

from math import isfinite
from textwrap import wrap

from matplotlib.figure import Figure

from haptic_fieldbus.identification.certificate import WELL_DAMPED, Certificate
from haptic_fieldbus.numerals import in_unit, lines_of
from haptic_fieldbus.report.drawing import (
    BLUE,
    GREEN,
    GREY,
    INK,
    NAME_SIZE,
    NOTE,
    ORANGE,
    SUBTITLE_SIZE,
    VERMILION,
    dress,
    figure,
)

HEIGHT, PAGE = 11.0, 8.3
"""Size of a page [inches]."""
WIDTH = 88
"""Longest line of its text."""


def draw_certificate(found: Certificate) -> Figure:
    """Return the page of a certificate."""
    seen = "No stiffness was" if found.seen is None else f"{in_unit(found.seen, found.unit)} was"
    drawn = figure(HEIGHT, PAGE, f"Certificate: {seen} seen well damped")
    page, panel = drawn.subplots(2, 1, height_ratios=(0.36, 1.0))
    page.axis("off")
    page.set(xticks=[], yticks=[])
    lines = [
        ("" if number else label, part)
        for label, text in lines_of(each for each in found.rows() if not each.detail)
        for number, part in enumerate(wrap(text, WIDTH))
    ]
    for place, (column, colour) in enumerate(((0.0, INK), (0.14, NOTE))):
        words = "\n".join(line[place] for line in lines)
        page.text(column, 1.0, words, size=SUBTITLE_SIZE - 1.5, va="top", linespacing=1.6, color=colour)
    swung = [each for each in found.contacts if each.growth is not None]
    panel.plot([each.stiffness for each in swung], [each.growth or 0.0 for each in swung], "o-", color=BLUE)
    for growth, words, colour in ((1.0, "does not decay", VERMILION), (WELL_DAMPED, "well damped below", GREEN)):
        panel.axhline(growth, color=colour, linewidth=1.0)
        panel.annotate(
            words, (0.01, growth), xycoords=panel.get_yaxis_transform(), va="bottom", size=NAME_SIZE, color=NOTE
        )
    if found.onset is not None:
        panel.axvspan(found.onset.low, min(found.onset.high, 3.0 * found.predicted), color=ORANGE, alpha=0.3)
    marks = [("limit", found.limit, GREY, "-"), ("predicted onset", found.predicted, VERMILION, "--")]
    marks += [] if found.onset is None else [("extrapolated onset", found.onset.value, ORANGE, "-")]
    for label, at, colour, style in reversed([each for each in marks if isfinite(each[1])]):
        panel.axvline(at, color=colour, linewidth=1.4, linestyle=style, label=f"{label} {in_unit(at, found.unit)}")
    panel.set_ylim(0.0, 1.1)
    panel.set_xlim(0.0, 1.05 * max(panel.get_xlim()[1], found.predicted if isfinite(found.predicted) else 0.0))
    panel.legend(loc="lower center", edgecolor="none", framealpha=1.0)
    dress(panel, "each swing of the contact beside the one before", f"stiffness [{found.unit}]", "growth per period")
    return drawn
