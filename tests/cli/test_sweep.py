"""The command `sweep`: its grid, its folder, its lines and its pictures."""

import json
import subprocess
import sys
import time
from pathlib import Path
from signal import SIGHUP, SIGINT, SIGTERM

import pytest
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.text import Text

from haptic_fieldbus import Sweep, UsageError, sweep
from haptic_fieldbus.report.analysis_plots import LARGEST_DOT, draw_sweep
from tests.cli.command import Command, printed
from tests.peers.hosts import hear_signals
from tests.pictures import misplaced

GRID = ("--grid", "wall.stiffness=10:3000:6", "--grid", "wall.damping=0,20")


def test_the_rows_are_those_of_the_function(command: Command, tmp_path: Path) -> None:
    done = command("sweep", "wall", *GRID, "--out", tmp_path / "rows", "--workers", 1)
    assert done.status == 0, done.err
    lines = dict(printed(done.out))
    assert lines["points"].startswith("12, in ")
    assert lines["stable"] == "75 % of the points that were not refused"
    points = {"wall.stiffness": [10.0, 608.0, 1206.0, 1804.0, 2402.0, 3000.0], "wall.damping": [0, 20]}
    assert Sweep.read(tmp_path / "rows").to_arrow().equals(sweep("wall", points, workers=1).to_arrow())
    again = command("sweep", "wall", *GRID, "--out", tmp_path / "rows")
    assert dict(printed(again.out))["points"].startswith("12, 12 of them before, in ")


def test_limit_cycles_among_the_stable_points_are_told(command: Command, tmp_path: Path) -> None:
    grid = ("--grid", "spring.stiffness=100,300,9000", "--grid", "rig.handle.coulomb_friction=0,0.002")
    done = command("sweep", "spring", *grid, "--out", tmp_path / "rows", "--workers", 1)
    assert dict(printed(done.out))["stable"] == "67 % of the points that were not refused, 33 % with a limit cycle"
    found = Sweep.read(tmp_path / "rows")
    assert (found.stable_fraction, found.limit_cycle_fraction) == (4 / 6, 2 / 6)


def test_a_sample_and_refused_points_are_told(command: Command, tmp_path: Path) -> None:
    grid = ("--grid", "wall.stiffness=100:30000:log", "--grid", "rate=995:1005", "--sample", 9)
    done = command("sweep", "wall", *grid, "--seed", 3, "--out", tmp_path / "rows", "--json", "--workers", 1)
    told = json.loads(done.out)
    assert told["points"] == 9
    assert told["outcomes"] == {"done": 0, "refused": 9, "tripped": 0}
    assert told["stable_fraction"] is None
    assert told["loop_steps_per_s"] is None


def test_a_sample_of_whole_numbers_is_whole(command: Command, tmp_path: Path) -> None:
    grid = ("--grid", "detents.count=1:4", "--grid", "detents.amplitude=1:2.5", "--sample", 4)
    done = command("sweep", "detents", *grid, "--out", tmp_path / "rows", "--workers", 1)
    assert done.status == 0, done.err
    assert sorted(Sweep.read(tmp_path / "rows").to_frame()["detents.count"].tolist()) == [1, 2, 3, 4]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ((), "no points: expected --grid NAME=LO:HI:N"),
        (("--grid", "rate"), '--grid "rate": expected NAME=LO:HI:N'),
        (("--grid", "rate=1:2"), '--grid "rate=1:2": expected NAME=LO:HI:N'),
        (("--grid", "rate=0:2:3:log"), '--grid "rate=0:2:3:log": expected'),
        (("--grid", "rate=1:inf:3"), '--grid "rate=1:inf:3": expected'),
        (("--grid", "rate=nan:2", "--sample", "3"), '--grid "rate=nan:2": expected'),
        (
            ("--grid", "wall.stiffness=1:2:3", "--set", "wall.stiffness=5"),
            "wall.stiffness: given both as a setting and",
        ),
        (("--grid", "wall.stiffness=1:2:3", "--rate", "0"), "rate 0: expected a rate above 0"),
        (("--grid", "rate=1:2:1e9"), '--grid "rate=1:2:1e9": expected'),
        (("--grid", "rate=1:2:3", "--grid", "rate=1:2:3"), "--grid rate: given twice"),
        (("--grid", "rate=1:2:3", "--sample", "3"), '--grid "rate=1:2:3": expected NAME=LO:HI, or'),
        (("--grid", "rate=2:1", "--sample", "3"), "rate: expected (least, largest)"),
        (("--grid", "wall.stifness=1,2"), 'no parameter "stifness" of wall'),
        (("--grid", "rate=500", "--engine", "quick"), 'engine "quick": expected verdict'),
        (("--grid", "rate=500", "--plot", "x.gif"), "the suffix must be one of"),
        (("--grid", "rate=fast"), "--grid rate: expected a number in Hz, not 'fast'"),
        (("--grid", "seed=1,2.5", "--engine", "full"), "--grid seed: expected a whole number, not 2.5"),
        (("--grid", "wall.side=positive,negative", "--plot", "x.png"), "--plot: nothing to draw"),
        (("--grid", "rate=500:1000", "--sample", "1", "--plot", "x.png"), "--plot: nothing to draw"),
    ],
    ids=str,
)
def test_a_wrong_grid_is_refused_in_a_sentence(
    words: tuple[str, ...], sentence: str, command: Command, tmp_path: Path
) -> None:
    done = command("sweep", "wall", *words, "--out", tmp_path / "rows")
    assert done.status == 2
    assert sentence in done.err
    assert not (tmp_path / "rows").exists()


