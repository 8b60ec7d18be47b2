"""A session beside the run that it cuts open, and every way to leave it: torque-free."""

import copy
import dis
import math
import os
import pickle
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Thread
from threading import enumerate as enumerate_threads
from types import CodeType, FrameType
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus import (
    LiveSession,
    PlanError,
    SafetyTripError,
    UnstableSceneError,
    UsageError,
    load_rig,
    repeat,
    run,
    session,
)
from haptic_fieldbus.api.session import EFFORT
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.running.rights import WorkAside
from haptic_fieldbus.sim.faults import DriveFault
from tests.running.guard_bench import drives_behind, rig_text

ENABLED, RELEASED = b"0F00", b"0000"
"""Controlwords in the RPDO of the reference drive: operation enabled, and without voltage."""


def rpdos(record: Path) -> list[bytes]:
    """The octets of each RPDO of node 1 in a candump file."""
    return re.findall(rb" 201#(\w+)", record.read_bytes())


def ends_torque_free(record: Path) -> bool:
    """Whether torque was on, and the last set-points are 0 without operation enabled."""
    sent = rpdos(record)
    return any(each.startswith(ENABLED) for each in sent) and sent[-1][4:8] == RELEASED and sent[-1][:4] != ENABLED


@pytest.fixture
def usual_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.thorough("runs each kind twice", quick=("wall", "virtual_shaft"))
@pytest.mark.parametrize("scene", ["wall", "virtual_shaft", "damped_wall", "sprung_mass"])
def test_the_frames_are_those_of_a_run(scene: str, tmp_path: Path) -> None:
    told = run(scene, duration=0.3, record=tmp_path / "a.log")
    with session(scene, duration=0.3, record=tmp_path / "b.log") as live:
        states = list(live)
    assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes()
    assert live.result is not None
    assert live.result.verdict == told.verdict
    assert len(states) == told.cycles == 300
    assert [state.time for state in states[:3]] == pytest.approx([0.0, 0.001, 0.002])


def test_a_state_says_what_the_period_did() -> None:
    with session("damped_wall", duration=0.7, settings={"wall.position": 0.001}) as live:
        states = list(live)
    last = states[-1]
    assert last.drive is PowerState.OPERATION_ENABLED
    assert last.lateness == 0.0
    assert last.position > 0.001
    assert last.effort < 0.0
    assert last.given == pytest.approx(last.effort, abs=0.1)
    speed = (last.position - states[-11].position) / 0.010
    assert last.velocity == pytest.approx(speed, abs=0.02)
    assert states[0] is not last  # a list of states keeps each of them
    with session("wall", duration=0.01) as live:
        assert next(live).velocity is None


def test_several_axes_have_names() -> None:
    with session("virtual_shaft", duration=0.01) as live:
        state = next(live)
        assert set(state.axes) == {"left", "right"}
        with pytest.raises(UsageError, match=r"state\.axes\['left'\]"):
            _ = state.position


def test_a_pause_between_two_periods_changes_nothing(tmp_path: Path) -> None:
    """As of a breakpoint: another run goes through meanwhile, and takes the time that it takes."""
    run("wall", duration=0.02, record=tmp_path / "a.log")
    with session("wall", duration=0.02, record=tmp_path / "b.log") as live:
        for state in live:
            if state.time == pytest.approx(0.01):
                run("wall", duration=0.02, seed=5)
    assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes()


def by_break(live: LiveSession) -> None:
    for state in live:
        if state.time > 0.02:
            break


def by_stop(live: LiveSession) -> None:
    for state in live:
        if state.time > 0.02:
            live.stop()


def by_a_signal(live: LiveSession) -> None:
    for state in live:
        if state.time > 0.02:
            signal.raise_signal(signal.SIGINT)


def by_a_generator(live: LiveSession) -> None:
    def inside() -> Generator[float, None, None]:
        with live:
            for state in live:
                yield state.time

    states = inside()
    while next(states) < 0.02:
        pass
    states.close()


