"""`identify` on simulated benches that differ from their rigs, over CANopen and Modbus."""

import math
import random
import re
import signal
import tomllib
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from haptic_fieldbus.api import identification
from haptic_fieldbus.api.identification import BenchTask, MeasuringLaw, bounds_of, identify
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.documents.edits import Value, with_table
from haptic_fieldbus.drive.rig import MECHANICAL, Rig
from haptic_fieldbus.errors import HapticFieldbusError, PlanError, SafetyTripError, UsageError
from haptic_fieldbus.identification import Announcement, IdentifiedBench
from haptic_fieldbus.identification.experiment import Bounds, Experiment, Probe
from haptic_fieldbus.identification.fit import ENCODER_NOISE, ShaftFit
from haptic_fieldbus.margins import Basis
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load, select
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.running.session import Session, Site
from haptic_fieldbus.sim.mechanics.body import Body

BUSES = {
    "canopen": ("haptic_sim", "bench", 5, "maxon_epos4"),
    "modbus-tcp": ("sim-modbus-tcp", "sim", 1, "generic_cia402_modbus"),
    "modbus-rtu": ("sim-modbus-rtu", "sim", 1, "generic_cia402_modbus"),
}
RIG = """\
# My bench.
[bus.here]
interface = "{interface}"
channel = "{channel}"

[axis.handle]  # the left one
bus = "here"
node = {node}
profile = "{profile}"
rated_torque = 0.4
encoder_counts_per_revolution = {counts}
inertia = 4.0e-5  # with the handle
viscous_damping = 3.0e-4  # a guess
coulomb_friction = 2.0e-3
mechanism = {mechanism}

[axis.handle.limits]
position = {position}
"""
LINEAR = ('{ kind = "linear", metres_per_revolution = 0.05 }', "[-0.1, 0.1]")
GEARED = ('{ kind = "rotary", gear_ratio = 4.0, sign = -1 }', "[-6.0, 6.0]")


def rig_text(*simulation: str, bus: str = "canopen", counts: int = 4096, handle: tuple[str, str] = LINEAR) -> str:
    interface, channel, node, profile = BUSES[bus]
    told = RIG.format(
        interface=interface, channel=channel, node=node, profile=profile, counts=counts, mechanism=handle[0],
        position=handle[1],
    )  # fmt: skip
    return told + "\n".join(["\n[axis.handle.simulation]", *simulation, ""]) if simulation else told


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    return tmp_path / "rig.toml"


def measured(bench: Path, text: str, **words: object) -> IdentifiedBench:
    bench.write_text(text, encoding="utf-8")
    return identify(BenchTask(bench, **words))  # type: ignore[arg-type]


def fit_of(found: IdentifiedBench) -> ShaftFit:
    assert found.fit is not None
    return found.fit