def test_a_picture_needs_a_number_that_varies(tmp_path: Path) -> None:
    found = sweep("wall", {"wall.side": ["positive", "negative"]}, workers=1)
    with pytest.raises(UsageError, match="no parameter with numbers is varied"):
        found.plot()
    with pytest.raises(UsageError, match=r"no column grew: nothing to draw; expected one of wall\.side, outcome"):
        found.plot("grew")


@pytest.mark.thorough("draws", quick=1)
@pytest.mark.parametrize("column", [None, "growth"])
@pytest.mark.parametrize(
    "points",
    [
        {"wall.stiffness": [10.0, 1000.0, 3000.0, -1.0], "wall.damping": [0.0, 5.0, 20.0]},
        {"wall.stiffness": [10.0, 100.0, 1000.0, 10000.0]},
        [{"wall.stiffness": 20.0 * place**2 + 1.0, "wall.damping": float(place % 5)} for place in range(20)],
    ],
    ids=("map", "line", "dots"),
)
def test_pictures_of_a_sweep_have_their_texts_in_place(points: object, column: str | None) -> None:
    found = sweep("wall", points, workers=1)  # type: ignore[arg-type]
    drawn = draw_sweep(found, column)
    assert misplaced(drawn) == []
    assert drawn.axes[0].get_xlabel() == "wall.stiffness [N/m]"


def labels_of(drawn: Figure) -> set[str]:
    panel = drawn.axes[0]
    return {*panel.get_legend_handles_labels()[1], *(each.get_text() for each in panel.get_yticklabels())}


def test_a_picture_tells_units_refusals_and_motion_in_words() -> None:
    grid = {"wall.stiffness": [100.0, 90000.0]}
    drawn = draw_sweep(sweep("wall", grid, engine="full", duration=0.1, workers=1))
    assert drawn.axes[0].get_ylabel() == "error_rms [N]"
    assert "error_rms of 2 points, 1 refused" in {each.get_text() for each in drawn.findobj(Text)}
    loops = sweep("wall", grid, engine="loop", workers=1)
    assert draw_sweep(loops, "peak").axes[0].get_ylabel() == "peak [m]"
    drawn = draw_sweep(loops)
    assert {"motion decays", "motion grows"} <= labels_of(drawn)


def test_a_picture_calls_a_loop_passive_without_condition_on_the_shipped_bench_alone() -> None:
    points = {"wall.stiffness": [100.0, 200.0], "wall.damping": [0.0, 0.1]}
    drawn = draw_sweep(sweep("wall", points, workers=1))
    assert "passive" in labels_of(drawn)
    rig = {"rig.handle.viscous_damping": [1e-4, 2e-4], "wall.stiffness": [100.0, 200.0]}
    assert "passive at the values of the rig" in labels_of(draw_sweep(sweep("wall", rig, workers=1)))


def test_a_few_points_are_dots_that_do_not_overlap() -> None:
    points = [{"wall.stiffness": 20.0 * place**2 + 1.0, "wall.damping": float(place % 5)} for place in range(20)]
    (dots,) = (each for each in draw_sweep(sweep("wall", points, workers=1)).findobj(PathCollection))
    assert isinstance(dots, PathCollection)
    assert dots.get_sizes().tolist() == [LARGEST_DOT**2]


@pytest.mark.thorough("waits for processes that are ended")
@pytest.mark.parametrize(("ending", "status"), [(SIGINT, 130), (SIGTERM, 143), (SIGHUP, 129)])
def test_a_sweep_that_is_stopped_goes_on(ending: int, status: int, tmp_path: Path) -> None:
    words = ["sweep", "sprung_mass", "--grid", "sprung_mass.mass=0.1:3:4000", "--out", str(tmp_path / "rows")]
    process = subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *words], stderr=subprocess.PIPE, text=True, cwd=tmp_path,
        preexec_fn=hear_signals,
    )  # fmt: skip
    for _ in range(600):
        if list((tmp_path / "rows").glob("*.parquet")):
            break
        time.sleep(0.05)
    process.send_signal(ending)
    assert "Traceback" not in process.communicate(timeout=60.0)[1]
    assert process.returncode == status
    assert not Sweep.read(tmp_path / "rows").complete


def test_the_reason_of_a_refusal_is_told_and_a_run_is_not_called_stable(command: Command, tmp_path: Path) -> None:
    grid = ("--grid", "wall.stiffness=100,90000", "--engine", "full", "--duration", 0.1, "--workers", 1)
    lines = dict(printed(command("sweep", "wall", *grid, "--out", tmp_path / "a").out))
    assert lines["refused"].startswith("1; first: ")
    assert "exceeds the limit" in lines["refused"]
    lines = dict(printed(command("sweep", "wall", *grid, "--out", tmp_path / "b", "--force").out))
    assert "stable" not in lines
    assert lines["untripped"].endswith("of the points that were not refused")
