"""Faults of a picture: texts that overlap or leave the canvas, and files that today's code would not draw."""

import math
import re
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")
CLOSE = 0.03
"""Permitted difference of numbers in a picture, of the range of its axis: last digits depend on the machine."""
ROUNDING = 1e-12
"""Values below it on a logarithmic scale are rounding, which differs between processors."""
TOUCH = 1.0
"""Overlap of two texts that nobody sees [pixels]."""


def misplaced(drawn: Figure) -> list[str]:
    """Return the texts of a figure that leave its canvas, and the pairs that overlap."""
    drawn.draw_without_rendering()
    # The box of an annotation would contain its line.
    boxes = {text: Text.get_window_extent(text) for text in _texts(drawn)}
    canvas = drawn.bbox
    outside = [
        f"outside: {text.get_text()!r}"
        for text, box in boxes.items()
        if min(box.x0, box.y0) < -TOUCH or box.x1 > canvas.width + TOUCH or box.y1 > canvas.height + TOUCH
    ]
    pairs = combinations(boxes.items(), 2)
    return outside + [
        f"overlap: {one.get_text()!r} and {other.get_text()!r}"
        for (one, first), (other, second) in pairs
        if _overlap(first, second)
    ]


def _overlap(first: Bbox, second: Bbox) -> bool:
    wide = min(first.x1, second.x1) - max(first.x0, second.x0)
    high = min(first.y1, second.y1) - max(first.y0, second.y0)
    return bool(wide > TOUCH and high > TOUCH)


def _texts(drawn: Figure) -> Iterator[Text]:
    """All texts that are seen; numbers at ticks beyond the ends of an axis are not."""
    axes: list[Axis] = [axis for panel in drawn.axes for axis in (panel.xaxis, panel.yaxis)]
    of_ticks = {label for axis in axes for label in axis.get_ticklabels(which="both")}
    for axis in axes:
        low, high = sorted(axis.get_view_interval())
        # A tick at the very end of an axis is drawn in spite of rounding.
        room = 1e-9 * (high - low)
        yield from (
            tick.label1
            for tick in axis.get_major_ticks()
            if tick.label1.get_visible() and tick.label1.get_text() and low - room <= tick.get_loc() <= high + room
        )
    for text in drawn.findobj(Text):
        if isinstance(text, Text) and text not in of_ticks and text.get_visible() and text.get_text().strip():
            yield text


def differences(then: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """Return what differs between what two pictures show (`report.drawing.content`)."""
    if not then:
        return ["the file does not tell what it shows"]
    found = [
        f"text: {a!r} was drawn, {b!r} would be"
        for a, b in zip(_padded(then, now), _padded(now, then), strict=True)
        if not _same_text(a, b)
    ]
    if len(then["panels"]) != len(now["panels"]):
        return [*found, f"{len(then['panels'])} panels were drawn, {len(now['panels'])} would be"]
    for number, (a, b) in enumerate(zip(then["panels"], now["panels"], strict=True)):
        found += [f"panel {number}: {each}" for each in _panel_differences(a, b)]
    return found


def _padded(one: dict[str, Any], other: dict[str, Any]) -> list[str]:
    texts: list[str] = one["texts"]
    return texts + [""] * (len(other["texts"]) - len(texts))


def _same_text(a: str, b: str) -> bool:
    """Whether two texts are equal but for last digits of their numbers."""
    one, other = ([float(each) for each in NUMBER.findall(text)] for text in (a, b))
    words = NUMBER.sub("#", a) == NUMBER.sub("#", b)
    return words and all(math.isclose(x, y, rel_tol=CLOSE) for x, y in zip(one, other, strict=True))


def _panel_differences(then: dict[str, Any], now: dict[str, Any]) -> Iterator[str]:
    if then["scales"] != now["scales"]:
        yield f"scales {then['scales']}, and now {now['scales']}"
        return
    if not _is_close(then["range"], now["range"], now, (0, 0, 1, 1)):
        yield f"range {then['range']}, and now {now['range']}"
    if [line[:4] for line in then["lines"]] != [line[:4] for line in now["lines"]]:
        yield "lines of other looks"
        return
    for number, (a, b) in enumerate(zip(then["lines"], now["lines"], strict=True)):
        if not _same_blocks(a[4], b[4], now):
            yield f"line {number} runs elsewhere"
    if len(then["areas"]) != len(now["areas"]):
        yield "other areas"
        return
    for number, (a, b) in enumerate(zip(then["areas"], now["areas"], strict=True)):
        if not _same_blocks(a, b, now):
            yield f"area {number} has another outline"


def _same_blocks(a: Sequence[Sequence[float]], b: Sequence[Sequence[float]], panel: dict[str, Any]) -> bool:
    return len(a) == len(b) and all(_is_close(x, y, panel, (0, 1, 0, 1)) for x, y in zip(a, b, strict=True))


def _is_close(a: Sequence[float], b: Sequence[float], panel: dict[str, Any], axes: Sequence[int]) -> bool:
    """Whether numbers are the same, but for a share of the range of their axes (0: x, 1: y)."""
    ends = panel["range"]
    if not ends:  # measured
        return True
    for one, other, axis in zip(a, b, axes, strict=True):
        x, y, low, high = (
            _scaled(value, panel["scales"][axis]) for value in (one, other, *ends[2 * axis : 2 * axis + 2])
        )
        if abs(x - y) > CLOSE * abs(high - low):
            return False
    return True


def _scaled(value: float, scale: str) -> float:
    if scale == "log":
        return math.log10(max(value, ROUNDING))
    return math.copysign(math.log10(1.0 + 10.0 * abs(value)), value) if scale == "symlog" else value
