"""The live view's end in a run, on a simulated drive: a reader in another thread sees the run and commands it.

The threads meet by messages and rows alone; nothing depends on how fast either is.
"""

import contextlib
import csv
import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus import repeat, run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.drive.profile import PowerState
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.running.ending import EndSignals, ended_by_signals
from haptic_fieldbus.running.leading import MOST_STEPS, SimulatedTime
from haptic_fieldbus.running.live import RUN_COLUMNS, Live, _Reader, folder, sockets
from haptic_fieldbus.running.ring import LiveReader, RingReader
from tests.builders import endless_rig, plan_of

LONG = 600.0
"""Duration of a run that its reader ends [s]."""
PATIENCE = 60.0
"""Longest time that a row is waited for [s]."""


def described(plan: Plan, running: Plan) -> dict[str, Any]:
    return {"scene": plan.scene.name, "stiffness": getattr(plan.scene.elements[0], "stiffness", None)}


class Watcher:
    """A reader of a run: its messages one by one, and its rows."""

    def __init__(self, path: Path) -> None:
        self.reader = LiveReader(path)
        self._messages = self.reader.messages()
        self.ring: RingReader | None = None
        self.columns: list[str] = []
        self.ended: dict[str, Any] = {}
        """Last message of the run, once it came."""

    def until(self, name: str) -> Any:
        """Return the content of the next message of a name."""
        return self.message(name)[name]

    def message(self, name: str) -> dict[str, Any]:
        """Return the next message that has a name; raises AssertionError if the run has ended before it."""
        if name in self.ended:
            return self.ended
        for message, fd in () if self.ended else self._messages:
            if fd is not None:
                self.ring = RingReader(fd)
                os.close(fd)
                self.columns = message["hello"]["columns"]
            if "ended" in message:
                self.ended = message
            if name in message:
                return message
            if self.ended:
                break
        raise AssertionError(f"the run ended before it said {name}")

    def row_where(self, column: str, holds: Callable[[float], bool]) -> float:
        """Wait for a row whose value in a column holds."""
        assert self.ring is not None
        place, first, until = self.columns.index(column), 0, time.monotonic() + PATIENCE
        while time.monotonic() < until:
            begin, rows = self.ring.since(first)
            found = [value for value in rows[:, place] if holds(value)]
            if found:
                return float(found[0])
            first = begin + len(rows)
        raise AssertionError(f"no row came in which {column} holds")


@contextmanager
def watched(live: Live, watch: Callable[[Watcher], None]) -> Iterator[None]:
    """Let a thread watch the run in the block; what it raises is raised here, and the run ends with it."""
    wrong: list[BaseException] = []

    def work() -> None:
        watcher = Watcher(live.path)
        try:
            watch(watcher)
        except BaseException as error:
            wrong.append(error)
        watcher.reader.send({"stop": True})
        watcher.until("ended")
        watcher.reader.close()

    thread = Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        live.end({"text": ""})
        thread.join()
    if wrong:
        raise wrong[0]


def run_watched(
    watch: Callable[[Watcher], None], *, described: Callable[[Plan, Plan], dict[str, Any]] = described, **given: Any
) -> Result:
    with Live(described) as live:
        live.time.set(speed=10.0)
        with watched(live, watch):
            # A pointer that goes to the other side may throw the handle beyond the travel of the shipped bench.
            return run("wall", rig=endless_rig("wall"), duration=LONG, live=live, **given)


def enabled(watcher: Watcher) -> None:
    watcher.until("hello")
    watcher.row_where("enabled", lambda value: value == 1.0)


def test_a_reader_sees_the_rows_that_are_recorded(tmp_path: Path) -> None:
    path, seen = tmp_path / "run.csv", []

    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.row_where("t", lambda value: value > 0.1)
        assert watcher.ring is not None
        seen.append(watcher.ring.since(0)[1])

    run_watched(watch, record=path)
    with path.open() as file:
        heading, *lines = csv.reader(file)
    rows = np.array(lines, dtype=float)
    np.testing.assert_array_equal(seen[0][:, : len(heading)], rows[: len(seen[0])])


