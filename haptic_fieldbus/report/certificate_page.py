"""One page of a certificate: what was seen on which bench, and the growth of the contact over its stiffness."""

from matplotlib.figure import Figure

from haptic_fieldbus.identification.certificate import WELL_DAMPED, Certificate
from haptic_fieldbus.numerals import in_unit, lines_of
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, INK, NOTE, ORANGE, SUBTITLE_SIZE, VERMILION, dress, figure

HEIGHT, PAGE = 11.0, 8.3
"""Size of a page [inches]."""


def draw_certificate(found: Certificate) -> Figure:
    """Return the page of a certificate."""
    seen = "No stiffness was" if found.seen is None else f"{in_unit(found.seen, found.unit)} was"
    drawn = figure(HEIGHT, PAGE, f"Certificate: {seen} seen well damped")
    page, panel = drawn.subplots(2, 1, height_ratios=(0.6, 1.0))
    page.axis("off")
    lines = lines_of(each for each in found.rows() if not each.detail)
    for place, (column, colour) in enumerate(((0.0, INK), (0.14, NOTE))):
        words = "\n".join(line[place] for line in lines)
        page.text(column, 1.0, words, size=SUBTITLE_SIZE - 1.5, va="top", linespacing=1.6, color=colour)
    swung = [each for each in found.contacts if each.growth is not None]
    panel.plot([each.stiffness for each in swung], [each.growth or 0.0 for each in swung], "o-", color=BLUE)
    panel.axhline(1.0, color=VERMILION, linewidth=1.0)
    panel.axhline(WELL_DAMPED, color=GREEN, linewidth=1.0)
    if found.onset is not None:
        panel.axvspan(found.onset.low, min(found.onset.high, 3.0 * found.predicted), color=ORANGE, alpha=0.3)
    marks = {"limit": (found.limit, GREY), "predicted onset": (found.predicted, VERMILION)}
    marks |= {} if found.onset is None else {"extrapolated onset": (found.onset.value, ORANGE)}
    for label, (at, colour) in marks.items():
        panel.axvline(at, color=colour, linewidth=1.4, label=label)
    panel.set_ylim(0.0, 1.1)
    panel.set_xlim(0.0, None)
    panel.legend(loc="lower right", frameon=False)
    dress(panel, "largest swing beside that of a period before", f"stiffness [{found.unit}]", "growth per period")
    return drawn