@pytest.mark.usefixtures("usual_handler")
@pytest.mark.parametrize("leave", [by_break, by_stop, by_a_signal, by_a_generator])
def test_however_the_block_is_left_the_drive_is_torque_free(
    leave: Callable[[LiveSession], None], tmp_path: Path
) -> None:
    live = session("wall", record=tmp_path / "a.log")
    if leave is by_a_generator:
        leave(live)
    else:
        with live:
            leave(live)
    assert ends_torque_free(tmp_path / "a.log")
    assert live.result is not None
    assert live.result.cycles in (21, 22)
    assert (live.result.stopped is not None) == (leave is by_a_signal)
    if live.result.stopped is not None:
        assert live.result.stopped.message == "stopped by you at 0.0 s"
    with pytest.raises(StopIteration):
        next(live)
    repeat(tmp_path / "a.log", record=tmp_path / "b.log")
    assert (tmp_path / "a.log").read_bytes() == (tmp_path / "b.log").read_bytes()


@pytest.mark.parametrize("error", [ZeroDivisionError("mine"), SystemExit(3), UsageError("mine")])
def test_an_error_in_the_block_ends_it_torque_free_and_passes(error: BaseException, tmp_path: Path) -> None:
    live = session("wall", record=tmp_path / "a.log")

    def fail() -> None:
        with live:
            for state in live:
                if state.time > 0.02:
                    raise error

    with pytest.raises(type(error)) as raised:
        fail()
    assert raised.value is error
    assert ends_torque_free(tmp_path / "a.log")
    assert live.result is None


def test_nothing_is_enabled_before_the_first_step(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="inside its block"):
        next(session("wall", record=tmp_path / "a.log"))
    with session("wall", record=tmp_path / "a.log") as live:
        pass
    assert live.result is not None
    assert live.result.cycles in (None, 0)
    assert rpdos(tmp_path / "a.log") == []
    with pytest.raises(UsageError, match="has been used"), live:
        pass


