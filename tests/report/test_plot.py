from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from haptic_fieldbus.assessing.loop_report import PeriodTimes
from haptic_fieldbus.assessing.result import Array, Result, TorqueError, Trace
from haptic_fieldbus.margins import Basis
from haptic_fieldbus.report.drawing import BINS, held, save, thin
from haptic_fieldbus.report.plot import (
    ZOOM_AFTER,
    ZOOM_BEFORE,
    cut,
    draw_axis,
    draw_run,
    first_force,
    headline,
    pushes_back,
)
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.pictures import misplaced

PERIOD, POINTS = 1e-3, 16


def push(duration: float = 2.0, workspace: Workspace = Workspace.LINEAR, *, simulated: bool = True) -> Trace:
    """A handle that swings into a wall at 20 mm and out again, the force a period late."""
    times = np.arange(round(duration / PERIOD * POINTS)) * PERIOD / POINTS
    position = 0.03 * np.sin(2 * np.pi * times)
    ideal = np.minimum(0.0, -600.0 * (position - 0.02))
    force = np.concatenate([np.zeros(POINTS), ideal[:-POINTS]])
    sampled = slice(0, None, POINTS)
    return Trace(
        "handle", workspace, times, position, force, ideal if simulated else None, times[sampled], position[sampled]
    )


def result_of(*traces: Trace, walls: tuple[Wall, ...] = ()) -> Result:
    """A result that shows these traces."""
    plan = SimpleNamespace(scene=SimpleNamespace(of_axis=lambda axis: walls), axes=(), bus_load=0.27)
    return Result(
        scene="wall",
        drive="maxon EPOS4",
        bus="sim",
        rate=1000.0,
        cycles=2000,
        missed_cycles=0,
        bus_load=0.27,
        plan=cast("None", plan),
        torque_error=TorqueError(0.09, 0.41, "N", {"encoder": 1.0}),
        verdict="Feels like a wall.",
        traces=traces,
    )


