"""Rights that a run in real time requests from the system: each as the system itself tells it, all put back."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_fieldbus.running import rights
from haptic_fieldbus.running.rights import PRIORITY, TIMER_SLACK_NS, WorkAside, processor_of, real_time

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="asks Linux")

ME = Path("/proc/self")


def status(name: str) -> str:
    return next(line.split(":")[1].strip() for line in (ME / "status").read_text().splitlines() if name in line)


STATE: dict[str, Callable[[], object]] = {
    "scheduling": lambda: (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority),
    "processor": lambda: os.sched_getaffinity(0),
    "memory": lambda: status("VmLck"),
    "timer_slack": lambda: (ME / "timerslack_ns").read_text(),
    "idle_states": lambda: [link for link in (ME / "fd").iterdir() if link.resolve() == rights.IDLE_STATES],
}


def test_what_is_granted_is_there_and_is_put_back() -> None:
    before = {name: told() for name, told in STATE.items()}
    with real_time() as got:
        granted = {right.name for right in got if right.granted}
        within = {name: told() for name, told in STATE.items()}
    assert {right.name for right in got} == set(STATE)
    assert {name: told() for name, told in STATE.items()} == before
    assert "timer_slack" in granted, "that needs no right"
    assert int(str(within["timer_slack"])) <= TIMER_SLACK_NS  # 0 at SCHED_FIFO, where there is none
    if "scheduling" in granted:
        assert within["scheduling"] == (os.SCHED_FIFO, PRIORITY)
        assert 40 <= PRIORITY < 50, "above other real-time work, below the interrupt threads of Linux"
    if "memory" in granted:
        assert within["memory"] != "0 kB"
    for name in set(STATE) - granted:
        assert within[name] == before[name]


def test_the_timer_slack_is_one_nanosecond_without_a_real_time_class_too() -> None:
    """0 would mean the default of 50 µs (PR_SET_TIMERSLACK(2const))."""
    before = STATE["timer_slack"]()
    with rights.requested(rights._timer_slack) as (right,):
        assert right.granted
        assert int(str(STATE["timer_slack"]())) == 1
    assert STATE["timer_slack"]() == before


def test_an_error_inside_puts_everything_back_too() -> None:
    before = {name: told() for name, told in STATE.items()}
    with pytest.raises(KeyboardInterrupt), real_time():
        raise KeyboardInterrupt
    assert {name: told() for name, told in STATE.items()} == before


def test_a_refusal_says_what_to_do_and_every_name_is_told_once() -> None:
    with real_time() as got:
        pass
    assert len({right.name for right in got}) == len(got)
    for right in got:
        assert right.granted == (right.got != right.wished or right.granted)
        if right.name in ("scheduling", "memory"):
            assert right.granted or {"rtprio", "memlock"} <= set(right.advice.split())


WITHOUT = """
import os, resource, json
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))
if os.getuid() == 0:
    os.setresgid(65534, 65534, 65534)
    os.setresuid(65534, 65534, 65534)
with real_time() as got:
    print(json.dumps([right.to_json() for right in got]), os.sched_getscheduler(0))
"""


@pytest.mark.thorough("a process without rights")
def test_a_user_without_rights_is_refused_with_advice_and_goes_on() -> None:
    code = f"from haptic_fieldbus.running.rights import real_time{WITHOUT}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *objects, scheduler = done.stdout.rsplit(maxsplit=1)
    assert scheduler == str(os.SCHED_OTHER)
    assert '"name": "scheduling", "wished": "SCHED_FIFO 49", "got": "normal scheduling", "granted": false' in objects[0]
    assert objects[0].count("rtprio") == 2
    assert "setcap cap_sys_nice,cap_ipc_lock+ep" in objects[0]


class TestProcessor:
    def test_a_choice_that_somebody_has_made_stays(self) -> None:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(before)})
        try:
            with real_time() as got:
                assert os.sched_getaffinity(0) == {min(before)}
        finally:
            os.sched_setaffinity(0, before)
        assert next(right.got for right in got if right.name == "processor") == f"processor {min(before)}"

    @pytest.mark.parametrize(
        ("allowed", "count", "chosen"),
        [({0}, 1, None), ({0, 1}, 2, None), ({0, 1, 2, 3}, 4, 3), (set(range(64)), 64, 63), ({2, 3}, 4, None)],
        ids=["one", "two", "four", "many", "chosen by somebody"],
    )
    def test_one_of_many_is_taken_and_none_of_few(self, allowed: set[int], count: int, chosen: int | None) -> None:
        assert processor_of(allowed, count) == chosen

    def test_drives_that_are_simulated_beside_a_loop_are_not_pinned(self) -> None:
        before = os.sched_getaffinity(0)
        with real_time(pinned=False) as got:
            assert os.sched_getaffinity(0) == before
        assert "processor" not in {right.name for right in got}


def test_a_real_time_class_that_is_there_already_stays() -> None:
    if (limit := os.sched_get_priority_max(os.SCHED_FIFO)) < PRIORITY:
        pytest.skip(f"this system has priorities to {limit}")
    before, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(7))
    except PermissionError:
        pytest.skip("this user may not have a real-time class")
    try:
        with real_time() as got:
            assert (os.sched_getscheduler(0), os.sched_getparam(0).sched_priority) == (os.SCHED_RR, 7)
        assert next(right.got for right in got if right.name == "scheduling") == "SCHED_RR 7"
    finally:
        os.sched_setscheduler(0, before, priority)


class Clock:
    """A clock that moves while something sleeps or works [s]."""

    def __init__(self) -> None:
        self.time = 100.0

    def monotonic(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds


def test_work_beside_the_loop_begins_at_once_and_then_rests(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rights, "time", clock := Clock())
    began: list[float] = []

    def work(seconds: float) -> None:
        began.append(clock.time)
        clock.sleep(seconds)
        if len(began) == 2:
            raise ZeroDivisionError

    aside = WorkAside()
    aside.do(lambda: work(0.01))
    with pytest.raises(ZeroDivisionError):
        aside.do(lambda: work(2.0))
    aside.do(lambda: work(0.01))
    clock.sleep(1.0)
    aside.do(lambda: work(0.01))
    assert began == pytest.approx([100.0, 100.1, 102.6, 103.61]), "nine times as long as it took, at most 0.5 s"
