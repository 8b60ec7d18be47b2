"""`twin`: from a recorded run to a simulation that behaves as the bench, and back to what changed on it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.api.twin import BenchTwin, twin
from haptic_fieldbus.drive.rig import Identified, LinearMechanism, Mechanics, Rig
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.margins import Basis
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.recordings.reading import RecordedRun
from tests.identification.twins import (
    LASTING,
    OTHERS,
    HiddenBench,
    errors_between,
    hidden_bench,
    prediction,
    recorded,
    twin_of,
    verdicts,
)

SECONDS = 8.0
TRUTH = Mechanics(inertia=9e-5, viscous_damping=3e-4, coulomb_friction=4e-3, torque_bandwidth=400.0)


@pytest.fixture(scope="module")
def bench() -> HiddenBench:
    """A bench of CANopen that states less than half of its inertia."""
    drawn = hidden_bench(3)
    return replace(drawn.with_truth(TRUTH), rate=500.0)


@pytest.fixture(scope="module")
def minute(bench: HiddenBench, tmp_path_factory: pytest.TempPathFactory) -> RecordedRun:
    return recorded(bench, LASTING[0], tmp_path_factory.mktemp("runs") / "minute.mcap", SECONDS, 1)


@pytest.fixture(scope="module")
def made(bench: HiddenBench, minute: RecordedRun, tmp_path_factory: pytest.TempPathFactory) -> tuple[BenchTwin, Rig]:
    return twin_of(minute, bench.stated, tmp_path_factory.mktemp("twins"))


def test_the_twin_has_the_values_of_the_hidden_bench(made: tuple[BenchTwin, Rig]) -> None:
    axis = made[1].axis["handle"]
    for name in ("inertia", "viscous_damping", "coulomb_friction"):
        true = getattr(TRUTH, name)
        low, high = getattr(axis.identified, f"{name}_interval")
        assert low <= true <= high, name
        assert getattr(axis.simulation, name) == pytest.approx(true, rel=0.02)
    assert axis.simulation.torque_bandwidth == pytest.approx(400.0, rel=0.15)
    assert axis.simulation.torque_scale == 1.0
    assert axis.inertia == 4.0e-5, "what the rig states stays as it is"
    assert axis.identified.digest is None, "its values are judged like stated ones"


@pytest.mark.thorough("fits scales of torque and counts to 12 s of a run")
@pytest.mark.parametrize(("counts", "told"), [(16384, 1.07), (1024, None)])
def test_a_wrong_torque_constant_beside_a_damper_is_told_or_named_as_unknown(
    tmp_path: Path, counts: int, told: float | None
) -> None:
    """The best fit with the stated torque leaves hardly more than rounding: only fine counts tell damper and bench."""
    truth = Mechanics(
        inertia=6e-5, viscous_damping=2e-4, coulomb_friction=2e-3, torque_bandwidth=1000.0, torque_scale=1.07
    )
    bench = replace(hidden_bench(3).with_truth(truth), rate=1000.0)
    axis = replace(bench.rig.axis["handle"], encoder_counts_per_revolution=counts)
    bench = replace(bench, rig=replace(bench.rig, axis={"handle": axis}))
    run = recorded(bench, ("damper", "shake", {}), tmp_path / "run.mcap", 12.0, 1)
    made = twin(run, bench.stated)
    values = made.fit.values
    if told is None:
        assert "the bench act alike" in values["torque_scale"].reason
        assert "torque_scale" in made.text.splitlines()[1]
    else:
        assert values["torque_scale"].value == pytest.approx(told, rel=0.01)
        assert values["torque_scale"].reason == ""
        assert values["viscous_damping"].value == pytest.approx(2e-4, rel=0.03)


def test_the_twin_predicts_a_run_that_was_not_recorded_with_the_same_frames_for_a_seed(
    bench: HiddenBench, made: tuple[BenchTwin, Rig], tmp_path: Path
) -> None:
    truth = recorded(bench, OTHERS[1], tmp_path / "truth.mcap", 2.0, 7)
    first = recorded(bench, OTHERS[1], tmp_path / "first.mcap", 2.0, 7, made[1])
    again = recorded(bench, OTHERS[1], tmp_path / "again.mcap", 2.0, 7, made[1])
    stated = recorded(bench, OTHERS[1], tmp_path / "stated.mcap", 2.0, 7, bench.stated)
    assert max(errors_between(truth, first)) < 0.1
    assert max(errors_between(truth, stated)) > 0.1, "the rig as it was stated predicts less"
    assert np.array_equal(first.table(), again.table())


def test_a_twin_raises_no_permitted_torque(bench: HiddenBench, made: tuple[BenchTwin, Rig]) -> None:
    stated, found = (load(Task("spring", rig)).plan.axes[0] for rig in (bench.stated, made[1]))
    assert (found.limits.effort, found.limits.holding) == (stated.limits.effort, stated.limits.holding)
    assert found.bench.basis is Basis.STATED
    assert found.rig.permissions == stated.rig.permissions


def test_the_twin_of_a_simulated_run_counts_on_a_simulated_bus_only(made: tuple[BenchTwin, Rig]) -> None:
    axis = replace(made[1].axis["handle"], inertia=None, viscous_damping=None, coulomb_friction=None)
    on_a_real_bus = replace(made[1], bus={"bus": CanSection("socketcan", "can0")}, axis={"handle": axis})
    assert load(Task("spring", made[1])).plan.axes[0].bench.inertia is not None
    bench = load(Task("spring", on_a_real_bus)).plan.axes[0].bench
    assert (bench.inertia, bench.viscous_damping, bench.coulomb_friction) == (None, None, None)
    assert "measured on a simulated bus" in bench.unknown
    with pytest.raises(PlanError, match=r"stability unknown.*measured on a simulated bus"):
        select(Task("spring", on_a_real_bus))


@pytest.mark.thorough("fits twins")
def test_what_changed_is_named_alone_and_an_unchanged_bench_is_left_alone(
    bench: HiddenBench, made: tuple[BenchTwin, Rig], minute: RecordedRun, tmp_path: Path
) -> None:
    assert twin(minute, made[1]).changed == ()
    heavier = recorded(bench.changed("inertia"), LASTING[0], tmp_path / "heavier.mcap", SECONDS, 2)
    found = twin(heavier, made[1])
    assert [each.name for each in found.changed] == ["inertia"]
    assert found.changed[0].after / found.changed[0].before == pytest.approx(1.15, abs=0.03)
    assert "+15" in found.changed[0].text
    assert found.compared


def test_a_hand_on_a_real_bench_is_stated_or_refused(bench: HiddenBench, minute: RecordedRun) -> None:
    assert minute.provenance is not None
    real = replace(minute, provenance=replace(minute.provenance, simulated=False))
    with pytest.raises(UsageError, match=r"the hand is unknown.*--free FROM:TO.*or --hand"):
        twin(real, bench.stated)
    with pytest.raises(UsageError, match="no bench can be fitted: the handle moves for less than"):
        twin(real, bench.stated, free=[(1.0, 2.0)])
    found = twin(real, bench.stated, hand="shake")
    assert found.fit.values["inertia"].value == pytest.approx(9e-5, rel=0.02)
    assert not found.rig.axis["handle"].identified.simulated
    assert load(Task("spring", found.rig)).plan.axes[0].bench.unknown == ""


def test_a_recording_that_tells_nothing_is_refused_with_the_reason(bench: HiddenBench, minute: RecordedRun) -> None:
    axis = bench.stated.axis["handle"]
    other = replace(bench.stated, axis={"handle": replace(axis, mechanism=LinearMechanism("linear", 0.1))})
    still = replace(minute, columns={**minute.columns, "handle.statusword": 0.0 * minute["handle.statusword"]})
    less = replace(minute, columns={key: value for key, value in minute.columns.items() if "target" not in key})

    def with_axis(**changes: object) -> Rig:
        return replace(bench.stated, axis={"handle": replace(axis, **changes)})  # type: ignore[arg-type]

    flagless = replace(minute, columns={key: value for key, value in minute.columns.items() if "flags" not in key})
    torn = replace(minute, columns={**minute.columns, "handle.position": minute["handle.position"].copy()})
    torn.columns["handle.position"][700] = np.nan
    for found, rig, axis_name, words in (
        (torn, bench.stated, None, "handle.position is missing in some rows; expected a number in each"),
        (replace(minute, provenance=None), bench.stated, None, "no provenance"),
        (minute, other, None, "axis.handle.mechanism of the rig is not that of the recorded run"),
        (minute, bench.stated, "knob", "expected an axis of recording and rig: handle"),
        (still, bench.stated, None, "was never enabled"),
        (less, bench.stated, None, "expected rows of handle with position, target torque, statusword and flags"),
        (flagless, bench.stated, None, "expected rows of handle with position, target torque, statusword and flags"),
        (minute, with_axis(profile="generic_cia402_modbus"), None, "handle.profile of the rig is .* expected the same"),
        (minute, with_axis(torque_constant=0.123), None, "axis.handle.torque_constant of the rig is not that"),
        (minute, with_axis(peak_current=12.3), None, "axis.handle.peak_current of the rig is not that"),
    ):
        with pytest.raises(UsageError, match=words):
            twin(found, rig, axis=axis_name)


def test_inertia_that_falls_by_four_beside_the_same_friction_is_an_encoder() -> None:
    from haptic_fieldbus.api import twin as module

    before = Identified(inertia=4e-5, coulomb_friction=2e-3)
    assert module._count_factor(before, replace(before, inertia=1e-5)) == 4.0
    assert module._count_factor(before, replace(before, inertia=1e-5, coulomb_friction=5e-4)) == 1.0
    assert module._count_factor(before, replace(before, inertia=3e-5)) == 1.0
    assert module._count_factor(before, Identified()) == 1.0


@pytest.mark.thorough("predicts 10 s of twelve hidden benches from a minute each")
@pytest.mark.parametrize("group", [(10, 11, 12), (13, 14, 15), (16, 17, 18), (19, 20, 21)])
def test_twins_predict_other_scenes(group: tuple[int, ...]) -> None:
    good = [max(prediction(seed)) <= 0.1 for seed in group]
    assert sum(good) >= 2


@pytest.mark.thorough("plants changes on hidden benches")
@pytest.mark.parametrize("seed", [10, 11, 12])
def test_planted_changes_are_named(seed: int) -> None:
    assert verdicts(seed) == {"nothing": True, "inertia": True, "lag": True, "counts": True}


def test_arguments_of_a_wrong_kind_are_all_told_before_anything_is_read() -> None:
    with pytest.raises(TypeError) as refused:
        twin("nowhere.csv", 3, axis="", free="1:2")  # type: ignore[arg-type]
    assert str(refused.value).splitlines() == [
        "twin() rig: expected the path of a rig file, or a Rig of buses and axes, not 3 (int)",
        "twin() axis: expected a name, not '' (str)",
        "twin() free: expected times in s, such as [(12.0, 18.5)], not '1:2' (str)",
    ]