@pytest.mark.thorough("draws a run in each format", quick=(".png",))
@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_a_run_is_drawn_in_every_format(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"demo{suffix}"
    save(draw_run(result_of(push(), walls=(Wall("handle", 600.0, 0.02),))), path)
    assert path.stat().st_size > 10_000


def panels_of(trace: Trace, *walls: Wall) -> Figure:
    figure = Figure()
    draw_axis(figure, trace, list(walls))
    return figure


def labels(figure: Figure, panel: int) -> set[str]:
    return set(figure.axes[panel].get_legend_handles_labels()[1])


def test_position_wall_force_and_error_are_on_the_picture() -> None:
    figure = panels_of(push(), Wall("handle", 600.0, 0.02))
    assert len(figure.axes) == 6
    assert labels(figure, 0) == {"encoder", "handle", "wall", "first force"}
    assert labels(figure, 2) == {"rendered", "ideal", "pushes back"}
    assert labels(figure, 4) == {"error", "below ±8 %: not noticed"}
    assert [panel.get_ylabel() for panel in figure.axes] == [
        "position [mm]", "force [N]",
        "force [N]", "position [mm]",
        "error [N]", "force [N]",
    ]  # fmt: skip
    assert [panel.get_title("left") for panel in figure.axes[1::2]] == [
        "force over position", "first force, period by period", "",
    ]  # fmt: skip
    assert [panel.get_xlabel() for panel in figure.axes] == [
        "", "position [mm]", "", "", "time [s]", "time [ms]",
    ]  # fmt: skip


@pytest.mark.parametrize(("side", "inside"), [("positive", 25.0), ("negative", 15.0)])
def test_the_wall_is_shaded_where_its_material_is(side: str, inside: float) -> None:
    figure = panels_of(push(), Wall("handle", 600.0, 0.02, side="positive" if side == "positive" else "negative"))
    (shade,) = walls_of(figure)
    assert not shade.get_hatch()
    low, high = shade.get_extents().transformed(figure.axes[0].transData.inverted()).intervaly
    assert low < inside < high


def walls_of(figure: Figure) -> list[Patch]:
    return [patch for patch in figure.axes[0].patches if patch.get_label() == "wall"]


def test_a_bilateral_wall_is_a_line_without_material() -> None:
    figure = panels_of(push(), Wall("handle", 600.0, 0.02, sides="bilateral"))
    assert not walls_of(figure)


def test_names_stand_at_their_lines_and_nothing_overlaps() -> None:
    figure = draw_run(result_of(push(), walls=(Wall("handle", 600.0, 0.02),)))
    assert misplaced(figure) == []
    assert [panel.get_legend() for panel in figure.axes] == [None] * 6
    shown = [{text.get_text() for text in panel.texts} for panel in figure.axes]
    assert all(labels(figure, number) <= texts for number, texts in enumerate(shown))


@pytest.mark.parametrize(
    ("verdict", "few", "rest"),
    [
        ('Feels right: force error 1.4 % (people notice from 8 %), hand "tap".', "Feels right: force error 1.4 %",
         'People notice from 8 %, hand "tap".'),
        ("No contact in this run: nothing touched.", "No contact in this run: nothing touched", ""),
        ("Feels right, 2 ms late (people notice from 30 ms): force error 3 %.", "Feels right",
         "2 ms late (people notice from 30 ms): force error 3 %."),
        (None, "wall", ""),
    ],
)  # fmt: skip
def test_the_title_is_the_begin_of_the_verdict(verdict: str | None, few: str, rest: str) -> None:
    assert headline(replace(result_of(push()), verdict=verdict)) == (few, rest)


def test_the_title_of_an_unstable_run_has_the_limit() -> None:
    limits = SimpleNamespace(stable=1492.0)
    found = SimpleNamespace(
        stiffness=20000.0, stiffness_limit=limits, limit=SimpleNamespace(value=750.0, basis=Basis.STATED)
    )
    axis = SimpleNamespace(name="handle", workspace=Workspace.LINEAR, stability=found)
    plan = cast("None", SimpleNamespace(axes=(axis,)))
    unstable = replace(result_of(push()), verdict="Unstable: above the limit. A hand may damp it.", plan=plan)
    assert headline(unstable) == (
        "Unstable: 20000 N/m, limit 750 N/m",
        "Above the limit. A hand may damp it. Damping stated, not measured.",
    )


def test_force_towards_the_start_pushes_back_and_other_force_does_not() -> None:
    trace = push()
    assert pushes_back(trace)
    assert not pushes_back(replace(trace, force=-trace.force))
    assert not pushes_back(replace(trace, force=0.0 * trace.force))
    assert not pushes_back(replace(trace, force=np.where(trace.times < 1.0, -1.0, 1.0)))


def test_an_error_that_would_be_a_smear_is_an_envelope() -> None:
    trace = push()
    assert trace.ideal is not None
    noise = 0.2 * np.sin(2 * np.pi * 300.0 * trace.times)
    figure = panels_of(replace(trace, force=trace.ideal + noise))
    assert "error" not in [line.get_label() for line in figure.axes[4].get_lines()]
    (band,) = [each for each in figure.axes[4].collections if each.get_label() == "error"]
    heights = np.asarray(band.get_paths()[0].vertices)[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((-0.2, 0.2), rel=1e-3)


def test_a_virtual_mass_is_drawn_beside_the_handle() -> None:
    trace = push()
    figure = panels_of(
        Trace(
            "handle", trace.workspace, trace.times, trace.position, trace.force, virtual={"sprung_mass": trace.position}
        )
    )
    assert "mass of sprung_mass" in labels(figure, 0)


def test_a_rotary_axis_is_drawn_in_degrees_and_newton_metres() -> None:
    figure = panels_of(push(workspace=Workspace.ROTARY))
    assert [figure.axes[panel].get_ylabel() for panel in (0, 2)] == ["position [°]", "torque [N·m]"]


def test_without_an_ideal_there_is_no_error_to_draw() -> None:
    figure = panels_of(push(simulated=False))
    assert [panel.get_ylabel() for panel in figure.axes[::2]] == ["position [mm]", "force [N]", "force [N]"]
    assert figure.axes[2].get_xlabel() == "time [s]"


def test_a_handle_that_is_known_by_its_encoder_alone_is_one_line() -> None:
    trace = push(simulated=False)
    figure = panels_of(replace(trace, samples=trace.position, sample_times=trace.times))
    assert labels(figure, 0) == {"handle (encoder)", "first force"}


def test_of_a_run_on_real_drives_the_last_panel_shows_the_times_of_its_periods() -> None:
    """10000 periods; one begins 7 ms late, and a line of fewer points must still reach there."""
    times: Array = np.linspace(0.0, 10.0, 10_000)
    late = np.where(times == times[4321], 7e-3, 2e-5)
    trace = replace(push(10.0, simulated=False), sample_times=None, samples=None)
    figure = Figure()
    draw_axis(figure, trace, [], periods=PeriodTimes(times, late, np.full(10_000, 3e-4)))
    panel = figure.axes[2]
    assert labels(figure, 2) == {"feedback age", "period starts late by"}
    by_name = {line.get_label(): np.asarray(line.get_ydata()) for line in panel.get_lines()}
    assert by_name["period starts late by"].max() == pytest.approx(7.0)
    assert by_name["feedback age"].max() == pytest.approx(0.3)
    assert panel.get_ylabel() == "time [ms]"


def test_without_any_force_there_is_nothing_to_look_at_closely() -> None:
    quiet = push()
    still = Trace("handle", quiet.workspace, quiet.times, quiet.position, 0 * quiet.force, 0 * quiet.force)
    assert first_force(still) is None
    assert len(panels_of(still).axes) == 3


def test_the_time_before_the_full_force_is_marked() -> None:
    whole = push()
    late = cut(whole, 0.5, 2.0)
    faded = replace(late, sample_times=whole.sample_times, samples=whole.samples)
    assert "force fades in" in [text.get_text() for text in panels_of(faded).axes[2].texts]
    assert not panels_of(whole).axes[2].texts


def test_changes_are_marked_where_they_began() -> None:
    figure = Figure()
    draw_axis(figure, push(), [], changes=[0.5, 1.25])
    for panel in figure.axes[:5:2]:
        marks = [line.get_xdata() for line in panel.lines if line.get_linestyle() == ":"]
        assert [list(np.unique(cast("Array", mark))) for mark in marks] == [[0.5], [1.25]]
    assert [text.get_text() for text in figure.axes[2].texts] == ["changed ", "changed "]


@pytest.mark.thorough("draws a run")
def test_two_axes_stand_below_one_another(tmp_path: Path) -> None:
    save(draw_run(result_of(push(), push())), tmp_path / "two.png")
    save(draw_run(result_of(push())), tmp_path / "one.png")
    assert image_height(tmp_path / "two.png") == 2 * image_height(tmp_path / "one.png")


def image_height(path: Path) -> int:
    """From the header of a PNG file (ISO 15948, 11.2.2)."""
    return int.from_bytes(path.read_bytes()[20:24], "big")


def test_the_closer_look_spans_some_periods_around_the_first_force() -> None:
    trace = push()
    window = first_force(trace)
    assert window is not None
    first, last = window
    contact = np.arcsin(0.02 / 0.03) / (2 * np.pi)
    assert first < contact < last
    assert last - first == pytest.approx((ZOOM_BEFORE + ZOOM_AFTER) * PERIOD)


def test_the_closer_look_stays_inside_the_run() -> None:
    trace = push(0.13)
    window = first_force(trace)
    assert window is not None
    assert window[1] == trace.times[-1]


def test_a_cut_keeps_all_that_lies_between_two_times() -> None:
    trace = push()
    close = cut(trace, 0.1, 0.12)
    assert close.times[0] >= 0.1
    assert close.times[-1] <= 0.12
    assert len(close.times) == len(close.force) == len(close.position) == pytest.approx(20 * POINTS, abs=1)
    assert close.samples is not None
    assert len(close.samples) == pytest.approx(20, abs=1)


def test_a_held_value_is_a_staircase_to_the_end() -> None:
    times, values = held(np.array([0.0, 1.0]), np.array([5.0, 7.0]), 3.0)
    assert times.tolist() == [0.0, 1.0, 1.0, 3.0]
    assert values.tolist() == [5.0, 5.0, 7.0, 7.0]


@given(st.integers(1, 40_000), st.integers(0, 2**32 - 1))
def test_thinning_keeps_ends_and_extremes_in_order(points: int, seed: int) -> None:
    values: Array = np.random.default_rng(seed).normal(size=points)
    times: Array = np.arange(points, dtype=float)
    at, kept = thin(times, values)
    assert len(kept) <= 4 * BINS
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert (at[0], at[-1]) == (times[0], times[-1])
    assert (np.diff(at) > 0).all()
    assert (values[at.astype(int)] == kept).all()
