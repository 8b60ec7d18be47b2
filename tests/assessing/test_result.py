import importlib.util
import json
import math
import pickle
import re
from base64 import b64decode
from concurrent.futures import ProcessPoolExecutor
from copy import deepcopy
from multiprocessing import get_context

import numpy as np
import pytest

from haptic_fieldbus.api import plan, response, run
from haptic_fieldbus.assessing.loop_report import LoopReport, Percentiles, Timing
from haptic_fieldbus.assessing.result import WIDEST, Result, TorqueError, TripRecord, finite, known_before, periods_text
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.explain import plan_json
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.builders import shipped


def test_percentiles_are_those_of_the_sample_in_microseconds() -> None:
    times_ns = 1000 * np.arange(1001)
    found = Percentiles.of(times_ns)
    assert found is not None
    assert (found.p50, found.p99, found.p999, found.max) == pytest.approx((500.0, 990.0, 999.0, 1000.0))


def test_of_nothing_there_are_no_percentiles() -> None:
    assert Percentiles.of([]) is None
    none = dict.fromkeys(("period_us", "age_us", "compute_us", "lateness_us"))
    assert Timing(None, None, None).to_json() == {**none, "late": 0}


def test_what_is_not_known_is_null() -> None:
    known: dict[str, object] = {"scene": "wall", "drive": "maxon_epos4", "bus": "sim", "rate_hz": 1000.0}
    known |= {"trips": [], "changes": [], "passivity": [], "guards": [], "travel": []}
    shown = Result("wall", "maxon_epos4", "sim", 1000.0).to_json()
    assert {key: value for key, value in shown.items() if value is not None} == known


def test_everything_known_is_in_the_object() -> None:
    times = Percentiles(1.0, 2.0, 3.0, 4.0)
    compiled = plan("wall")
    shown = Result(
        scene="wall",
        drive="maxon_epos4",
        bus="sim",
        rate=1000.0,
        clock="virtual",
        cycles=10,
        missed_cycles=0,
        duration=0.01,
        bus_load=0.3,
        plan=compiled,
        timing=Timing(times, times, times, times, late=2),
        torque_error=TorqueError(0.1, 0.2, "N", {"encoder": 1.0}, 0.02, 0.4),
        energy_generated=math.inf,
        stability=compiled.stability,
        trips=(TripRecord("speed limit", 0.5, "too fast"),),
        verdict="good",
    ).to_json()
    assert shown["energy_generated_j"] is None
    assert shown["trips"] == [{"name": "speed limit", "time_s": 0.5, "message": "too fast"}]
    assert shown["torque_error"] == {
        "rms": 0.1,
        "max": 0.2,
        "unit": "N",
        "by_source": {"encoder": 1.0},
        "contact": 0.02,
        "contact_s": 0.4,
    }
    keys = ("period_us", "age_us", "compute_us", "lateness_us")
    assert shown["timing"] == {**{key: times.to_json() for key in keys}, "late": 2}
    assert json.loads(json.dumps(shown, allow_nan=False)) == shown


@pytest.mark.parametrize(("cycles", "words"), [(None, "0 periods"), (1, "1 period"), (2, "2 periods")])
def test_one_period_is_told_in_the_singular(cycles: int | None, words: str) -> None:
    assert periods_text(Result("wall", "maxon_epos4", "sim", 1000.0, cycles=cycles)) == words


def test_no_number_is_written_that_json_does_not_have() -> None:
    value = finite({"a": [math.nan, 1.0, {"b": -math.inf, "c": True}]})
    assert value == {"a": [None, 1.0, {"b": None, "c": True}]}


def test_the_object_of_a_plan_names_frames_as_they_are_on_the_wire() -> None:
    pdos = plan_json(plan("wall", node=5))["pdos"]
    assert isinstance(pdos, list)
    assert {pdo["bus"] for pdo in pdos if isinstance(pdo, dict)} == {"sim"}
    shown = [(pdo["cob_id"], pdo["octets"], pdo["node"]) for pdo in pdos if isinstance(pdo, dict)]
    assert shown == [(0x185, 8, 5), (0x205, 4, 5)]


@pytest.mark.parametrize("scene", ["wall", "damped_wall", "sprung_mass"])
def test_the_object_of_a_plan_is_json(scene: str) -> None:
    shown = plan_json(plan(scene))
    assert json.loads(json.dumps(shown, allow_nan=False)) == shown


def test_the_bus_load_counts_the_frames_of_other_devices() -> None:
    done = run("wall", duration=0.1)
    assert done.plan is not None
    assert done.bus_load == done.plan.bus_load
    found = load(Task("wall")).plan
    report = LoopReport(foreign_load={"handle": 0.125})
    assert known_before(found, "sim", report).bus_load == pytest.approx(found.bus_load + 0.125)


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("scene", ["wall", "virtual_shaft"])
def test_a_result_shows_its_figures_on_a_part_of_a_screen(scene: str) -> None:
    result = run(scene, duration=1.2)
    shown = repr(result)
    assert len(shown.splitlines()) <= 20
    assert max(map(len, shown.splitlines())) <= WIDEST
    told = (f"scene='{scene}'", "drive='maxon_epos4'", "bus='sim'", "rate=1000.0", "cycles=1200", "missed_cycles=0")
    assert all(f"    {each},\n" in shown for each in told)
    assert "torque_error=TorqueError(rms=" in shown
    assert f"    verdict={result.verdict!r}"[: WIDEST - 1] in shown
    assert "array" not in shown
    assert "Plan(" not in shown


