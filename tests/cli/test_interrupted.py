"""Commands that a signal ends: exit status, sentence, result; the signals come in process, at a chosen instant."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.assessing.summary import Assessment
from haptic_fieldbus.buses.bus import InSteps
from haptic_fieldbus.cli import run as run_command
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.planning import selection
from haptic_fieldbus.running.ending import SIGNALS
from haptic_fieldbus.running.rows import Rows
from tests.cli.command import Command, FinalState

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}
WHO = {signal.SIGINT: "you", signal.SIGTERM: "SIGTERM", signal.SIGHUP: "SIGHUP"}
EACH = pytest.mark.parametrize("number", SIGNALS, ids=[each.name for each in SIGNALS])
IN_CONTACT = 3000
"""Waits after which the drives are configured and enabled, and the hand is in the wall."""


@pytest.fixture(autouse=True)
def usual_handlers() -> Iterator[None]:
    """As a process has them when it begins, and once more when it has ended."""
    before = {each: signal.getsignal(each) for each in SIGNALS}
    for each in SIGNALS:
        signal.signal(each, signal.default_int_handler if each is signal.SIGINT else signal.SIG_DFL)
    yield
    for each, handler in before.items():
        signal.signal(each, handler)


@pytest.fixture
def at_wait(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[], None]], None]:
    """Call a function at the n-th time that anything waits on the virtual clock."""

    def set_up(number: int, act: Callable[[], None]) -> None:
        waits, whole = iter(range(number + 1)), VirtualClock.sleep_until

        def wait(clock: VirtualClock, deadline_ns: int) -> int:
            if next(waits, None) == number:
                act()
            return whole(clock, deadline_ns)

        monkeypatch.setattr(VirtualClock, "sleep_until", wait)

    return set_up


def three_times(number: signal.Signals) -> Callable[[], None]:
    """Raise a signal, and Ctrl-C twice more, as somebody does who does not want to wait."""

    def strike() -> None:
        signal.raise_signal(number)
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    return strike


def check_stopped(finished: FinalState, number: signal.Signals) -> dict[str, Any]:
    """Check status and sentence, and that the JSON object tells the same; return it."""
    told: dict[str, Any] = json.loads(finished.out)
    stopped = told["stopped"]
    assert finished.status == STATUS[number], finished.err
    assert (stopped["signal"], stopped["duration_s"]) == (number.name, 60.0)
    assert finished.err == f"{stopped['message']}\n"
    assert told["trips"] == []
    when = "before enabling: no torque was applied"
    if stopped["time_s"] is not None:
        when = f"at {stopped['time_s']:.1f} s of 60 s"
        assert told["cycles"] == pytest.approx(1000 * stopped["time_s"], abs=1)
    assert stopped["message"] == f"stopped by {WHO[number]} {when}"
    return told


@EACH
def test_a_run_that_is_stopped_tells_so_with_its_result(number: signal.Signals, command: Command, at_wait: Any) -> None:
    at_wait(IN_CONTACT, three_times(number))
    told = check_stopped(command("run", "wall", "--duration", "60", "--json"), number)
    assert told["cycles"] > 900
    assert told["travel"][0]["highest"] > 0.0


@pytest.mark.thorough("a run for each instant", quick=2)
@pytest.mark.parametrize("wait", [0, 5, 40, 200, 400, 600, 800, 1000, 1100, 1200, 1280, 1330, 1380, 1450, 1700, 2200])
@pytest.mark.parametrize("bus", ["sim", "sim-modbus-tcp"])
def test_whenever_the_signal_comes_the_result_is_told(bus: str, wait: int, command: Command, at_wait: Any) -> None:
    """Configuration, enabling, pulses for the sign, fade-in, contact."""
    at_wait(wait, three_times(signal.SIGTERM))
    told = json.loads((finished := command("run", "wall", "--bus", bus, "--duration", "60", "--json")).out)
    assert finished.status == 143
    assert finished.err == f"{told['stopped']['message']}\n"


def test_lines_for_people_come_before_the_sentence(command: Command, at_wait: Any) -> None:
    at_wait(IN_CONTACT, three_times(signal.SIGINT))
    finished = command("run", "wall", "--duration", "60")
    assert (finished.status, finished.err[:18]) == (130, "stopped by you at ")
    for words in ("result     ", "deep in wall", "verdict"):
        assert words in finished.out


MAKING: dict[str, tuple[object, str]] = {
    "the drives are stopped": (InSteps, "stop"),
    "rows are closed": (Rows, "close"),
    "the run is assessed": (Assessment, "finish"),
    "the object is made": (Result, "to_json"),
    "the object is printed": (run_command, "print_json"),
}


@pytest.mark.parametrize("place", MAKING)
def test_signals_while_the_result_is_made_lose_nothing(
    place: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    holder, name = MAKING[place]
    whole = getattr(holder, name)

    def struck(*arguments: object) -> object:
        three_times(signal.SIGTERM)()
        return whole(*arguments)

    monkeypatch.setattr(holder, name, struck)
    finished = command("run", "wall", "--duration", "0.3", "--json")
    assert (finished.status, finished.err) == (
        143,
        "stopped by SIGTERM after the end of the run; its result is complete\n",
    )
    told = json.loads(finished.out)
    assert (told["cycles"], told["stopped"]) == (300, None)


CUT = """
[[fault]]
kind = "{kind}"
at = {at}
"""


def test_a_drive_that_does_not_confirm_makes_it_a_failure(command: Command, at_wait: Any, tmp_path: Path) -> None:
    """The cable is cut in the period in which the signal comes, so that nothing trips before."""
    at_wait(IN_CONTACT, three_times(signal.SIGINT))
    told = json.loads(command("run", "wall", "--duration", "60", "--json").out)
    faults = tmp_path / "faults.toml"
    faults.write_text(CUT.format(kind="silence", at=told["cycles"] / 1000 + 0.0002), encoding="utf-8")
    at_wait(IN_CONTACT, three_times(signal.SIGINT))
    finished = command("run", "wall", "--duration", "60", "--json", "--faults", faults)
    assert finished.status == 1
    assert "Switch the power off" in finished.err
    assert json.loads(finished.out)["stopped"]["signal"] == "SIGINT"


def test_a_trip_keeps_its_status(command: Command, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    holder, name = MAKING["the object is printed"]
    whole = getattr(holder, name)

    def struck(value: object) -> None:
        three_times(signal.SIGINT)()
        whole(value)

    monkeypatch.setattr(holder, name, struck)
    faults = tmp_path / "faults.toml"
    faults.write_text(CUT.format(kind="encoder_jump", at=0.1) + "counts = 100000\n", encoding="utf-8")
    finished = command("run", "wall", "--json", "--duration", "60", "--faults", faults)
    assert finished.status == 3
    assert json.loads(finished.out)["trips"]


@EACH
def test_a_signal_while_the_scene_is_compiled_is_told(
    number: signal.Signals, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(selection, "compile_plan", lambda *_, **__: signal.raise_signal(number))
    finished = command("run", "wall", "--json", "--duration", "60")
    assert check_stopped(finished, number)["plan"] is None


@pytest.mark.parametrize(
    ("words", "place", "number"),
    [
        *[("plan wall", "haptic_fieldbus.planning.selection.compile_plan", number) for number in SIGNALS],
        ("stability wall", "haptic_fieldbus.api.stability_limits.judge_scene", signal.SIGINT),
        ("response sprung_mass", "haptic_fieldbus.api.open_loop.open_loop", signal.SIGINT),
        ("estimate signal.csv", "haptic_fieldbus.api.estimation.estimate_from", signal.SIGINT),
        ("scan", "haptic_fieldbus.api.bench.scans", signal.SIGINT),
        ("doctor", "haptic_fieldbus.api.bench.examined", signal.SIGINT),
        ("watch", "haptic_fieldbus.running.watch.watch_axes", signal.SIGINT),
        ("report --quick", "haptic_fieldbus.study.make_report.make_report", signal.SIGINT),
    ],
)
def test_any_other_command_ends_with_the_status_of_the_signal(
    words: str, place: str, number: signal.Signals, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(place, lambda *_, **__: signal.raise_signal(number))
    finished = command(*words.split())
    assert (finished.status, finished.out) == (STATUS[number], "")
    assert finished.err.endswith(f"stopped by {WHO[number]}\n")


def test_a_signal_in_a_run_of_the_report_ends_the_report(command: Command, at_wait: Any, tmp_path: Path) -> None:
    at_wait(IN_CONTACT, three_times(signal.SIGINT))
    finished = command("report", "--quick", "--only", "buses", "--out", tmp_path)
    assert (finished.status, finished.out) == (130, "")
    assert finished.err.splitlines()[-1] == "stopped by you"


IN_AN_EXEC = """
from haptic_fieldbus.cli import app, main
def struck(**_):
    exec("import signal; signal.raise_signal(signal.SIGTERM)")
app.application = lambda given: struck
main()
"""


def test_a_signal_while_a_dataclass_is_made_keeps_its_status(tmp_path: Path) -> None:
    """CPython runs the text of a dataclass by `exec`, and `python -m` remembers an interrupt that leaves it."""
    (tmp_path / "struck.py").write_text(IN_AN_EXEC)
    program = [sys.executable, "-m", "struck"]
    finished = subprocess.run(program, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (finished.returncode, finished.stderr) == (143, "stopped by SIGTERM\n")