@pytest.mark.parametrize(("rate", "rows"), [(1000.0, 30_000), (200.0, 6_000), (8000.0, 120_000)])
def test_a_reader_that_looks_away_for_half_a_minute_misses_no_row(rate: float, rows: int) -> None:
    """At rates above 4 kHz it may look away for 120,000 rows. The slot after the last row belongs to the writer."""
    plan = replace(plan_of(), rate=rate)
    with Live(described) as live:
        live.follow(plan, SimpleNamespace(columns=("t_ns",)))  # type: ignore[arg-type]
        assert live.ring is not None
        rest, reader = [0.0] * (live.ring.columns - 1), RingReader(live.ring.fd)
        for number in range(rows - 1):
            live.ring.push((number,), rest)
        assert reader.since(0)[0] == 0
        for number in range(2):
            live.ring.push((number,), rest)
        assert reader.since(0)[0] == 2


def test_a_change_is_made_and_an_unstable_one_is_refused_with_its_limit() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"change": {"wall.stiffness": 900.0}})
        assert watcher.until("changed") == {"wall.stiffness": 900.0}
        watcher.row_where("changes", lambda value: value == 1.0)
        watcher.reader.send({"change": {"wall.stiffness": 90_000.0}})
        refused = watcher.until("refused")
        assert "90000 N/m exceeds the limit of 750 N/m on this bench" in refused
        watcher.reader.send({"change": {"wall.softness": 1.0}})
        assert "no parameter" in watcher.until("refused") or "softness" in refused

    result = run_watched(watch)
    assert [change.settings for change in result.changes] == [{"wall.stiffness": 900.0}]


def test_a_command_of_50_kilobytes_is_one_command() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.socket.sendall(b'{"change": {"wall.stiffness": 900.0}' + b" " * 50_000 + b"}\n")
        assert watcher.until("changed") == {"wall.stiffness": 900.0}

    run_watched(watch)


def in_the_wall(watcher: Watcher) -> None:
    """Pull the handle into the wall, so that a change which moves the wall waits."""
    enabled(watcher)
    watcher.reader.send({"pull": ["handle", 0.03]})
    watcher.row_where("handle.force", lambda value: value < -2.0)


def test_eight_changes_wait_and_a_further_one_is_refused_until_one_has_begun() -> None:
    def watch(watcher: Watcher) -> None:
        in_the_wall(watcher)
        for number in range(8):
            watcher.reader.send({"change": {"wall.position": -0.05 - 0.001 * number}})
            watcher.until("changed")
        later = Watcher(folder() / f"{os.getpid()}.sock")
        assert [each["begun"] for each in later.until("hello")["waiting"]] == [1, 2, 3, 4, 5, 6, 7, 8]
        later.reader.close()
        watcher.reader.send({"change": {"wall.position": -0.06}})
        assert watcher.until("refused") == "8 changes wait; try again when one of them has begun"
        watcher.reader.send({"pull": ["handle", -0.065]})
        watcher.row_where("changes", lambda value: value == 1.0)
        watcher.reader.send({"change": {"wall.position": -0.06}})
        assert watcher.until("changed") == {"wall.position": -0.06}

    assert not run_watched(watch, hand="none").trips


def test_a_page_that_is_opened_while_a_change_waits_is_told_the_scene_in_force() -> None:
    def watch(watcher: Watcher) -> None:
        in_the_wall(watcher)
        seen = []
        for asked in ({"wall.position": -0.05}, {"wall.stiffness": 500.0}):
            watcher.reader.send({"change": asked})
            later = watcher.message("changed")["later"]
            seen.append((later.get("place"), later["parameters"], len(later["waiting"])))
            other = Watcher(folder() / f"{os.getpid()}.sock")
            hello = other.until("hello")
            other.reader.close()
            seen.append((hello["place"], hello["parameters"], len(hello["waiting"])))
            watcher.reader.send({"pull": ["handle", -0.065]})
            watcher.row_where("changes", lambda value: value == 1.0)
        assert seen == [(None, -0.05, 1), (0.02, -0.05, 1), (-0.05, -0.05, 1), (-0.05, -0.05, 1)]

    def places(plan: Plan, running: Plan) -> dict[str, Any]:
        place = getattr(plan.scene.elements[0], "position", None)
        return {"place": place, "parameters": place}

    run_watched(watch, described=places, hand="none")


def test_stop_ends_the_run_as_ctrl_c_does() -> None:
    result = run_watched(enabled)
    assert result.stopped is not None
    assert result.stopped.signal == "SIGINT"
    assert not result.trips


