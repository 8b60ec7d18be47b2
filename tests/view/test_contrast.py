"""Colours of the page: text and lines can be told from what is behind them, by the formula of WCAG 2.1."""

import re
from pathlib import Path

import pytest

import haptic_fieldbus

STYLE = (Path(haptic_fieldbus.__file__).parent / "view" / "assets" / "page.css").read_text(encoding="utf-8")
TEXT, LINE = 4.5, 3.0
"""Least ratios of level AA: of text, and of graphics."""
PAIRS = [
    *((name, "card", TEXT) for name in ("ink", "faint", "red", "green", "blue", "orange")),
    *((name, "ground", TEXT) for name in ("ink", "faint", "red", "green", "blue", "orange")),
    *((name, "card", LINE) for name in ("purple", "grey")),
    ("on-stop", "stop", TEXT),
    ("on-warn", "warn", TEXT),
    ("stop", "ground", LINE),
]


def palette(selector: str) -> dict[str, str]:
    """Return the colours of a rule by their names."""
    rule = STYLE.partition(selector + " {")[2].partition("}")[0]
    return dict(re.findall(r"--([\w-]+): (#\w{6});", rule))


def luminance(colour: str) -> float:
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("selector", [":root", "body.body--dark"])
def test_every_colour_reaches_level_aa(selector: str) -> None:
    colours = palette(selector)
    low = {}
    for name, ground, least in PAIRS:
        brighter, darker = sorted((luminance(colours[name]), luminance(colours[ground])), reverse=True)
        if (ratio := (brighter + 0.05) / (darker + 0.05)) < least:
            low[name, ground] = round(ratio, 2)
    assert low == {}
