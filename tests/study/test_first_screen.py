"""The first screen of the report: four questions with their answers, what is assumed, and a warning on a busy host."""

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from haptic_fieldbus import api
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.study import make_report as run_report
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.make_report import assumed
from haptic_fieldbus.study.measure.bench import FEW_SCENES, Tools, bench_of
from haptic_fieldbus.study.measure.timing import Cost
from haptic_fieldbus.study.measure.work_precision import Point, Set
from haptic_fieldbus.study.page import cost, sources, stability, work_precision
from haptic_fieldbus.study.page.html import Card, Context, Section, page, plain_text
from haptic_fieldbus.study.page.sources import scene_error
from tests.ci_summary import best_ms, counted
from tests.number_style import strange_numbers

TOOLS = Tools(api.run, api.plan)
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
QUESTIONS = (
    "What does accuracy cost?",
    "How does the error grow along a run?",
    "Is the loop stable in stiff and extreme cases?",
    "What does a scene omit?",
)
MEASURE = """<script>addEventListener("load", () => {
  const data = document.body.dataset, first = document.getElementById("first").getBoundingClientRect();
  data.bottom = Math.ceil(first.bottom);
  data.images = document.querySelectorAll("#first .card img").length;
  const cards = [...document.querySelectorAll("#first .card")];
  data.cards = cards.length;
  data.narrow = cards.filter(card => card.scrollWidth > card.clientWidth).length;
  data.over = document.documentElement.scrollWidth - document.documentElement.clientWidth;
});</script>"""


def result(passed: bool, used: float | None) -> CaseResult:
    return CaseResult("this", "that", passed, "by hand", "1 %", used)


def a_set(problem: str, method: str, errors: list[float | None]) -> Set:
    points = tuple(
        Point(problem, method, 1e-3 * 2**-at, error, error, error, 100.0, (1e2, 1e2, 1e2), 1.0, True)
        for at, error in enumerate(errors)
    )
    return Set(problem, method, points, 1.0, 2.0, Cost(np.full(5, 100.0), 1, 1))


def test_a_share_is_the_largest_of_its_deviations_and_no_number_is_the_worst() -> None:
    assert share_used((1e-9, 1e-8), (-0.5, 2.0)) == 0.25
    assert share_used((0.0, 1.0)) == 0.0
    assert share_used((0.1, 1.0), (math.nan, 1.0), (0.2, 1.0)) == math.inf


@pytest.mark.parametrize(
    ("passed", "used", "margin"),
    [
        (True, 0.25, 4.0),
        (False, 4.0, 0.25),
        (True, None, math.inf),
        (True, 0.0, math.inf),
        (False, None, 0.0),
        (False, 0.0, 0.0),
        (False, 0.5, 0.0),
        (False, math.inf, 0.0),
    ],
)
def test_a_margin_is_what_is_permitted_over_what_was_found(passed: bool, used: float | None, margin: float) -> None:
    assert stability.margin_of(result(passed, used)) == margin


def test_every_case_is_a_mark_and_what_failed_is_named() -> None:
    found = {name: result(True, 0.1) for name in CASES} | {"tissue": result(True, 0.2)}
    cases = {**CASES, "tissue": CASES["tiny-h"]}
    found["lost-bus"], found["long-clock"] = result(False, None), result(False, 3.0)
    (panel,) = stability.draw(cases, found).axes
    assert len(panel.lines) == len(found) + 1, "a mark a case, and the line at which cases fail"
    names = {text.get_text() for text in panel.texts}
    assert "lost-bus, long-clock" in names
    assert any(name.startswith("tissue 5") for name in names), "the closest of its row, with its margin"
    assert [stability.margin_of(found[name]) for name in stability.closest(found)[:2]] == [0.0, 1.0 / 3.0]
    rows = {label.get_text() for label in panel.get_yticklabels()}
    assert rows == {stability.family_of(case) for case in cases.values()}