def test_a_pointer_leads_the_handle_into_the_wall_and_lets_go() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"pull": ["handle", 0.03]})
        watcher.row_where("handle.force", lambda value: value < -2.0)
        watcher.reader.send({"pull": ["handle", None]})
        watcher.row_where("handle.position", lambda value: value < 0.02)
        watcher.reader.send({"hand": "push"})
        watcher.row_where("handle.force", lambda value: value < -2.0)

    assert not run_watched(watch, hand="none").trips


def test_the_handle_is_let_go_when_the_reader_that_pulled_it_leaves_and_by_no_other_one() -> None:
    def watch(watcher: Watcher) -> None:
        in_the_wall(watcher)
        for pulls in (False, True):
            other = LiveReader(folder() / f"{os.getpid()}.sock")
            if pulls:
                other.send({"pull": ["handle", 0.03]})
            other.close()
            # The end of the other reader is seen with one of the next answers: on a busy computer not with the second.
            for number in range(200 if pulls else 2):
                watcher.reader.send({"speed": 9.0 + 0.001 * number})
                watcher.until("pace")
                is_let_go = None in live._leading._asked.values() or not live._leading._pulls  # type: ignore[union-attr]
                if is_let_go:
                    break
            let_go.append(is_let_go)

    let_go: list[bool] = []
    with Live(described) as live:
        live.time.set(speed=10.0)
        with watched(live, watch):
            run("wall", duration=LONG, live=live, hand="none")
    assert let_go == [False, True]


WRONG = [
    b'"page": "x"', b'"page": 1e999', b'"steps": 1e999', b'"speed": NaN', b'"speed": [1]', b'"hand": "foot"',
    b'"pull": 5', b'"pull": ["foot", 0.0]', b'"pull": [["handle"], 0.0]', b'"pull": ["handle", NaN]',
    b'"pull": ["handle", -1e999]', b'"pull": ["handle", 1' + b"0" * 400 + b"]", b'"change": {"wall.stiffness": NaN}',
    b'"change": {"wall.stiffness": "1e999"}', b'"change": {"wall.stiffness": ""}',
]  # fmt: skip


def test_a_wrong_value_is_refused_in_a_sentence_and_its_sender_goes_on() -> None:
    """Behind one reader there may be many pages, so it is not left for what one of them sends."""
    said = []

    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        for wrong in WRONG:
            watcher.reader.socket.sendall(b"{" + wrong + b"}\n")
            said.append(watcher.until("refused"))
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        assert watcher.until("changed") == {"wall.stiffness": 700.0}

    result = run_watched(watch)
    assert not result.trips
    assert [change.settings for change in result.changes] in ([{"wall.stiffness": 700.0}], [])
    assert said[3] == "speed NaN: expected a finite number"
    assert said[7] == 'pull ["foot", 0.0]: expected an axis and a place, or null to let go'
    assert said[-1].startswith('wall.stiffness: ""; expected a number')
    assert all("expected" in sentence for sentence in said)


def test_values_of_any_depth_leave_the_thread_of_stop_alive() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        for depth in range(800, 1100, 5):
            other = Watcher(folder() / f"{os.getpid()}.sock")
            with contextlib.suppress(OSError):
                other.reader.socket.sendall(b'{"pull": ' + b"[" * depth + b"]" * depth + b"}\n")
            other.reader.close()
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        watcher.until("changed")

    assert not run_watched(watch).trips


