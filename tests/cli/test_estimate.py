"""`estimate` on the command line: the contract of its keys, and what it says."""

import json
from pathlib import Path

import pytest

from tests.cli.command import Command

KEYS = ["time", "signal", "estimate", "noise_gain", "delay_s"]
EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "lecture"
SINE, TACHOMETER = EXAMPLES / "noisy_sine.csv", EXAMPLES / "slow_tachometer.csv"


def test_the_json_object_has_the_keys_of_the_contract(command: Command) -> None:
    finished = command("estimate", SINE, "--estimator", "moving-average:window=4", "--json")
    assert (finished.status, finished.err) == (0, "")
    found = json.loads(finished.out)
    assert list(found) == KEYS
    assert len(found["time"]) == len(found["signal"]) == len(found["estimate"]) == 1001
    assert found["noise_gain"] == pytest.approx(2**0.5 / 0.04)
    assert found["delay_s"] == pytest.approx(0.02)


def test_what_does_not_apply_is_null(command: Command) -> None:
    found = json.loads(command("estimate", SINE, "--estimator", "levant", "--json").out)
    assert list(found) == KEYS
    assert found["noise_gain"] is found["delay_s"] is None


def test_the_lectures_noise_is_told(command: Command) -> None:
    out = command("estimate", SINE).out
    assert "noisy_sine.csv: position -1.09 to 1.09, in steps of 1e-6" in out
    assert "1001 rows, 10 s at 100 Hz" in out
    assert "gain 141: white noise of 1 in position is 141 in velocity" in out
    assert "5 ms, 0.5 periods, for slow changes of velocity" in out
    assert "no drift: the estimator forgets old samples" in out


def test_the_drift_of_a_tachometer_is_told(command: Command) -> None:
    out = command("estimate", TACHOMETER).out
    assert "trapezoidal" in out
    assert "up to 0.05 in 10 s from readings rounded to a step, each wrong by up to 0.005" in out
    assert "delay      no delay for slow changes" in out
    smooth = command("estimate", TACHOMETER, "--resolution", "0").out
    assert "no drift from readings without steps" in smooth


def test_a_delay_of_one_period_has_no_plural(command: Command) -> None:
    assert "0.01 s, 1 period, for" in command("estimate", TACHOMETER, "--estimator", "moving-average:window=3").out


def test_the_least_difference_of_a_smooth_signal_is_no_step(command: Command) -> None:
    out = command("estimate", TACHOMETER.with_name("fast_tachometer.csv")).out
    assert "in steps of 1e-9" in out
    assert "each wrong by up to 5e-10" in out


def test_an_estimator_that_is_not_linear_has_no_figures(command: Command) -> None:
    assert command("estimate", SINE, "--estimator", "levant").out.count("no value") == 2


def test_uneven_times_are_told(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    path.write_text("time,position\n0,0\n0.11,1\n0.2,2\n")
    assert "up to 10 % of a period early or late" in command("estimate", path).out


@pytest.mark.thorough("draws")
@pytest.mark.parametrize("file", [SINE, TACHOMETER], ids=lambda file: file.stem)
def test_it_is_drawn(file: Path, command: Command, tmp_path: Path) -> None:
    picture = tmp_path / "estimate.png"
    finished = command("estimate", file, "--plot", picture)
    assert finished.status == 0
    assert str(picture) in finished.out
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("time,position\n0,0\n0.1,x\n", 'line 3: position: "x"; expected a number'),
        ("time,position\n0,0\n0.1,nan\n", "line 3: position: nan; expected a finite number"),
        ("time,position\n0,0\n0.1,1\n0.1,2\n", "line 4: time: 0.1 after 0.1; expected a later time"),
        ("t,x\n", 'line 1: columns "t, x"; expected the columns time and position or velocity'),
    ],
)
def test_a_fault_of_the_file_is_told_with_its_place_and_status_2(
    text: str, sentence: str, command: Command, tmp_path: Path
) -> None:
    path = tmp_path / "signal.csv"
    path.write_text(text)
    finished = command("estimate", path)
    assert (finished.status, finished.out) == (2, "")
    assert f"{path}: {sentence}" in finished.err


@pytest.mark.parametrize("file", ["/dev/zero", "/dev", "/none.csv"])
def test_what_is_no_file_is_told_with_status_2(file: str, command: Command) -> None:
    finished = command("estimate", file)
    assert finished.status == 2
    assert f"{file}: cannot be read: " in finished.err


@pytest.mark.parametrize("words", [("--estimator", "magic"), ("--resolution", "-1"), ("--plot", "x.gif")])
def test_wrong_options_have_status_2(words: tuple[str, str], command: Command) -> None:
    assert command("estimate", SINE, *words).status == 2