def drawn(seed: int) -> tuple[dict[str, float], str]:
    """A true bench, and the text of a rig that states other values."""
    draw = random.Random(seed)
    true = {
        "inertia": 4e-5 * 3.0 ** draw.uniform(-1.0, 1.0),
        "viscous_damping": 1e-4 * 3.0 ** draw.uniform(-1.0, 1.0),
        "coulomb_friction": 2e-3 * 2.0 ** draw.uniform(-1.0, 1.0),
    }
    counts, bus, handle = draw.choice([1024, 4096, 20_000]), list(BUSES)[seed // 3 % 3], draw.choice([LINEAR, GEARED])
    return true, rig_text(*(f"{key} = {value!r}" for key, value in true.items()), bus=bus, counts=counts, handle=handle)


@pytest.mark.thorough("measures 12 drawn benches over their buses", quick=2)
@pytest.mark.parametrize("seed", range(12))
def test_a_bench_that_differs_from_its_rig_is_measured_over_its_bus(bench: Path, seed: int) -> None:
    true, text = drawn(seed)
    found = measured(bench, text)
    values, announced = fit_of(found).values, found.announced
    assert values["inertia"].value == pytest.approx(true["inertia"], rel=0.05)
    assert values["viscous_damping"].value == pytest.approx(true["viscous_damping"], rel=0.15)
    assert values["coulomb_friction"].value == pytest.approx(true["coulomb_friction"], rel=0.15)
    (axis,) = load(task_on(bench)).plan.axes
    known = axis.delay.transport + axis.delay.torque_loop
    assert values["delay_and_lag"].value == pytest.approx(known, abs=max(1e-4, 0.1 * known))
    ratio = axis.rig.mechanism.ratio
    for record in found.records:
        places = [ratio * each for each in record.positions]
        assert announced.low <= min(places)
        assert max(places) <= announced.high
        assert max(map(abs, record.torques)) / ratio <= announced.effort * (1.0 + 1e-9)
        assert record.top_speed * ratio <= announced.speed
    kept = load_rig(bench).axis["handle"].identified
    assert kept.inertia == pytest.approx(values["inertia"].value, rel=1e-5)
    assert found.written == str(bench)


def task_on(bench: Path) -> Task:
    """A scene for the mechanism of the bench."""
    if load_rig(bench).axis["handle"].mechanism.kind == "rotary":
        return Task("knob_menu", bench, axes={"knob": "handle"})
    return Task("wall", bench)


# The rig file.


@pytest.mark.thorough("measures a bench")
def test_the_rig_keeps_its_comments_and_the_next_plan_rests_on_its_table(bench: Path) -> None:
    """The rig states three times the true damping; the true limit is 1492 N/m, and the stated one would be 4481."""
    text = rig_text("viscous_damping = 1.0e-4")
    found = measured(bench, text)
    after = bench.read_text(encoding="utf-8")
    assert after.startswith(text)
    table = tomllib.loads(after)["axis"]["handle"]["identified"]
    low, high = table["viscous_damping_interval"]
    assert low <= 1e-4 <= high
    assert table["viscous_damping"] == pytest.approx(1e-4, rel=0.01)
    assert any("viscous_damping: the rig states 0.3 mN·m·s/rad" in each for each in found.warnings)
    assert not any("coulomb_friction" in each for each in found.warnings)
    identified, plan = load_rig(bench).axis["handle"].identified, load(Task("wall", bench)).plan
    (axis,) = plan.axes
    assert axis.bench.fault == ""
    assert identified.planned_delay == pytest.approx(axis.delay.transport + axis.delay.torque_loop, rel=1e-5)
    assert identified.serial is None  # that of a simulated drive is drawn
    assert (identified.axis, identified.simulated, axis.bench.is_moved) == ("handle", True, False)
    assert plan.stability is not None
    assert plan.stability.limit.basis is Basis.IDENTIFIED
    assert 0.7 * 1492.0 <= plan.stability.limit.value <= 1492.0


def test_without_dynamics_the_breakaway_is_told_and_nothing_is_written(bench: Path) -> None:
    text = rig_text("coulomb_friction = 5.0e-3")
    found = measured(bench, text, skip=("rest", "dynamics"))
    assert bench.read_text(encoding="utf-8") == text
    assert (found.fit, found.limit, found.written) == (None, None, "")
    assert [each.partition(":")[0] for each in found.warnings] == ["rest", "dynamics"]
    values = found.to_json()["values"]
    assert isinstance(values, dict)
    assert list(values) == ["breakaway_forward", "breakaway_backward"]
    for each in values.values():
        assert each["low"] <= 5e-3 <= each["high"] < 8.5e-3


@pytest.mark.thorough("measures a bench")
def test_an_elastic_bench_is_told_by_its_resonance_and_gets_no_limit(bench: Path) -> None:
    """Of the inertia of 40 mg·m², 14 are behind the spring: ω² = k·J/(J₁·J₂)."""
    motor, load, frequency = 2.6e-5, 1.4e-5, 25.0
    stiffness = (math.tau * frequency) ** 2 * motor * load / (motor + load)
    text = rig_text(f"coupling = {{ stiffness = {stiffness!r}, load_inertia = {load!r}, damping = 2.0e-4 }}")
    earlier: dict[str, Value] = {"inertia": 4e-5, "inertia_interval": [3.9e-5, 4.1e-5], "date": "long ago"}
    found = measured(bench, with_table(text, ("axis", "handle", "identified"), earlier))
    assert (found.limit, found.written) == (None, str(bench))
    values = found.to_json()["values"]
    assert isinstance(values, dict)
    assert values["resonance"]["low"] <= frequency <= values["resonance"]["high"]
    assert any("no limit of a rigid shaft holds" in each for each in found.warnings)
    rig = load_rig(bench)
    axis = rig.axis["handle"]
    assert axis.identified.resonance == pytest.approx(values["resonance"]["value"], rel=1e-3)
    assert [key for key in MECHANICAL if getattr(axis.identified, key) is not None] == []
    assert select(Task("wall", rig)).plan.stability is not None
    unstated = replace(rig, axis={"handle": replace(axis, simulation=replace(axis.simulation, coupling=None))})
    with pytest.raises(PlanError, match=r"identify found a resonance of 2\d\.?\d* Hz"):
        select(Task("wall", unstated))


@pytest.mark.thorough("measures a bench")
def test_without_the_breakaway_the_bench_is_measured_as_well(bench: Path) -> None:
    found = measured(bench, rig_text("coulomb_friction = 5.0e-3"), skip=("friction",))
    values = fit_of(found).values
    assert found.breakaway == {}
    assert values["coulomb_friction"].value == pytest.approx(5e-3, rel=0.02)
    assert values["inertia"].value == pytest.approx(4e-5, rel=0.02)
    assert found.written == str(bench)


@pytest.mark.thorough("measures a bench twice")
@pytest.mark.parametrize("share", [1.0, 0.8])
def test_a_bench_that_is_another_one_in_the_check_is_told(
    bench: Path, monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    """From the check on, the motor gives a share of its torque."""
    given, asked, stage = Body.set_target, Experiment.effort, [""]

    def effort(self: Experiment, position: float) -> float:
        stage[0] = self.stage
        return asked(self, position)

    def set_target(self: Body, torque: float) -> None:
        given(self, torque * share if stage[0] == "check" else torque)

    monkeypatch.setattr(Experiment, "effort", effort)
    monkeypatch.setattr(Body, "set_target", set_target)
    found = measured(bench, rig_text(counts=131_072))
    told = any("but one with other oscillations is predicted to" in each for each in found.warnings)
    assert told == (share < 1.0)
    assert found.check is not None
    assert (found.check > 10.0 * fit_of(found).residual) == told
    assert told or found.check > 2.0 * ENCODER_NOISE, "of an encoder so fine, intervals allow more than its noise"
    assert fit_of(found).values["inertia"].value == pytest.approx(4e-5, rel=0.01)


@pytest.mark.thorough("measures a bench")
def test_the_next_measurement_replaces_the_table(bench: Path) -> None:
    measured(bench, rig_text("viscous_damping = 1.0e-4"))
    identify(BenchTask(bench))
    assert bench.read_text(encoding="utf-8").count("identified]") == 1


@pytest.mark.parametrize(("key", "value"), [("encoder_counts_per_revolution", "1024"), ("rated_torque", "0.2")])
def test_an_earlier_measurement_does_not_hinder_the_next_one(bench: Path, key: str, value: str) -> None:
    text = with_table(rig_text(), ("axis", "handle", "identified"), {"inertia": 1.0, "inertia_interval": [1.0, 1.0],
                                                                     "digest": "another"})  # fmt: skip
    bench.write_text(re.sub(rf"{key} = .*", f"{key} = {value}", text), encoding="utf-8")
    assert bounds_of(BenchTask(bench)).effort > 0.0


@pytest.mark.thorough("measures a bench")
def test_a_rig_that_cannot_be_written_is_told_with_the_table(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "it is read-only")

    monkeypatch.setattr("haptic_fieldbus.documents.edits.edit_file", refuse)
    found = measured(bench, rig_text())
    assert found.written == ""
    assert "not saved" in found.warnings[-1]
    assert "it is read-only" in found.warnings[-1]
    assert "[axis.handle.identified]\ninertia = " in found.warnings[-1]


@pytest.mark.thorough("measures a bench")
def test_a_limit_that_cannot_be_computed_loses_no_value(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stability(*_: object, **more: object) -> object:
        raise PlanError("the reason")

    bench.write_text(rig_text(), encoding="utf-8")
    monkeypatch.setattr(identification, "stability", stability)
    found = identify(BenchTask(bench))
    assert (found.written, found.limit, found.warnings[-1]) == (str(bench), None, "no limit is known: the reason")
    assert "[axis.handle.identified]" in bench.read_text(encoding="utf-8")


@pytest.mark.thorough("measures a bench")
@pytest.mark.parametrize("asked", [{"bus": "sim"}, {"write": False}])
def test_a_bench_on_another_bus_is_not_written_into_the_rig(bench: Path, asked: dict[str, object]) -> None:
    bench.write_text(rig_text(), encoding="utf-8")
    write = bool(asked.pop("write", True))
    found = identify(BenchTask(bench, **asked), write=write)  # type: ignore[arg-type]
    assert found.written == ""
    assert bench.read_text(encoding="utf-8") == rig_text()


# What is announced, and what is refused.


def test_what_will_move_is_announced_before_anything_is_opened(bench: Path) -> None:
    bench.write_text(rig_text(), encoding="utf-8")
    announced: list[Announcement] = []

    class NotYetError(Exception):
        pass

    def stop(told: Announcement) -> None:
        announced.append(told)
        raise NotYetError

    with pytest.raises(NotYetError):
        identify(BenchTask(bench, travel=0.04, effort=3.0, speed=0.1), announce=stop)
    assert announced == [bounds_of(BenchTask(bench, travel=0.04, effort=3.0, speed=0.1))]
    lines = " ".join(announced[0].lines())
    for part in ("-0.02 m to 0.02 m", "3 N", "0.09 m/s", "% of rated torque", "keep hands off"):
        assert part in lines


def test_the_bounds_of_a_task_stay_inside_those_of_the_rig(bench: Path) -> None:
    bench.write_text(rig_text().replace("[-0.1, 0.1]", "[-0.02, 0.06]\neffort = 2.0\nspeed = 0.3"), encoding="utf-8")
    wide = bounds_of(BenchTask(bench, travel=5.0, effort=500.0, speed=50.0))
    assert (wide.low, wide.high, wide.effort, wide.speed) == pytest.approx((-0.02, 0.06, 2.0, 0.3))
    narrow = bounds_of(BenchTask(bench, travel=0.02))
    assert (narrow.low, narrow.high) == pytest.approx((-0.01, 0.01)), "around the handle, which is at 0 then"
    assert "it can go 0.02 m back and 0.06 m ahead" in next(wide.lines())
    far = bounds_of(BenchTask(bench, travel=0.07))
    assert (far.low, far.high) == pytest.approx((-0.02, 0.05))


def test_a_travel_from_an_encoder_zero_is_around_the_middle_of_the_limits(bench: Path) -> None:
    text = rig_text().replace("0.05 }", "0.05, zero = 7 }").replace("[-0.1, 0.1]", "[0.0, 0.1]")
    bench.write_text(text, encoding="utf-8")
    told = bounds_of(BenchTask(bench, travel=0.02))
    assert (told.low, told.high) == pytest.approx((0.04, 0.06))


@pytest.mark.parametrize("limits", ["[0.0, 0.1]", "[-0.1, 0.0]", "[-0.004, 0.1]"])
def test_a_handle_that_begins_at_an_end_of_its_travel_is_refused(bench: Path, limits: str) -> None:
    bench.write_text(rig_text().replace("[-0.1, 0.1]", limits), encoding="utf-8")
    with pytest.raises(UsageError, match="expected room to both sides"):
        bounds_of(BenchTask(bench))


@pytest.mark.thorough("measures a bench whose handle is near an end of its travel")
def test_a_handle_that_begins_beside_the_middle_is_measured(bench: Path) -> None:
    found = measured(bench, rig_text().replace("[-0.1, 0.1]", "[-0.02, 0.06]"))
    assert fit_of(found).values["inertia"].value == pytest.approx(4e-5, rel=0.02)
    assert max(0.05 / (2.0 * math.pi) * abs(each) for record in found.records for each in record.positions) < 0.06


@pytest.mark.parametrize(
    ("old", "new", "words", "complaint"),
    [
        ("", "", {"axis": "knob"}, "expected an axis of the rig: handle"),
        ("", "", {"travel": -1.0}, "--travel -1.0: expected a number above 0"),
        ("", "", {"effort": 0.0}, "--effort 0.0: expected a number above 0"),
        ("0.05 }", "0.05, zero = 7 }\nrated_current = 8.0", {}, ""),
        ("[axis.handle.limits]\nposition = [-0.1, 0.1]", "", {}, ""),
    ],
)
def test_a_request_that_contradicts_its_rig_is_refused(
    bench: Path, old: str, new: str, words: dict[str, object], complaint: str
) -> None:
    bench.write_text(rig_text().replace(old, new) if old else rig_text(), encoding="utf-8")
    if not complaint:
        assert bounds_of(BenchTask(bench, **words)).speed > 0.0  # type: ignore[arg-type]
        return
    with pytest.raises(UsageError, match=complaint.replace("(", r"\(")):
        bounds_of(BenchTask(bench, **words))  # type: ignore[arg-type]


def test_an_encoder_zero_without_position_limits_is_refused(bench: Path) -> None:
    text = rig_text().replace("0.05 }", "0.05, zero = 7 }").replace("position = [-0.1, 0.1]", "")
    bench.write_text(text, encoding="utf-8")
    with pytest.raises(UsageError, match=r"state limits\.position"):
        bounds_of(BenchTask(bench))


def test_one_of_several_axes_must_be_named(bench: Path) -> None:
    second = rig_text().partition("[axis.handle]")[2].replace("node = 5", "node = 6").replace("handle", "other")
    bench.write_text(f"{rig_text()}\n[axis.other]{second}", encoding="utf-8")
    with pytest.raises(UsageError, match="several axes; name one with --axis: handle, other"):
        bounds_of(BenchTask(bench))
    assert bounds_of(BenchTask(bench, axis="other")).axis == "other"


def test_a_travel_without_limits_is_a_turn_of_the_motor_or_that_of_the_task(bench: Path) -> None:
    bench.write_text(rig_text().replace("position = [-0.1, 0.1]", ""), encoding="utf-8")
    turn, asked = bounds_of(BenchTask(bench)), bounds_of(BenchTask(bench, travel=0.02))
    assert (turn.low, turn.high) == pytest.approx((-0.025, 0.025))
    assert (asked.low, asked.high) == pytest.approx((-0.01, 0.01))


# What ends a measurement: torque is off, the rig is as it was.


@pytest.mark.parametrize(
    ("truth", "words", "error", "complaint"),
    [
        ("gravity = { torque = 0.005 }", {}, SafetyTripError, "moves while no effort acts on it"),
        ("coulomb_friction = 0.2", {}, PlanError, "motor direction not confirmed"),
        ("torque_bandwidth = 30", {}, HapticFieldbusError, "set-points do not act"),
    ],
)
def test_a_bench_that_cannot_be_measured_is_told_and_left_alone(
    bench: Path, truth: str, words: dict[str, object], error: type[HapticFieldbusError], complaint: str
) -> None:
    with pytest.raises(error, match=complaint):
        measured(bench, rig_text(truth), **words)
    assert bench.read_text(encoding="utf-8") == rig_text(truth)


def test_a_probe_that_tells_no_inertia_leads_no_motion(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haptic_fieldbus.api.identification.LEADING_SHARE", 0.0)
    with pytest.raises(SafetyTripError, match="too few counts of its encoder to tell its inertia; torque is off"):
        measured(bench, rig_text())
    assert bench.read_text(encoding="utf-8") == rig_text()


@pytest.mark.thorough("measures three benches of few counts")
@pytest.mark.parametrize("counts", [24, 128, 512])
def test_a_coarse_encoder_is_enough_for_inertia_and_friction(bench: Path, counts: int) -> None:
    values = fit_of(measured(bench, rig_text(counts=counts))).values
    assert values["inertia"].value == pytest.approx(4e-5, rel=0.1)
    assert values["coulomb_friction"].value == pytest.approx(2e-3, rel=0.15)
    assert values["viscous_damping"].value == pytest.approx(3e-4, rel=0.15)


@pytest.mark.thorough("measures a bench")
def test_samples_that_are_missing_too_often_end_it(bench: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, counter = identification.conduct, iter(range(1_000_000))

    def gappy(session: Session, place: AbstractContextManager[Site], watch: Callable[[Session], bool]) -> Session:
        return whole(session, place, lambda present: next(counter) % 20 != 7 and watch(present))

    monkeypatch.setattr(identification, "conduct", gappy)
    with pytest.raises(SafetyTripError, match=r"of the samples are missing; torque is off. Free computer and bus"):
        measured(bench, rig_text())


@pytest.mark.thorough("measures a bench")
def test_a_bench_of_unknown_inertia_is_measured(bench: Path) -> None:
    text = rig_text("coulomb_friction = 3.0e-3").replace("inertia = 4.0e-5  # with the handle\n", "")
    text = text.replace("viscous_damping = 3.0e-4  # a guess\n", "").replace("coulomb_friction = 2.0e-3\n", "")
    found = measured(bench, text)
    assert fit_of(found).values["inertia"].value == pytest.approx(4e-5, rel=0.01)
    assert fit_of(found).values["coulomb_friction"].value == pytest.approx(3e-3, rel=0.05)
    assert set(found.stated.values()) == {None}


@pytest.mark.thorough("measures a bench")
def test_a_rig_made_in_python_is_measured_and_nothing_is_written(bench: Path) -> None:
    bench.write_text(rig_text(), encoding="utf-8")
    known = load_rig(bench)
    found = identify(BenchTask(Rig(known.bus, known.axis)))
    assert found.written == ""
    assert found.to_json()["written"] is None


def test_what_analyses_a_simulated_run_does_not_step_the_experiment() -> None:
    """Before, the analysis of a part of 15,000 periods called the law once for each of its instants, mid-run."""
    experiment = Probe(Bounds(1e-3, 1e-5, -1.0, 1.0, 2.0, 0.1, math.inf))
    law = MeasuringLaw("handle", experiment, 0.1).begin(1e-3)
    assert law(0.3) == 0.0
    assert experiment._places == []
    experiment.armed = True
    assert [law(place) for place in (0.1, 0.2, 0.3)] == [0.0, 0.0, 0.0]
    assert experiment._places == [0.1]


def raised() -> None:
    raise ZeroDivisionError


@pytest.mark.parametrize(
    ("act", "error"), [(raised, ZeroDivisionError), (partial(signal.raise_signal, signal.SIGINT), KeyboardInterrupt)]
)
def test_what_ends_a_measurement_in_the_code_of_its_caller_is_heard_when_the_motor_is_off(
    act: Callable[[], None], error: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error is kept here, and with it all that its traceback keeps alive."""
    rig, released, before = tmp_path / "rig.toml", list[bool](), signal.getsignal(signal.SIGINT)
    rig.write_text(rig_text(), encoding="utf-8")
    whole = CanopenBus.release

    def release(self: CanopenBus) -> None:
        released.append(True)
        whole(self)

    def told(stage: str) -> None:
        if stage == "breakaway":
            released.clear()  # the run that looks at the bench is over
            act()

    monkeypatch.setattr(CanopenBus, "release", release)
    with pytest.raises(error) as kept:
        identify(BenchTask(rig, rate=250.0), progress=told)
    assert released
    assert signal.getsignal(signal.SIGINT) is before
    assert kept.value.__traceback__ is not None