def test_the_median_over_problems_counts_a_failed_run_as_the_worst() -> None:
    curves = [[(1.0, 0.1), (2.0, 0.01)], [(3.0, math.inf), (4.0, 0.03)], [(5.0, 0.3), (6.0, 0.02)]]
    assert work_precision.median_curve(curves) == [(3.0, 0.3), (4.0, 0.02)]
    assert work_precision.median_curve([curves[1]] * 2 + curves[:1])[0][1] == math.inf
    assert work_precision.curve(a_set("tissue", "rk4", [None, 21.0, 1.0])) == [
        (100.0, math.inf), (200.0, math.inf), (400.0, 0.5),
    ]  # fmt: skip


def test_one_figure_shows_every_method_on_all_problems_and_in_the_loop() -> None:
    alone = [[a_set(name, method, [0.2, 0.1]) for method in METHODS] for name in ("tissue", "free-puck")]
    loops = [[a_set(name, "none", [0.1, 0.05])] for name in work_precision.LOOPS]
    drawn = work_precision.draw_all([*alone, *loops])
    named = {text.get_text() for text in drawn.legends[0].get_texts()}
    assert set(METHODS) <= named
    assert len([line for line in drawn.axes[0].lines if line.get_alpha()]) == 2 * len(METHODS), "each problem, faint"
    assert len(drawn.axes[1].lines) == len(loops) + 1
    told = work_precision.problems_finding([*alone, *loops])
    assert "has an error of 10 % of the largest force" in told
    assert "1.00 times the computing" in told
    assert work_precision.problems_finding(alone) == ""


def test_a_line_a_scene_says_what_it_leaves_out() -> None:
    plans = {name: api.plan(name) for name in ("wall", "virtual_shaft")}
    costs = {"wall": Cost(np.array([1770.0, 1790.0, 1902.0]), 1, 1), "virtual_shaft": Cost(np.full(3, 6470.0), 1, 1)}
    text = plain_text(cost.lines(plans, costs).replace("<td", "|<td"))
    assert "|wall|velocity, estimator, integrator, virtual states|1.79 (1.78 to 1.85)" in text
    assert "|virtual_shaft|integrator, virtual states|6.47 (6.47 to 6.47)" in text
    told = "of wall takes 1.8 µs of computing, one of virtual_shaft (2 axes) 6.5 µs"
    assert told in plain_text(cost.scenes_finding(plans, costs))
    reasons = cost.reasons(plans)
    assert "no element needs it" in reasons
    assert "<td>12</td>" in reasons, "8 octets in and 4 out for each axis"
    assert "<td>24</td>" in reasons
    assert set(FEW_SCENES) <= set(scene_names())


def test_what_is_assumed_stands_there_with_its_numbers() -> None:
    plan = api.plan("wall")
    bench = bench_of(plan)
    text = plain_text(assumed(plan, bench, {"python": "CPython 3", "processor": "a <fast> one"}))
    assert all(line in text for line in plan.assumed)
    assert f"torque acts {1e3 * bench.delay:.3g} ms" in text
    assert "No hardware" in text
    assert "a <fast> one" in text
    assert strange_numbers(text) == []


def test_the_first_finding_of_a_section_answers_on_its_card_and_the_others_follow() -> None:
    with_card = Section("one", "One", "", ("the answer", "more"), card=Card("A question?", "<p>figure</p>"))
    text = page("t", "l", [with_card, Section("two", "Two", "", ("another",))], "what is taken", "busy & slow")
    first, rest = text.split("</header>")
    assert "A question?" in first
    assert "the answer" in first
    assert "what is taken" in first
    assert "busy & slow" in first
    assert re.findall("<li>(.*?)</li>", rest) == ["more", "another"]
    assert 'class="busy"' not in page("t", "l", [with_card])