def test_a_change_is_made_as_by_run(tmp_path: Path) -> None:
    run("wall", duration=0.2, record=tmp_path / "a.csv", changes=[(0.05, {"wall.stiffness": 300.0})], hand="none",
        settings={"wall.position": 0.0})  # fmt: skip
    with session("wall", duration=0.2, record=tmp_path / "b.csv", hand="none", settings={"wall.position": 0.0}) as live:
        for state in live:
            if state.time == pytest.approx(0.049):
                live.set("wall.stiffness", 300.0)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert live.result is not None
    assert [change.settings for change in live.result.changes] == [{"wall.stiffness": 300.0}]
    repeat(tmp_path / "b.csv", record=tmp_path / "c.csv")
    assert (tmp_path / "b.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()


def test_a_change_of_a_memory_is_tried_in_a_repeated_run_from_the_same_instant(tmp_path: Path) -> None:
    change = [(0.05, {"sprung_mass.stiffness": 150.0})]
    made = run("sprung_mass", duration=0.3, record=tmp_path / "a.csv", changes=change, hand="guide")
    assert [each.time for each in made.changes] == [pytest.approx(0.05 + 0.101)], "a ramp later"
    again = repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert again.changes == made.changes
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()


def test_a_change_that_is_refused_leaves_the_session_running() -> None:
    with session("wall", duration=0.05) as live:
        next(live)
        with pytest.raises(UnstableSceneError):
            live.set("wall.stiffness", 5000.0)
        assert len(list(live)) == 49
    with pytest.raises(UsageError, match="while it runs"):
        live.set("wall.stiffness", 300.0)


def test_another_thread_judges_the_changes_of_a_real_bus() -> None:
    """Here in virtual time: it goes on until the other thread has judged."""
    with session("wall") as live:
        next(live)
        live._judging, live._aside = ThreadPoolExecutor(1), WorkAside()
        asked = live.set("wall.stiffness", 300.0)
        for _ in live:
            if asked.done() and live._run is not None and live._run.report.changes:
                break
        refused = live.set("wall.stiffness", 5000.0)
        with pytest.raises(UnstableSceneError):
            list(live)
        assert refused.done()
        next(live)
    assert live.result is not None
    assert [change.settings for change in live.result.changes] == [{"wall.stiffness": 300.0}]


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="asks Linux")
@pytest.mark.thorough("starts processes and waits")
def test_the_thread_that_judges_yields_to_the_loop_and_runs_on_every_processor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bus that the rig calls real, in virtual time; the rights are those of a real run."""
    (rig := tmp_path / "rig.toml").write_text(rig_text(profile="maxon_epos4"), encoding="utf-8")
    monkeypatch.setattr("haptic_fieldbus.api.site.site_of", drives_behind)
    monkeypatch.setattr("haptic_fieldbus.running.rights.MANY", 1)  # the loop takes one processor on each computer
    processors = os.sched_getaffinity(0)
    with session("wall", rig, settings={"wall.stiffness": 200.0}, duration=0.1, yes=True) as live:
        next(live)
        loop = os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.sched_getaffinity(0)
        live.set("wall.stiffness", 210.0).result()
        (judge,) = [each.native_id or 0 for each in enumerate_threads() if "judging" in each.name]
        found = os.sched_getscheduler(judge), os.sched_getparam(judge).sched_priority, os.sched_getaffinity(judge)
    assert found[2] == processors
    if loop[0] != os.SCHED_FIFO:
        pytest.skip("this system grants no SCHED_FIFO")
    assert found == (loop[0], loop[1] - 1, processors)


def test_what_only_a_simulated_bench_can_do_is_refused_on_a_real_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (rig := tmp_path / "rig.toml").write_text(rig_text(profile="maxon_epos4"), encoding="utf-8")
    monkeypatch.setattr("haptic_fieldbus.api.site.site_of", drives_behind)
    asked: dict[str, Any] = {"settings": {"wall.stiffness": 200.0}, "duration": 0.05, "confirm": lambda question: True}
    with pytest.raises(UsageError, match=r"^hand and faults: only for a simulated bench, and .* is a real bus"):
        run("wall", rig, hand="push", faults="random@12", **asked)
    with pytest.raises(UsageError, match=r"^faults: only for a simulated bench"):
        run("wall", rig, faults=[DriveFault("drive_fault", at=0.01)], **asked)
    assert run("wall", rig, hand="none", faults=[], **asked).cycles


def test_progress_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    run("wall", duration=0.2, progress=True)
    shown = capsys.readouterr().err
    assert shown.startswith("\r 50%, ")
    assert shown.endswith(" s left \n")
    run("wall", duration=0.2, progress=False)
    assert capsys.readouterr().err == ""


# A function of one's own in the place of a scene.


def spring(feedback: Any) -> float:
    return -200.0 * feedback.position - 2.0 * feedback.velocity  # type: ignore[no-any-return]


def test_a_function_of_ones_own_is_rendered() -> None:
    needs = ("velocity", "position", "time")
    with session(effort=spring, needs=needs, stiffness=200.0, damping=2.0, duration=2.0) as live:
        *_, last = live
    assert last.effort == pytest.approx(-200.0 * last.position - 2.0 * (last.velocity or 0.0))
    assert live.result is not None
    # The hand pushes with 6 N, and Coulomb friction of the shipped bench takes up to 0.25 N.
    assert 200.0 * last.position == pytest.approx(6.0, abs=0.3)
    assert live.result.verdict is not None
    assert live.result.verdict.startswith("Feels right")


def test_a_function_of_the_torque_has_no_known_error_and_is_not_called_free_of_contact() -> None:
    """It gets the torque of the drive in the workspace, which follows the set-point of the period before."""
    felt: list[float] = []

    def damped(feedback: Any) -> float:
        felt.append(feedback.torque)
        return -200.0 * feedback.position - 2.0 * feedback.velocity  # type: ignore[no-any-return]

    needs = ("position", "velocity", "torque")
    with session(effort=damped, needs=needs, stiffness=200.0, damping=2.0, duration=1.2) as live:
        given = [state.given for state in live]
    assert max(map(abs, given)) > 1.0
    assert felt[-1000:] == pytest.approx(given[-1001:-1])
    result = live.result
    assert result is not None
    assert result.torque_error is None
    assert result.verdict == "Not judged: the scene uses the torque of the drive, so its ideal is unknown"
    assert len(result.traces[0].times) == 1200


def test_the_result_of_a_function_is_copied_and_sent_though_the_function_is_not() -> None:
    with session(effort=lambda feedback: -100.0 * feedback.position, stiffness=100.0, duration=0.7) as live:
        list(live)
    result = live.result
    assert result is not None
    sent = pickle.loads(pickle.dumps(result))
    assert sent.to_json() == result.to_json()
    assert sent.plan.scene.elements[0].stiffness == 100.0
    with pytest.raises(UsageError, match="the function of this effort stayed in its process"):
        sent.plan.scene.elements[0].law(None)
    copied = copy.deepcopy(result).plan
    assert copied is not None
    assert copied.scene.elements == result.plan.scene.elements  # type: ignore[union-attr]
    with session(effort=spring, needs=("position", "velocity"), stiffness=200.0, damping=2.0, duration=0.01) as live:
        list(live)
    assert pickle.loads(pickle.dumps(live.result)).plan.scene.elements[0].law is spring


def test_none_is_no_force() -> None:
    with session(effort=lambda feedback: None, duration=0.3, hand="none") as live:
        assert {state.given for state in live} == {0.0}


def test_what_declares_nothing_gets_a_twentieth_of_rated_torque() -> None:
    with session(effort=lambda feedback: -500.0 * feedback.position, duration=0.9) as live:
        given = [abs(state.given) for state in live]
    # The shipped bench: 0.4 N·m, 0.05 m a revolution.
    assert max(given) == pytest.approx(0.05 * 0.4 * 2 * math.pi / 0.05, rel=0.02)


def test_a_function_that_declares_too_much_is_refused() -> None:
    with pytest.raises(UnstableSceneError), session(effort=spring, needs=("position", "velocity"), stiffness=1e5):
        pass


def test_not_a_number_and_an_error_trip() -> None:
    def wrong(feedback: Any) -> float:
        return math.nan if feedback.time > 0.01 else 0.0

    with (
        pytest.raises(SafetyTripError, match="finite"),
        session(effort=wrong, needs=("time",)) as live,
    ):
        list(live)

    def fails(feedback: Any) -> float:
        raise RuntimeError("mine")

    with pytest.raises(SafetyTripError, match="RuntimeError: mine"), session(effort=fails) as live:
        list(live)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({}, UsageError, "either a scene or effort="),
        ({"scene": "wall", "effort": spring}, UsageError, "either a scene or effort="),
        ({"effort": 3}, TypeError, "session() effort: expected a function"),
        ({"effort": spring, "needs": ("speed",)}, TypeError, "session() needs: expected some of position, velocity"),
        ({"effort": spring, "needs": 5}, TypeError, "session() needs: expected some of position, velocity"),
        ({"effort": spring, "needs": [["position"]]}, TypeError, "session() needs: expected some of position"),
        ({"effort": spring, "stiffness": True}, TypeError, "session() stiffness: expected a number of 0 or more"),
        ({"effort": spring, "stiffness": -1.0}, TypeError, "session() stiffness: expected a number of 0 or more"),
        ({"scene": "wall", "duration": "1"}, TypeError, "session() duration: expected a number in s"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=re.escape(message)):
        session(**arguments)


def test_an_effort_declares_numbers_of_numpy_too() -> None:
    figures: dict[str, Any] = {"stiffness": np.int64(100), "damping": np.float64(1.0)}
    with session(effort=spring, needs=("position", "velocity"), duration=0.01, **figures) as live:
        list(live)


LEAKS = """
import sys
from haptic_fieldbus import session

