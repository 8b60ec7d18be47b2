"""The page of the report: text, tables and figures that need no other file, read by a real browser."""

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import api
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import LOOKS, OTHERS, look_of, svg
from haptic_fieldbus.study import make_report as run_report
from haptic_fieldbus.study.case import CaseResult
from haptic_fieldbus.study.measure.bench import Tools, bench_of
from haptic_fieldbus.study.measure.timing import Cost
from haptic_fieldbus.study.measure.work_precision import Point, Set, has_failed
from haptic_fieldbus.study.page import stability
from haptic_fieldbus.study.page.html import Cell, Context, Section, number_text, page, picture, table
from haptic_fieldbus.study.page.work_precision import at_fixed_cost, draw, is_as_claimed, order_words, sets_table
from tests.number_style import strange_numbers

TOOLS = Tools(api.run, api.plan)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
LOOK = """<script>addEventListener("load", () => {
  const images = [...document.images], data = document.body.dataset;
  data.images = images.length;
  data.broken = images.filter(image => !image.complete || image.naturalWidth < 400).length;
  data.over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
});</script>"""


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of one problem and of the impedance."""
    out = tmp_path_factory.mktemp("report")
    run_report.make_report(out, TOOLS, quick=True, only="impedance")
    return out


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"), (math.nan, "–"), (math.inf, "∞"), (-math.inf, "-∞"), (0.0, "0"), (1234.5, "1230"),
        (0.01234, "0.0123"), (-2.5, "-2.5"), (1e6, "1e6"), (2.5e-7, "2.5e-7"),
    ],
)  # fmt: skip
def test_numbers_read_as_people_write_them(value: float | None, text: str) -> None:
    assert number_text(value) == text


def test_cells_are_escaped_and_marked() -> None:
    text = table(("a", "b"), [["x < y", Cell("bad & worse", "bad")]])
    assert '<td class="text">x &lt; y</td><td class="bad">bad &amp; worse</td>' in text


def test_a_figure_lies_inside_the_page_and_is_told_in_words() -> None:
    text = picture("name", "<svg/>", 'what is "seen" <b>here</b>')
    assert 'src="data:image/svg+xml;base64,' in text
    assert 'alt="what is &quot;seen&quot; here"' in text


def test_every_method_has_a_look_of_its_own() -> None:
    known = [LOOKS[method] for method in METHODS if method in LOOKS]
    assert len({look.marker for look in known}) == len(known)
    looks = [look_of(method) for method in METHODS]
    assert len({(look.colour, look.marker, look.dashes) for look in looks}) == len(METHODS)


def test_a_method_without_a_look_in_the_table_has_one_that_no_other_has() -> None:
    told = {(look.colour, look.marker, look.dashes) for look in LOOKS.values()}
    assert told.isdisjoint({(look.colour, look.marker, look.dashes) for look in OTHERS})
    assert look_of("something new") == look_of("something new")
    assert look_of("something new") in OTHERS


def a_set(errors: list[float | None]) -> Set:
    points = tuple(
        Point("p", "rk4", 0.1 / 2**at, error, error, error, 1000.0, (1e3, 1e3, 1e3), 2.0, error is not None)
        for at, error in enumerate(errors)
    )
    return Set("p", "rk4", points, 2.0, 1.0, Cost(np.full(5, 1000.0), 5, 5))


@pytest.mark.thorough("makes a report")
def test_failures_are_drawn_and_told_and_never_dropped() -> None:
    failed = a_set([None, 1e6, 0.04, 0.01])
    assert [has_failed(point, failed.peak) for point in failed.points] == [True, True, False, False]
    whole, part = svg(draw([failed])), svg(draw([a_set([0.04, 0.01])]))
    assert whole.count("<use") > part.count("<use")
    assert "failed" in sets_table([a_set([None, None])])
    assert order_words(failed) == "2.00 (2)"
    assert is_as_claimed(failed)
    nothing = replace(failed, points=tuple(replace(point, order=None) for point in failed.points))
    assert not is_as_claimed(nothing), "a set in which every run failed does not count as good"
    assert is_as_claimed(replace(nothing, claimed=math.inf))


def test_the_error_at_a_fixed_cost_lies_between_two_runs() -> None:
    found = a_set([0.04, 0.01])  # at 10 and 20 µs a second: error ∝ 1/cost²
    assert at_fixed_cost(found, 10.0 * math.sqrt(2.0)) == pytest.approx(0.02)
    assert at_fixed_cost(found, 1000.0) is None


@pytest.mark.parametrize(
    ("only", "sections", "names"),
    [
        (None, tuple(run_report.SECTIONS), None),
        ("growth", ("growth",), None),
        ("tissue", ("work-precision",), {"tissue"}),
        ("wall-in-hand", ("work-precision",), {"wall-in-hand"}),
    ],
)
def test_a_part_is_chosen_by_its_name(only: str | None, sections: tuple[str, ...], names: set[str] | None) -> None:
    chosen = run_report.choose(only)
    assert chosen.sections == sections
    assert chosen.names == names


def test_a_case_is_chosen_by_its_name_and_shown_with_its_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    def passing(quick: bool) -> CaseResult:
        return CaseResult("1e-12", "3e-13", True, "mpmath", "1e-12", used=0.3)

    def breaking(quick: bool) -> CaseResult:
        raise ZeroDivisionError("no such number")

    for module in (run_report, stability):
        monkeypatch.setattr(module, "CASES", {"tiny-h": passing, "broken": breaking})
    assert run_report.choose("tiny-h") == run_report.ChosenSections(("stability",), frozenset({"tiny-h"}))
    context = Context(TOOLS, bench_of(api.plan("wall")), quick=True)
    section = stability.stability_section(context)
    rows = {row["name"]: row for row in context.rows["stability_cases"]}
    assert rows["tiny-h"] == {
        "name": "tiny-h", "expected": "1e-12", "measured": "3e-13", "passed": True, "oracle": "mpmath",
        "tolerance": "1e-12", "used": 0.3,
    }  # fmt: skip
    assert rows["broken"]["passed"] is False
    assert "ZeroDivisionError: no such number" in section.body
    assert "1 of 2" in section.findings[0]


def test_a_name_that_nobody_knows_is_refused_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"nearest: tissue.*work-precision"):
        run_report.choose("tisue")


def test_a_folder_that_cannot_be_made_is_told_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match="--out"):
        run_report.make_report(tmp_path / "file" / "report", TOOLS)


@pytest.mark.thorough("measures a case")
def test_a_folder_that_is_gone_when_the_report_is_written_is_told_as_one(tmp_path: Path) -> None:
    def spoil(label: str, share: float) -> None:
        if label == "done":
            shutil.rmtree(tmp_path / "out")

    with pytest.raises(UsageError, match=r'--out ".*out": No such file or directory'):
        run_report.make_report(tmp_path / "out", TOOLS, quick=True, only="zero-input-stays-zero", progress=spoil)


def test_numbers_that_json_does_not_know_become_null() -> None:
    assert run_report.json_ready({"a": (math.inf, [math.nan, 1.0]), "b": "text"}) == {
        "a": [None, [None, 1.0]],
        "b": "text",
    }


def test_progress_rises_to_the_end(tmp_path: Path) -> None:
    told: list[tuple[str, float]] = []
    run_report.make_report(tmp_path, TOOLS, quick=True, only="wall-in-hand", progress=lambda *now: told.append(now))
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert told[-1] == ("done", 1.0)


class Sources(HTMLParser):
    """Everything that a page would fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if name in ("src", "href")]