@pytest.mark.thorough("runs scenes for seconds of virtual time")
def test_the_walls_error_is_the_same_in_a_quick_report_and_is_that_of_its_delay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sources, "FEW_SCENES", ("wall",))
    monkeypatch.setattr(sources, "library_scenes", lambda: ("wall",))
    quick, full = (
        sources.sources_section(Context(TOOLS, bench_of(api.plan("wall")), quick)) for quick in (True, False)
    )
    assert quick.findings == full.findings
    assert quick.details == full.details
    led = scene_error(TOOLS, sources.LED, sources.SECONDS, sources.LED_HAND)
    trace = api.run("wall", hand=sources.LED_HAND, duration=sources.SECONDS).traces[0]
    plan = api.plan("wall")
    depth, speed = trace.position - 0.02, np.gradient(trace.position, trace.times)
    moving = (depth > 0.0) & (np.abs(speed) > 0.05 * np.abs(speed).max())
    # A force that is late by τ is off by K·v·τ: half a period of hold, the way to the drive, and the torque loop.
    late = 0.5 * plan.period + plan.delay.total
    expected = late * math.sqrt(np.mean(speed[moving] ** 2) / np.mean(depth[moving] ** 2))
    assert led.contact == pytest.approx(expected, rel=0.1)


LONGEST = 2500
"""Processor time that a quick report may take, in units of a fixed computation that is measured beside it."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole quick report, made in less processor time than it may take."""
    out, begun = tmp_path_factory.mktemp("whole"), process_time()
    run_report.make_report(out, TOOLS, quick=True)
    used = process_time() - begun
    assert 1e3 * used / best_ms(counted) < LONGEST
    return out


@pytest.mark.thorough("makes a whole report")
def test_the_first_screen_has_the_questions_the_findings_and_what_is_assumed(whole: Path) -> None:
    first, rest = (whole / "index.html").read_text().split("</header>")
    assert re.findall(r"<h2><a href=[^>]*>([^<]*)</a></h2>", first) == list(QUESTIONS)
    report = json.loads((whole / "report.json").read_text())
    text = plain_text(re.sub(r'src="data:[^"]*"', "", first))
    answers = [finding for finding in report["findings"] if finding in text]
    assert len(answers) == len(QUESTIONS)
    assert all(re.search(r"\d", answer) for answer in answers)
    assert "Assumptions." in text
    assert all(f">{scene}<" in first for scene in FEW_SCENES)
    assert all(finding in plain_text(rest) for finding in report["findings"] if finding not in answers)
    assert strange_numbers(text) == []
    assert bool(report["warnings"]) is ('class="busy"' in first)


@pytest.mark.thorough("makes a whole report")
@pytest.mark.skipif(CHROMIUM is None, reason="needs a browser: apt-get install chromium")
@pytest.mark.parametrize("busy", [True, False])
def test_a_browser_of_1280_by_800_shows_the_answers_without_scrolling(busy: bool, whole: Path, tmp_path: Path) -> None:
    text = re.sub(r'<p class="busy">.*?</p>', "", (whole / "index.html").read_text(), flags=re.DOTALL)
    if busy:  # the longest words that a warning has
        banner = f'<p class="busy">{"This machine was busy while its times were taken. " * 4}</p>'
        text = text.replace('<div class="first">', f'{banner}<div class="first">', 1)
    looked = tmp_path / "looked.html"
    looked.write_text(text.replace("</body>", f"{MEASURE}</body>"))
    flags = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--window-size=1280,800",
             "--virtual-time-budget=5000", f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom")  # fmt: skip
    shown = subprocess.run(
        [str(CHROMIUM), *flags, looked.as_uri()], capture_output=True, text=True, timeout=120, check=True
    ).stdout
    body = re.search(r"<body ([^>]*)>", shown)
    assert body is not None
    data = {key: int(value) for key, value in re.findall(r'data-(\w+)="(-?\d+)"', body[1])}
    assert data["bottom"] <= 800
    assert (data["cards"], data["images"], data["narrow"], data["over"]) == (4, 3, 0, 0)