@pytest.mark.parametrize("led", [False, True])
def test_what_a_page_has_changed_is_repeated_and_so_is_the_hand_that_it_led(led: bool, tmp_path: Path) -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        watcher.reader.send({"change": {"wall.position": 0.01}})
        watcher.row_where("changes", lambda value: value == 2.0)
        if led:
            watcher.reader.send({"pull": ["handle", 0.012]})
            watcher.row_where("handle.position", lambda value: value > 0.008)
            watcher.reader.send({"paused": True, "steps": 3, "speed": 5.0})
            watcher.reader.send({"pull": ["handle", 0.03], "paused": False})
            watcher.row_where("handle.position", lambda value: value > 0.0125)
            watcher.reader.send({"pull": ["handle", None]})
            watcher.reader.send({"hand": "push"})
            watcher.reader.send({"pull": ["handle", -0.02]})
            watcher.row_where("handle.position", lambda value: value < -0.015)

    run_watched(watch, record=tmp_path / "a.csv", hand="none" if led else "push")
    again = repeat(tmp_path / "a.csv", record=tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert not any("hand" in each for each in again.warnings)
    assert again.provenance is not None
    # A repetition of the repetition is the same run too.
    repeat(tmp_path / "b.csv", record=tmp_path / "c.csv")
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()
    assert len(again.provenance.conditions.led or ()) >= 3 * led
    assert [change.settings for change in again.changes] == [{"wall.stiffness": 700.0}, {"wall.position": 0.01}]


def test_the_hand_of_a_run_is_told_and_so_is_one_that_a_page_chose() -> None:
    hands = []

    def watch(watcher: Watcher) -> None:
        hands.append(watcher.until("hello")["hand"])
        watcher.reader.send({"hand": "tap"})
        hands.append(watcher.until("pace")["hand"])
        later = Watcher(folder() / f"{os.getpid()}.sock")
        hands.append(later.until("hello")["hand"])
        later.reader.close()

    run_watched(watch, hand="guide")
    assert hands == ["guide", "tap", "tap"]


NONSENSE = [b"nonsense\n", b"[1]\n", b"5\n", b"[" * 60_000 + b"\n", b"x" * 200_000]


@pytest.mark.parametrize("nonsense", NONSENSE, ids=range(len(NONSENSE)))
def test_a_reader_that_sends_no_command_is_left_and_the_run_goes_on(nonsense: bytes) -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        other = Watcher(folder() / f"{os.getpid()}.sock")
        with contextlib.suppress(ConnectionError):
            other.reader.socket.sendall(nonsense)
        with pytest.raises(AssertionError, match="the run ended before"):  # as it looks to who is left
            other.until("never")
        other.reader.close()
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        watcher.until("changed")

    assert not run_watched(watch).trips


def test_a_run_without_its_page_ends_where_one_is_required() -> None:
    with Live(described, required=True) as live:
        reader = LiveReader(live.path)
        reader.send({"page": 0.0})
        result = run("wall", duration=LONG, live=live)
        assert live.lost
        reader.close()
    assert result.stopped is not None
    assert result.stopped.signal == "SIGHUP"


def test_the_age_of_an_answer_counts_and_an_older_one_takes_nothing_back() -> None:
    with Live(described, required=True) as live:
        reader = _Reader(live._listener)
        live._obey(reader, "page", 1.5)
        assert not live._shown.is_set()
        live._obey(reader, "page", 0.4)
        assert live._shown.is_set()
        live._ending, now = EndSignals(), time.monotonic()
        live._page_seen = now - 100.0
        live._obey(reader, "page", 3.0)
        assert live._page_seen == pytest.approx(now - 3.0, abs=1.0)
        seen = live._page_seen
        live._obey(reader, "page", 200.0)
        assert live._page_seen == seen
        assert live._patience() == 0.0, "it is lost, and the thread looks at once"


def test_simulated_time_stands_still_goes_on_by_whole_periods_and_waits_for_no_pace_at_the_end() -> None:
    time = SimulatedTime()
    time.period_ns = 2_000_000
    time.set(paused=True, steps=1)
    time.set(paused=True, steps=1)
    # Two periods, however often the world waits in them.
    assert [time.sleep_until(at) for at in (1_000_000, 2_000_000, 3_500_000, 4_000_000)] == [0] * 4
    assert time._ahead_ns(4_000_001) == math.inf
    time.set(steps=-3)
    assert time._ahead_ns(4_000_001) == math.inf
    time.leaving = lambda: True
    assert time.sleep_until(10**15) == 0
    assert time.now_ns() == 10**15


@pytest.mark.parametrize(("asked", "given"), [(5.0, 5.0), (10.0, 10.0), (100.0, 10.0), (0.0, 0.001), (-1.0, 0.001)])
def test_simulated_time_is_at_most_ten_times_and_at_least_a_thousandth_of_real_time(asked: float, given: float) -> None:
    time = SimulatedTime()
    time.set(speed=asked)
    assert time.speed == given


def test_a_paused_simulation_looks_four_times_a_second_whether_the_run_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    time, waited = SimulatedTime(), list[float]()
    time.set(paused=True)
    time.leaving = lambda: len(waited) == 3
    monkeypatch.setattr(time.changed, "wait", waited.append)
    time.sleep_until(10**9)
    assert len(waited) == 3
    assert max(waited) <= 0.25


def test_steps_of_a_paused_simulation_are_bounded_and_end_with_the_pause() -> None:
    time = SimulatedTime()
    for _ in range(3):
        time.set(paused=True, steps=10**12)
    assert time._ahead_ns(MOST_STEPS * time.period_ns) == 0
    assert time._ahead_ns(MOST_STEPS * time.period_ns + 1) == math.inf
    time.set(paused=False)
    time.set(paused=True)
    assert time._ahead_ns(1) == math.inf


@pytest.mark.thorough("waits in real time")
def test_a_paused_run_goes_on_by_the_periods_that_are_asked_for_and_no_more() -> None:
    seen: list[tuple[int, bool]] = []

    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"paused": True})
        watcher.until("pace")
        for steps in (1, 1, 7):
            before_ns = live.time._until_ns
            watcher.reader.send({"steps": steps})
            watcher.until("pace")
            until_ns = live.time._until_ns
            last_ns = watcher.row_where("t_ns", lambda at_ns, until_ns=until_ns: at_ns > until_ns - 1_000_000)  # type: ignore[misc]
            seen.append((until_ns - before_ns - steps * 1_000_000, last_ns <= until_ns))
        watcher.reader.send({"paused": False})
        watcher.until("pace")

    with Live(described) as live, watched(live, watch):
        run("wall", duration=LONG, live=live)
    # A step begins where the clock stands, which is within a period.
    assert [(0 <= further_ns < 1_000_000, in_time) for further_ns, in_time in seen] == [(True, True)] * 3


