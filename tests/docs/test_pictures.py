"""Pictures of the pages: drawn by one command, as today's code draws them, small, and with texts that can be read."""

import importlib.util
import json
import re
import shutil
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from haptic_fieldbus import api
from haptic_fieldbus.report.drawing import content, dress, figure, name_lines
from haptic_fieldbus.study.make_report import make_report
from haptic_fieldbus.study.measure.bench import Tools
from tests.pictures import differences, misplaced

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "docs" / "images"
LARGEST = 150_000
"""Size of a file [bytes]."""
LARGEST_FILM = 2_000_000
LINK = re.compile(r"!\[[^\]]+\]\(([^)\s]+\.png)\)")


def load(name: str) -> ModuleType:
    """A script that draws pictures."""
    spec = importlib.util.spec_from_file_location(name, PROJECT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


FIGURES = load("make_figures")


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """All figures that are written into files."""
    found: list[Figure] = []
    write = Figure.savefig

    def savefig(self: Figure, *args: Any, **words: Any) -> None:
        found.append(self)
        write(self, *args, **words)

    monkeypatch.setattr(Figure, "savefig", savefig)
    return found


def test_every_picture_of_the_pages_is_drawn_by_make_docs_and_every_drawn_one_is_shown() -> None:
    pages = [PROJECT / "README.md", *(PROJECT / "docs").rglob("*.md")]
    shown = {(page.parent / link).resolve() for page in pages for link in LINK.findall(page.read_text("utf-8"))}
    assert shown == {FOLDER / name for name in FIGURES.PICTURES}
    assert shown == {*FOLDER.rglob("*.png")}
    assert "docs/make_figures.py" in (PROJECT / "Makefile").read_text("utf-8")


def test_files_are_small_and_tell_what_they_show() -> None:
    for name in FIGURES.PICTURES:
        assert (FOLDER / name).stat().st_size < LARGEST, name
        assert FIGURES.shown(FOLDER / name)["panels"], name


@pytest.mark.thorough("draws every picture", quick=("lecture/step.png", "lecture/tachometer.png"))
@pytest.mark.parametrize("name", FIGURES.PICTURES)
def test_a_picture_is_as_today_s_code_draws_it(name: str, drawn: list[Figure], tmp_path: Path) -> None:
    FIGURES.draw(name, tmp_path / "now.png")
    then, now = FIGURES.shown(FOLDER / name), FIGURES.shown(tmp_path / "now.png")
    if FIGURES.is_measured(now):
        then, now = FIGURES.without_ticks(then), FIGURES.without_ticks(now)
    assert differences(then, now) == [], "run: make docs"
    assert [misplaced(each) for each in drawn] == [[]]


def test_the_film_of_the_live_page_moves_is_small_and_tells_what_it_shows() -> None:
    from PIL import Image

    film = FOLDER / "live_view.webp"
    assert film.stat().st_size < LARGEST_FILM
    with Image.open(film) as picture:
        told = json.loads(picture.info["xmp"])
        assert getattr(picture, "n_frames", 1) == len(told) > 50
    places = [each["handle"][0] for each in told]
    assert min(places) < -0.01
    assert max(places) > 0.02


@pytest.mark.thorough("films the live page")
@pytest.mark.xdist_group("browser pictures")
@pytest.mark.skipif(
    not (shutil.which("chromium") and shutil.which("chromedriver")),
    reason="needs: apt-get install chromium chromium-driver",
)
def test_the_film_is_as_today_s_page_shows_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    script = load("make_live_view")
    monkeypatch.setattr(script, "FRAMES", 36)
    pairs = list(zip(script.filmed().shown, script.content(script.FILE)[:36], strict=True))
    other = {
        number: [each for each in now.items() if each not in then.items()] for number, (now, then) in enumerate(pairs)
    }
    assert {number: each for number, each in other.items() if each} == {}, "run: make film"


@pytest.mark.thorough("makes a report")
def test_in_the_figures_of_a_report_no_texts_overlap_or_leave_the_canvas(drawn: list[Figure], tmp_path: Path) -> None:
    report = make_report(tmp_path, Tools(api.run, api.plan), quick=True)
    assert report.findings
    assert len(drawn) > 15
    assert {found for each in drawn for found in misplaced(each)} == set()


def wave(name: str = "wave", height: float = 1.0) -> Figure:
    picture = figure(3.0, 5.0, "Three words 1")
    panel = picture.subplots()
    panel.plot([0.0, 1.0, 2.0], [0.0, height, 0.0], label=name)
    dress(panel, "a wave", "time [s]", "height [m]")
    name_lines(picture)
    return picture


def test_a_stale_picture_is_found() -> None:
    then = content(wave())
    assert differences(then, content(wave())) == []
    assert differences(then, content(wave(height=1.001))) == []
    assert differences(then, content(wave("ripple")))
    assert differences(then, content(wave(height=1.2)))
    assert differences({}, then)
    other = wave()
    other.axes[0].axhline(0.5)
    assert differences(then, content(other))
    logarithmic = deepcopy(then)
    logarithmic["panels"][0]["scales"] = ["linear", "log"]
    assert differences(then, logarithmic)


def errors(*values: float) -> dict[str, Any]:
    """Content of a picture of errors over steps."""
    picture = figure(3.0, 5.0, "Errors")
    panel = picture.subplots()
    panel.loglog(10.0 ** np.arange(len(values)), values)
    panel.set_ylim(1e-16, 1.0)
    dress(panel, "errors", "steps [1]", "error [1]")
    shown: dict[str, Any] = content(picture)
    return shown


def test_rounding_makes_no_picture_stale() -> None:
    """Processors round differently: what is left of an exact method is noise."""
    then = errors(2e-16, 1e-3)
    assert differences(then, errors(3e-14, 1.1e-3)) == []
    assert differences(then, errors(2e-16, 1e-1))
    assert differences(then, errors(1e-8, 1e-3))


def test_texts_that_overlap_or_leave_the_canvas_are_found() -> None:
    assert misplaced(wave()) == []
    picture = wave()
    picture.text(0.95, 0.5, "far out to the right")
    assert misplaced(picture) == ["outside: 'far out to the right'"]
    picture = wave()
    for word in ("one", "other"):
        picture.axes[0].text(1.0, 0.4, word)
    assert misplaced(picture) == ["overlap: 'one' and 'other'"]
