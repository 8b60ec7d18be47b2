"""Style of all pictures: colours, names at lines, and titles."""

from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from matplotlib import colors

from haptic_fieldbus.assessing.result import Array
from haptic_fieldbus.report.analysis_plots import span_frequencies
from haptic_fieldbus.report.drawing import (
    BLUE,
    GREEN,
    NAMED,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    dress,
    envelope,
    figure,
    is_smear,
    name_lines,
    save,
    svg,
    with_description,
)
from tests.pictures import misplaced

PALETTE = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY)
DIFFERENT = 10.0
"""Distance in CIE L*a*b* that is seen at a glance."""
VISIONS = {
    "all cones": np.eye(3),
    "no long": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "no middle": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "no short": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
"""Linear sRGB as eyes without one kind of cones see it (Machado, Oliveira, Fernandes, TVCG 2009)."""
TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def seen(colour: str, vision: object) -> Array:
    """Return a colour in CIE L*a*b* (D65), as seen with a kind of vision."""
    share = np.array(colors.to_rgb(colour))
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(np.array(vision) @ linear, 0.0, 1.0) / (0.9505, 1.0, 1.089)
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16.0 / 116.0)
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("vision", VISIONS)
def test_colours_can_be_told_apart_with_any_colour_vision(vision: str) -> None:
    for one, other in combinations(PALETTE, 2):
        distance = float(np.linalg.norm(seen(one, VISIONS[vision]) - seen(other, VISIONS[vision])))
        assert distance > DIFFERENT, (one, other)


def test_names_have_contrast_on_white_and_stand_inside_their_panel() -> None:
    drawn = figure(4.0, 8.0, "Six waves 1")
    panel = drawn.subplots()
    x: Array = np.linspace(0.0, 6.0, 200)
    for number, colour in enumerate(PALETTE):
        panel.plot(x, np.sin(x) + 2.0 * number, color=colour, label=f"wave {number}")
    dress(panel, "waves", "time [s]", "height [m]")
    name_lines(drawn)
    assert panel.get_legend() is None
    assert misplaced(drawn) == []
    assert [text.get_text() for text in panel.texts] == [f"wave {number}" for number in range(6)]
    for text in panel.texts:
        luminance = float((TO_XYZ @ np.array(linear(text.get_color())))[1])
        assert 1.05 / (luminance + 0.05) >= 4.5


def linear(colour: object) -> Array:
    share: Array = np.array(colors.to_rgb(colour))  # type: ignore[arg-type]
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def test_each_name_is_nearest_to_its_own_line() -> None:
    drawn = figure(4.0, 8.0)
    panel = drawn.subplots()
    x: Array = np.linspace(0.0, 1.0, 50)
    for level in (0.0, 1.0, 2.0):
        panel.plot(x, 0.0 * x + level, label=f"level {level:g}")
    name_lines(drawn)
    for text, level in zip(panel.texts, (0.0, 1.0, 2.0), strict=True):
        height = panel.transData.inverted().transform(panel.transAxes.transform(text.get_position()))[1]
        assert abs(height - level) < 0.4


def test_more_lines_than_can_be_named_have_no_names_beside_them() -> None:
    drawn = figure(3.0, 5.0)
    panel = drawn.subplots()
    for number in range(NAMED + 1):
        panel.plot([0.0, 1.0], [0.0, number], label=str(number))
    name_lines(drawn)
    assert len(panel.texts) == 0


def test_a_name_without_a_place_goes_to_a_legend() -> None:
    drawn = figure(1.0, 1.2)
    panel = drawn.subplots()
    panel.plot([0.0, 1.0], [0.0, 1.0], label="a name that is wider than its panel")
    name_lines(drawn)
    assert len(panel.texts) == 0
    assert panel.get_legend() is not None


def test_a_long_title_and_its_notes_stay_on_the_canvas() -> None:
    drawn = figure(4.0, 6.0, "Words " * 20, ["notes " * 40, "more"])
    drawn.subplots().set_title("a panel", loc="left")
    assert misplaced(drawn) == []


def test_an_envelope_holds_every_value() -> None:
    values: Array = np.random.default_rng(7).normal(size=5000)
    times: Array = np.arange(5000.0)
    assert is_smear(values)
    assert not is_smear(np.sin(times / 500.0))
    at, low, high = envelope(times, values)
    nearest = np.abs(at[:, None] - times).argmin(axis=0)
    assert (low[nearest] <= values).all()
    assert (values <= high[nearest]).all()
    assert (low.min(), high.max()) == (values.min(), values.max())


def test_a_description_stands_where_matplotlib_writes_it(tmp_path: Path) -> None:
    drawn = figure(1.0, 1.0, "", [])
    document = svg(drawn)
    told = with_description(document, "of a test")
    assert told.replace("<dc:description>of a test</dc:description>", "") == document
    save(drawn, tmp_path / "a.svg", "of a test")
    kind = "{http://creativecommons.org/ns#}Work/{http://purl.org/dc/elements/1.1/}description"
    texts = [ElementTree.fromstring(each).findtext(f".//{kind}") for each in (told, (tmp_path / "a.svg").read_text())]
    assert texts == ["of a test", "of a test"]


def test_an_axis_of_frequencies_has_several_numbers() -> None:
    drawn = figure(4.0, 6.0, "a")
    panel = drawn.subplots()
    span_frequencies(panel, np.array([3.4, 81.0]))
    dress(panel, "", "frequency [Hz]")
    drawn.draw_without_rendering()
    low, high = panel.get_xlim()
    shown = [label.get_text() for label in panel.get_xticklabels() if low <= label.get_position()[0] <= high]
    assert shown == ["3", "10", "30", "100"]