@pytest.mark.parametrize("change", [5, None, [1], {"wall.stiffness": [1]}, {"wall.stiffness": None}, {5: 5}, math.nan])
def test_what_is_no_change_is_refused_and_the_next_one_is_judged(change: Any) -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"change": change})
        assert watcher.until("refused")
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        assert watcher.until("changed") == {"wall.stiffness": 700.0}

    assert not run_watched(watch).trips


@pytest.mark.thorough("waits in real time")
def test_an_error_while_a_change_is_shown_is_told_and_the_next_one_is_judged() -> None:
    def described_badly(plan: Plan, running: Plan) -> dict[str, Any]:
        if described(plan, running)["stiffness"] == 650.0:
            raise ValueError("math domain error")
        return described(plan, running)

    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"change": {"wall.stiffness": 650.0}})
        assert watcher.until("refused") == "this cannot be shown: ValueError: math domain error"
        watcher.reader.send({"change": {"wall.stiffness": 700.0}})
        assert watcher.until("changed") == {"wall.stiffness": 700.0}
        watcher.reader.send({"stop": True})

    with Live(described_badly) as live, watched(live, watch):
        run("wall", duration=LONG, live=live)


def test_a_change_above_the_limit_of_a_simulation_is_made_with_a_warning_and_says_when_it_begins() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        watcher.reader.send({"change": {"wall.stiffness": 900.0}})
        message = watcher.message("changed")
        assert message["begun"] == 1
        assert "900 N/m exceeds the limit of 750 N/m" in message["above"][0]
        watcher.row_where("changes", lambda value: value == message["begun"])

    run_watched(watch)


def test_a_reader_that_stands_still_delays_nobody() -> None:
    def watch(watcher: Watcher) -> None:
        enabled(watcher)
        still = LiveReader(folder() / f"{os.getpid()}.sock")
        for number in range(5000):  # answers that are never read fill the buffer of the one that stands still
            watcher.reader.send({"speed": 10.0 - number * 1e-4})
            watcher.until("pace")
        with contextlib.suppress(ConnectionError):
            while still.socket.recv(65_536):
                pass  # it was left: what had been sent comes, and then the end
        still.close()

    assert not run_watched(watch).trips


def test_another_scene_begins_after_a_run_that_ended_torque_free_and_its_readers_follow() -> None:
    results, hellos = [], []

    def check(name: str) -> None:
        if name == "wall":
            raise UsageError("not twice")

    def watch(watcher: Watcher) -> None:
        for name, refused in (("wall", "wall cannot be run here: not twice"), ("nowhere", "expected a scene")):
            enabled(watcher) if name == "wall" else None
            watcher.reader.send({"scene": name})
            assert refused in watcher.until("refused")
        watcher.reader.send({"pull": ["handle", 0.03]})
        watcher.row_where("handle.force", lambda value: value < -2.0)
        watcher.reader.send({"scene": "detents"})
        hellos.append(watcher.until("hello"))
        watcher.row_where("enabled", lambda value: value == 1.0)

    with Live(described) as live:
        live.scenes, live.check_scene = ("wall", "detents"), check
        live.time.set(speed=10.0)
        with ended_by_signals() as ending, watched(live, watch):
            results.append(run("wall", duration=LONG, live=live, hand="none"))
            assert live.goes_on
            assert live.renew() == "detents"
            assert ending.signal is None
            results.append(run("detents", duration=LONG, live=live, hand="none"))
            assert live.renew() is None
    assert (hellos[0]["scene"], hellos[0]["run"]) == ("detents", 1)
    assert [each.stopped is not None and not each.trips for each in results] == [True, True]
    assert [bool(each.provenance and each.provenance.conditions.led) for each in results] == [True, False]