@pytest.mark.thorough("makes a report")
def test_the_page_fetches_nothing(report: Path) -> None:
    text = (report / "index.html").read_text()
    sources = Sources()
    sources.feed(text)
    assert sources.found
    assert all(source.startswith(("#", "data:image/svg+xml;base64,")) for source in sources.found)
    assert not re.search(r"@import|url\(", text)


@pytest.mark.thorough("makes a report")
def test_the_numbers_of_the_page_are_in_one_style(report: Path) -> None:
    text = re.sub(r'src="data:[^"]*"', "", (report / "index.html").read_text())
    assert strange_numbers(text) == []


def test_every_link_of_the_page_leads_to_a_heading() -> None:
    text = page("a title", "a lead", [Section("one", "One", "<p>body</p>", ("found & kept",))])
    assert 'href="#one"' in text
    assert '<section id="one">' in text


@pytest.mark.thorough("makes a report")
def test_figures_and_details_are_files_too(report: Path) -> None:
    assert [path.name for path in (report / "figures").iterdir()] == ["impedance.svg"]
    details = json.loads((report / "details.json").read_text())
    assert [each["scene"] for each in details["impedance"]] == ["wall", "damped_wall", "sprung_mass"]


@pytest.mark.thorough("starts a browser")
@pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: apt-get install chromium")
def test_a_browser_shows_every_figure_and_needs_no_scrolling_sideways_at_1280(report: Path, tmp_path: Path) -> None:
    looked = tmp_path / "looked.html"
    looked.write_text((report / "index.html").read_text().replace("</body>", f"{LOOK}</body>"))
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--window-size=1280,4000", "--virtual-time-budget=5000",
             f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom")  # fmt: skip
    shown = subprocess.run(
        [str(CHROMIUM), *flags, looked.as_uri()], capture_output=True, text=True, timeout=120, check=True
    ).stdout
    body = re.search(r"<body ([^>]*)>", shown)
    assert body is not None
    data = dict(re.findall(r'data-(\w+)="(-?\d+)"', body[1]))
    assert data == {"images": "1", "broken": "0", "over": "0"}