def test_a_result_of_many_trips_is_cut_and_what_is_not_known_is_left_out() -> None:
    trips = (TripRecord("speed limit", 0.5, "axis handle: 1.2 m/s\npassed 1 m/s"),) * 20
    shown = repr(Result("wall", "maxon_epos4", "sim", 1000.0, trips=trips)).splitlines()
    assert [line.partition("=")[0].strip() for line in shown[1:-1]] == ["scene", "drive", "bus", "rate", "trips"]
    assert shown[-2].startswith("    trips=(TripRecord(name='speed limit', time=0.5, message='axis handle: 1.2 m/s")
    assert len(shown[-2]) == WIDEST


def test_a_plan_and_a_response_show_no_tables_and_no_arrays_of_themselves() -> None:
    assert len(repr(plan("wall"))) < 600
    assert len(repr(response("sprung_mass"))) < 200


@pytest.fixture(scope="module")
def finished() -> Result:
    return run("wall", duration=0.7, settings={"wall.position": 0.001})


@pytest.mark.thorough("starts a process that imports all")
def test_a_result_is_copied_and_sent_to_another_process(finished: Result) -> None:
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        sent = pool.submit(run, "wall", duration=0.05).result()
    assert sent.cycles == 50
    for copy in (pickle.loads(pickle.dumps(finished)), deepcopy(finished)):
        assert copy.to_json() == finished.to_json()
        assert copy.provenance == finished.provenance
        assert copy.plot().get_size_inches() == pytest.approx(finished.plot().get_size_inches())


@pytest.mark.parametrize(
    "drive",
    [name for protocol in ("canopen", "modbus") for name in shipped(protocol) if load_profile(name).drive.usable],
)
def test_the_result_of_each_shipped_drive_is_sent_to_another_process(drive: str) -> None:
    """With the codecs of its process image, which differ between the protocols."""
    bus = "sim" if load_profile(drive).drive.protocol == "canopen" else "sim-modbus-rtu@115200"
    finished = run("wall", drive=drive, bus=bus, duration=0.02, settings={"wall.stiffness": "max/2"})
    copy = pickle.loads(pickle.dumps(finished))
    assert copy.to_json() == finished.to_json()
    assert finished.plan is not None
    image = bytes(range(finished.plan.image.input_size))
    assert copy.plan.image.input.unpack(image) == finished.plan.image.input.unpack(image)


@pytest.mark.thorough("plans every scene", quick=("teleoperation", "wall"))
@pytest.mark.parametrize("scene", scene_names())
def test_the_plan_of_each_scene_is_copied(scene: str) -> None:
    compiled = plan(scene)
    copy = pickle.loads(pickle.dumps(compiled))
    assert (copy.scene, copy.stability, copy.mapped) == (compiled.scene, compiled.stability, compiled.mapped)
    assert deepcopy(compiled).image.input.size == compiled.image.input.size


def test_a_trace_becomes_a_table_with_units_and_provenance(finished: Result) -> None:
    table, (trace,) = finished.to_arrow(), finished.traces
    assert {field.name: field.metadata[b"unit"] for field in table.schema} == {
        "time": b"s", "position": b"m", "force": b"N", "ideal": b"N",
    }  # fmt: skip
    assert finished.provenance is not None
    assert json.loads(table.schema.metadata[b"haptic_fieldbus.provenance"]) == json.loads(finished.provenance.text())
    frame = finished.to_frame("handle")
    assert np.array_equal(frame["force"].to_numpy(), trace.force)
    assert np.array_equal(frame["time"].to_numpy(), trace.times)
    with pytest.raises(UsageError, match="axis knob: expected one of handle"):
        finished.to_arrow("knob")
    with pytest.raises(UsageError, match="no traces"):
        Result("wall", "maxon_epos4", "sim", 1000.0).to_arrow()


def test_a_table_of_several_axes_needs_a_name() -> None:
    finished = run("virtual_shaft", duration=0.6)
    with pytest.raises(UsageError, match="expected one of left, right"):
        finished.to_arrow()
    assert finished.to_arrow("right").num_rows > 0


def test_a_notebook_shows_figures_and_picture(finished: Result) -> None:
    text = finished._repr_html_()
    assert "<pre>Result(" in text
    picture = re.search(r"data:image/png;base64,([\w+/=]+)", text)
    assert picture is not None
    assert b64decode(picture[1]).startswith(b"\x89PNG")
    bare = Result("<wall>", "maxon_epos4", "sim", 1000.0)
    assert bare._repr_html_().startswith("<pre>Result(")
    assert "&lt;wall&gt;" in bare._repr_html_()
    with pytest.raises(UsageError, match="nothing to draw"):
        bare.plot()


@pytest.mark.parametrize(("method", "missing", "extra"), [
    ("plot", "matplotlib", "plot"), ("to_arrow", "pyarrow", "data"), ("to_frame", "pandas", "data"),
])  # fmt: skip
def test_a_missing_package_is_named_with_its_extra(
    method: str, missing: str, extra: str, finished: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == missing else found(name))
    with pytest.raises(UsageError, match=rf"this needs {missing}; .*'\.\[{extra}\]'"):
        getattr(finished, method)()