def test_stop_between_two_runs_ends_the_next_one() -> None:
    """While another scene begins no run goes on that STOP could end."""
    with Live(described) as live, ended_by_signals() as ending:
        reader = _Reader(live._listener)
        live.scenes = ("detents",)
        live.time.set(speed=10.0)
        run("wall", duration=LONG, live=live, progress=lambda *_: live._begin_scene(reader, "detents"))
        assert live.renew() == "detents"
        live._obey(reader, "stop", True)
        assert ending.signal == signal.SIGINT
        result = run("detents", duration=LONG, live=live)
    assert result.stopped is not None
    assert result.stopped.signal == "SIGINT"


def test_an_end_of_any_other_kind_takes_the_place_of_another_scene() -> None:
    with Live(described) as live:
        live._ending = EndSignals()
        live.scenes = ("detents",)
        live._begin_scene(_Reader(live._listener), "detents")
        said = [live.goes_on]
        live._obey(_Reader(live._listener), "stop", True)
        said += [live.goes_on, live._ending.signal == signal.SIGINT, live.renew() is None]
        live._ending = EndSignals()
        live._begin_scene(_Reader(live._listener), "detents")
        said += [live.goes_on]
        with pytest.raises(KeyboardInterrupt):
            live._ending.receive(signal.SIGTERM)
        assert [*said, live.goes_on] == [True, False, True, True, True, False]


def test_the_socket_goes_with_the_run_and_those_of_killed_runs_are_removed() -> None:
    with Live(described) as live:
        assert live.path in sockets()
    assert live.path not in sockets()
    left = folder() / "1.sock"
    left.touch()
    assert left not in sockets()
    assert not left.exists()


def test_a_folder_that_others_may_enter_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert folder().stat().st_mode & 0o777 == 0o700
    folder().chmod(0o755)
    with pytest.raises(UsageError, match="not a folder of this user alone"):
        folder()


@pytest.mark.parametrize("inside", ["a file", "nowhere", "x" * 100])
def test_a_folder_that_cannot_be_used_is_refused_with_its_path(
    inside: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = tmp_path / inside
    if inside != "nowhere":
        base.mkdir()
    if inside == "a file":
        (base / f"haptic-fieldbus-{os.getuid()}").touch()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(base))
    with pytest.raises(UsageError, match="set XDG_RUNTIME_DIR to a folder of yours") as refused:
        folder()
    assert str(base) in str(refused.value)


def test_times_of_the_loop_are_told_in_microseconds() -> None:
    state = SimpleNamespace(power=PowerState.OPERATION_ENABLED)
    tally = SimpleNamespace(largest=0.25)
    cycle: Any = SimpleNamespace(
        ledgers=[SimpleNamespace(tally=tally)], axes={"handle": SimpleNamespace(state=state)}, t_ns=3_500_000_000,
        enabled=True, trip=None,
    )  # fmt: skip
    running: Any = None
    samples = SimpleNamespace(last=(0, 0, 1_500, 2_500))
    report: Any = SimpleNamespace(enabled_at_ns=1_000_000_000, samples=samples, missed=7)
    with Live(described) as live:
        told = dict(zip(RUN_COLUMNS, live._of_run(running, cycle, report)(), strict=False))
    assert told["t"] == pytest.approx(2.5)
    assert (told["lateness_us"], told["compute_us"]) == pytest.approx((2.5, 1.5))


def test_a_run_that_requires_a_page_waits_two_minutes_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float] = []
    with Live(described, required=True) as live:
        monkeypatch.setattr(live._shown, "wait", lambda seconds: waited.append(seconds))
        with pytest.raises(UsageError, match=r"no page was opened within 120 s"):
            run("wall", duration=1.0, live=live)
    assert waited == [120.0]