def states():
    with session("wall", record={record!r}) as live:
        yield from live

{holder}left = states()
while next({holder}left).time < 1.3:
    pass
"""
"""Program that ends with a session open, in contact."""


@pytest.mark.thorough("starts a process", quick=1)
@pytest.mark.parametrize("holder", ["", "sys."], ids=["of the program", "of the interpreter"])
def test_a_session_that_is_open_when_the_interpreter_ends_is_torque_free_and_says_nothing(
    holder: str, tmp_path: Path
) -> None:
    record = tmp_path / "a.log"
    program = LEAKS.format(record=str(record), holder=holder)
    ended = subprocess.run((sys.executable, "-c", program), capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
    assert ends_torque_free(record)


def test_a_function_renders_the_only_axis_of_a_rig(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    axis = """
        [axis.{name}]
        bus = "can"
        node = {node}
        profile = "maxon_epos4"
        rated_torque = 0.4
        encoder_counts_per_revolution = 4096
        inertia = 4e-5
        viscous_damping = 1e-4
        coulomb_friction = 2e-3
        emergency_stop = "power"
        mechanism = {{ kind = "rotary", gear_ratio = 1.0 }}
        limits = {{ speed = 100.0 }}
    """
    bus = '[bus.can]\ninterface = "haptic_sim"\nchannel = "can"\n'
    rig.write_text(bus + axis.format(name="knob", node=3))
    with session(effort=lambda feedback: None, rig=rig, duration=0.01) as live:
        assert set(next(live).axes) == {"knob"}
    rig.write_text(rig.read_text() + axis.format(name="other", node=4))
    with pytest.raises(UsageError, match="renders one axis; the rig has knob, other"):
        session(effort=spring, rig=load_rig(rig))


def test_a_real_bus_needs_a_yes(tmp_path: Path) -> None:
    """It is told before anything is written; here the bench is unknown already."""
    with pytest.raises(PlanError, match="bench"), session("wall", bus="udp_multicast:239.74.163.2@1000000"):
        pass


@pytest.mark.parametrize("given", [{"stiffness": 300.0}, {"damping": 1.0}, {"needs": ("velocity",)}], ids=str)
def test_the_figures_of_an_effort_are_refused_beside_a_scene(given: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match="only with effort=; use settings="):
        session("wall", **given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"scene": "wall", "yes": "no"}, r"session\(\) yes: expected True or False, not 'no'"),
        ({"effort": lambda feedback: 0.0, "rig": 3}, r"session\(\) rig: expected the path of a rig file"),
    ],
)
def test_arguments_of_the_wrong_kind_are_named(given: dict[str, Any], words: str) -> None:
    with pytest.raises(TypeError, match=words):
        session(**given)


def test_a_parameter_that_is_set_has_a_name() -> None:
    with session("wall", duration=0.01) as live:
        next(live)
        with pytest.raises(TypeError, match=r"set\(\) name: expected a name such as wall\.stiffness"):
            live.set(3, 1.0)  # type: ignore[arg-type]


def test_the_advice_for_an_effort_names_the_arguments_of_a_session() -> None:
    with pytest.raises(UnstableSceneError) as refused:
        session(effort=lambda feedback: -1e5 * feedback.position, stiffness=1e5, duration=0.1).__enter__()
    assert re.search(r"(^|\W)stiffness=\d", str(refused.value))
    assert "--set" not in str(refused.value)
    with (
        pytest.raises(SafetyTripError) as failed,
        session(effort=lambda feedback: 1 / 0, stiffness=10.0, duration=0.1) as live,
    ):
        list(live)
    assert "Correct its code." in str(failed.value)
    assert "scenes check" not in str(failed.value)


@pytest.mark.parametrize("name", ["law", "names", "axis"])
def test_only_stiffness_and_damping_of_an_effort_are_parameters(name: str) -> None:
    with session(effort=spring, needs=("velocity", "position"), stiffness=200.0, damping=2.0, duration=0.01) as live:
        next(live)
        with pytest.raises(UsageError, match=f"{EFFORT}.{name}"):
            live.set(f"{EFFORT}.{name}", 1.0)


def interrupting(code: CodeType, at: int, call: int = 30) -> Callable[[FrameType, str, Any], Any]:
    """A trace function that raises SIGINT in front of an instruction of a function, in one of its calls."""
    calls = 0

    def traced(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal calls
        if frame.f_code is not code:
            return None
        frame.f_trace_opcodes = True
        if event == "opcode" and frame.f_lasti == at:
            calls += 1
            if calls == call:
                signal.raise_signal(signal.SIGINT)
        return traced

    return traced


def instructions(function: Callable[..., object]) -> list[tuple[CodeType, int]]:
    """Each instruction of a function in front of which a signal can come."""
    found = [each for each in dis.get_instructions(function) if each.opname not in ("RESUME", "CACHE")]
    return [(function.__code__, each.offset) for each in found if each.offset > 0]


@pytest.mark.thorough("a run for each instruction", quick=("some",))
@pytest.mark.parametrize("apart", [5, 1], ids=["some", "all"])
@pytest.mark.usefixtures("usual_handler")
def test_a_signal_between_two_instructions_of_a_step_ends_it_torque_free(tmp_path: Path, apart: int) -> None:
    """Whichever instruction of `_advance` it follows once torque is on."""
    for code, at in instructions(LiveSession._advance)[::apart]:
        record = tmp_path / f"{at}.log"
        with session("wall", record=record) as live:
            sys.settrace(interrupting(code, at))
            try:
                for state in live:
                    if state.time > 0.05:
                        break
            finally:
                sys.settrace(None)
        assert ends_torque_free(record), at


@pytest.mark.thorough("a run for each instruction", quick=("some",))
@pytest.mark.parametrize("apart", [5, 1], ids=["some", "all"])
@pytest.mark.usefixtures("usual_handler")
def test_a_signal_between_two_instructions_of_the_end_of_the_block_ends_it_torque_free(
    tmp_path: Path, apart: int
) -> None:
    """Whichever instruction of `__exit__`, and of `stop` that it calls, the signal comes in front of."""
    record = tmp_path / "a.log"
    for code, at in [*instructions(LiveSession.__exit__), *instructions(LiveSession.stop)][::apart]:
        live = session("wall", record=record)
        try:
            with live:
                by_break(live)
                sys.settrace(interrupting(code, at, call=1))
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(None)
        assert ends_torque_free(record), (code.co_name, at)


@pytest.mark.usefixtures("usual_handler")
@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs os.fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_steps_no_session() -> None:
    """Both would command one drive, and the bus takes the frames of either for its own."""
    with session("wall", duration=0.01) as live:
        next(live)
        child = os.fork()
        if not child:
            try:
                next(live)
            except UsageError:
                os._exit(0)
            finally:
                os._exit(1)
        _, status = os.waitpid(child, 0)
        assert next(live).time > 0.0
    assert status == 0


def test_another_thread_steps_no_session_and_ends_one_torque_free(tmp_path: Path) -> None:
    refused: list[UsageError] = []

    def step(live: LiveSession) -> None:
        try:
            next(live)
        except UsageError as error:
            refused.append(error)

    with session("wall", duration=0.05) as live:
        (thread := Thread(target=step, args=(live,))).start()
        thread.join()
        assert len(list(live)) == 50
    assert "by the thread that entered its block" in str(refused[0])
    assert live.result is not None

    other = session("wall", record=tmp_path / "a.log").__enter__()
    by_break(other)
    (thread := Thread(target=other.__exit__, args=(None, None, None))).start()
    thread.join()
    assert ends_torque_free(tmp_path / "a.log")
    assert other.result is not None
    with session("wall", duration=0.02) as after:
        assert len(list(after)) == 20, "the next one is as the first"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_all_limits_of_an_undeclared_effort_are_those_of_its_cap() -> None:
    """Its plan holds the rate of change, the pulses and the energies that follow from 5 % of rated torque."""
    with session(effort=lambda state: 0.0, duration=0.01) as live:
        assert live._run is not None
        (axis,) = live._run.plan.axes
    limits = axis.limits
    assert limits.effort == pytest.approx(0.05 * axis.rated_effort)
    assert limits.slew == pytest.approx(limits.effort / 0.005)
    assert limits.unseen <= limits.effort
    assert limits.energy == pytest.approx(5e-3 + limits.effort * axis.resolution)
    assert limits.forgiven == pytest.approx(0.2 * limits.effort * limits.speed)


def test_the_torque_of_a_healthy_drive_is_compared_where_the_scene_asks_for_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The pulses of the direction check before it end sooner than the drive gives their torque."""
    (rig := tmp_path / "rig.toml").write_text(rig_text(profile="maxon_epos4"), encoding="utf-8")
    monkeypatch.setattr("haptic_fieldbus.api.site.site_of", drives_behind)
    off = {"spring.stiffness": 100.0, "spring.position": 0.01}
    told = run("spring", rig, settings=off, duration=1.0, confirm=lambda question: True).verdict
    found = re.search(r"motor torque (\d+) % off target", told or "")
    assert found is not None
    assert int(found[1]) < 20  # of the delay of this drive; with the pulses it was 62


def test_a_run_on_a_simulated_bus_in_the_place_of_a_real_one_is_repeated_with_the_limit_of_the_real_one(
    tmp_path: Path,
) -> None:
    text = rig_text(profile="maxon_epos4")
    (rig := tmp_path / "rig.toml").write_text(text, encoding="utf-8")
    record = tmp_path / "run.csv"
    first = run("wall", rig, bus="sim", settings={"wall.stiffness": 200.0}, duration=0.3, record=record)
    again = repeat(record)
    assert first.stability is not None
    assert again.stability is not None
    assert first.stability.limit == again.stability.limit
    assert first.verdict == again.verdict
    # The limit of a bus that is meant to be simulated has no assumed delay of an adapter.
    (plain := tmp_path / "plain.toml").write_text(re.sub(r'interface = "\w+"', 'interface = "haptic_sim"', text))
    direct = run("wall", plain, settings={"wall.stiffness": 200.0}, duration=0.3).stability
    assert direct is not None
    assert direct.limit.value > first.stability.limit.value
