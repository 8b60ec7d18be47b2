"""docs/explanation/lecture.md shows each item of the lecture by a command, whose output has what the item is about."""

import csv
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import trapezoid

from haptic_fieldbus import run
from tests.cases import every
from tests.cli.command import Command

PROJECT = Path(__file__).resolve().parents[2]
EXAMPLES = PROJECT / "examples" / "lecture"
PAGE = (PROJECT / "docs" / "explanation" / "lecture.md").read_text(encoding="utf-8")
COMMANDS = [
    line for block in re.findall(r"^```sh\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL) for line in block.splitlines()
]

ITEMS = {
    "haptic interface: puck, encoder, controller, motor": ("plan wall", r"TPDO1.*position.*RPDO1.*target torque"),
    "the drive behind the motor": ("profiles show maxon_epos4", r"6064h.*6071h|6071h.*6064h"),
    "rotary and linear are analogues": ("report --quick --only rotary-equals-linear --out analogues", ""),
    "virtual wall": ("run wall --duration 3 --plot wall.png", r"Feels right"),
    "a chattering wall is refused": ("run wall --set wall.stiffness=3000", r"refused"),
    "chatter from a large force": (
        "run wall --set wall.stiffness=20000 --force --hand release --duration 3 --plot chatter.png", r"Unstable"
    ),
    "chatter from slow sampling": ("run wall --rate 100 --force --duration 3 --plot slow_sampling.png", r"Unstable"),
    "chatter from coarse quantisation": (
        "run wall --rig examples/lecture/coarse_encoder.toml --set wall.stiffness=1000 --duration 3 --plot coarse.png",
        r"the wall chatters: 1\d % ripple",
    ),
    "the limit of a coarse encoder": (
        "stability wall --rig examples/lecture/coarse_encoder.toml --set wall.stiffness=1000",
        r"at rest between two counts to 60\.32 N/m.*radius +0\.99.*limit-cycle",
    ),
    "tachometer as the only sensor": (
        "run damped_wall --drive example_velocity_only --duration 3", r"Feels right"
    ),
    "held puck: step of one unit": (
        "response sprung_mass --input step --amplitude 1",
        r"force -200 to 200 N.*position 0 to 2 m\n.*velocity -20 to 20 m/s",
    ),
    "natural frequency, matrix form and both forms of the force": (
        "response sprung_mass --model",
        r"A \[\[0, 1\], \[-400, 0\]\].*C \[\[200, 0\]\].*F/x = -200 s\^2/\(s\^2 \+ 400\)"
        r".*20 rad/s, 3\.18 Hz, a period of 0\.314 s",
    ),
    "free puck: four states": ("response free_puck --model", r"4 virtual states z.*A \[\[0, 1, 0, 0\]"),
    "free puck in motion": (
        "response free_puck --amplitude 0.01 --duration 2 --plot free_puck.png", r"mass position 0 to 0\.0206"
    ),
    "free puck in the hand": ("run free_puck --duration 3 --plot led.png", r"Feels right"),
    "free puck by its closed form": ("report --quick --only free-puck --out free_puck", ""),
    "forward Euler: eigenvalues 1 ± jT·√(k/m)": (
        "response sprung_mass --method forward-euler --model", r"poles 1 ± 0\.02j \(modulus 1\.00019998\)"
    ),
    "forward Euler grows": (
        "response sprung_mass --method forward-euler --amplitude 0.01 --duration 10 --plot euler.png",
        r"a free motion grows",
    ),
    "T too large": (
        "response sprung_mass --method trapezoidal --amplitude 0.01 --rate 10 --duration 3 --plot slow.png",
        r"neither grows nor decays",
    ),
    "backward rule, its transfer function and difference equation": (
        "response sprung_mass --method backward-euler --model",
        r"modulus 0\.99980006\).*F/x = \(.* z\^2 .*\)/\(z\^2 .*\).*F\[n\] = .* x\[n\].* F\[n-2\]",
    ),
    "trapezoidal rule": ("response sprung_mass --method trapezoidal --model", r"\(modulus 1\)"),
    "poles on the z-plane and growth per step": (
        "response sprung_mass --model --rate 20 --plot poles.png", r"forward-euler 1\.41421356, .*-euler 0\.707106781"
    ),
    "error against cost": ("report --quick --only sprung-mass-step --out cost", ""),
    "error along the run": ("report --quick --only growth --out growth", ""),
    "does it matter?": ("report --quick --only integrator --out integrator", ""),
    "differentiation amplifies noise": (
        "estimate examples/lecture/noisy_sine.csv --estimator backward-difference --plot difference.png", r"gain 141:"
    ),
    "s/(τs + 1)": (
        "estimate examples/lecture/noisy_sine.csv --estimator filtered-derivative:tau=0.3,mapping=trapezoidal",
        r"0\.3 s, 30 periods",
    ),
    "FIR moving average": (
        "estimate examples/lecture/noisy_sine.csv --estimator moving-average:window=63", r"0\.315 s, 31\.5 periods"
    ),
    "IIR low-pass": (
        "estimate examples/lecture/noisy_sine.csv --estimator low-pass:pole=0.97", r"0\.328 s, 32\.8 periods"
    ),
    "quantisation accumulates for slow signals": (
        "estimate examples/lecture/slow_tachometer.csv --plot drift.png", r"up to 0\.05 in 10 s"
    ),
    "long steps miss fast signals": (
        "estimate examples/lecture/fast_tachometer.csv", r"position -0\.0022\d to 0\.0022\d"
    ),
    "surgery simulator": ("run generalised_maxwell --duration 3 --plot tissue.png", r"Feels right"),
    "tissue by every method": ("report --quick --only tissue --out tissue", ""),
}  # fmt: skip
"""By the item of the lecture its command, and what the command tells."""
SOON = ("natural frequency, matrix form and both forms of the force", "long steps miss fast signals")


@every("item", ITEMS)
def test_the_page_has_the_command_of_the_item(item: str) -> None:
    assert f"haptic-fieldbus {ITEMS[item][0]}" in COMMANDS


@pytest.mark.thorough("renders, draws and measures for minutes", quick=SOON)
@pytest.mark.parametrize("item", ITEMS)
def test_the_command_shows_the_item(
    item: str, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, told = ITEMS[item]
    (tmp_path / "examples").symlink_to(PROJECT / "examples")
    monkeypatch.chdir(tmp_path)
    if words.startswith("report"):
        subprocess.run([sys.executable, "-m", "haptic_fieldbus", *words.split()], check=True)
        assert (tmp_path / words.split()[-1] / "index.html").stat().st_size > 1000
        return
    finished = command(*words.split())
    assert re.search(told, finished.out + finished.err, re.DOTALL), finished.out + finished.err


def signal(name: str) -> tuple[list[float], list[float]]:
    """Times and values of a signal of the lecture."""
    with (EXAMPLES / name).open(encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    assert header[0] == "time"
    return [float(row[0]) for row in rows], [float(row[1]) for row in rows]


FORMULAS: dict[str, Callable[[float], float]] = {
    "noisy_sine.csv": lambda t: math.sin(t) + 0.1 * math.sin(10.0 * t),
    "slow_tachometer.csv": lambda t: 0.01 * math.floor(2.0 * math.sin(t)),
    "fast_tachometer.csv": lambda t: 0.9 * math.pi * math.cos(90.0 * math.pi * t),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_a_signal_is_what_its_page_says(name: str) -> None:
    times, values = signal(name)
    assert values == pytest.approx([FORMULAS[name](t) for t in times], abs=1e-6)


def test_the_tachometer_of_the_page_is_as_far_off_as_it_says() -> None:
    """Half a step a second: 5 mm/s over 6.28 s; and 10 mm times (ωT/2)/tan(ωT/2) at 45 Hz and 100 Hz."""
    times, values = signal("slow_tachometer.csv")
    turn = next(row for row, time in enumerate(times) if time > 2.0 * math.pi)
    assert trapezoid(values[:turn], times[:turn]) == pytest.approx(-0.005 * 2.0 * math.pi, abs=2e-4)
    half = 0.45 * math.pi
    assert 10.0 * half / math.tan(half) == pytest.approx(2.24, abs=0.01)


@pytest.mark.thorough("two runs of three seconds", quick=1)
@pytest.mark.parametrize(("rate", "lasts"), [(100.0, True), (200.0, False)])
def test_chatter_from_slow_sampling_lasts_where_the_hand_does_not_damp_it(rate: float, lasts: bool) -> None:
    (trace,) = run("wall", rate=rate, force=True, duration=3.0).traces
    before, after = (
        float(np.ptp(trace.position[(trace.times > begin) & (trace.times <= begin + 0.8)])) for begin in (1.4, 2.2)
    )
    assert (after >= before > 0.02) if lasts else after < 0.005


@pytest.mark.thorough("two runs of three seconds")
def test_the_wall_of_the_coarse_bench_chatters_and_that_of_the_same_bench_with_a_fine_encoder_does_not(
    tmp_path: Path,
) -> None:
    coarse = EXAMPLES / "coarse_encoder.toml"
    fine = tmp_path / "fine.toml"
    fine.write_text(coarse.read_text(encoding="utf-8").replace("revolution = 24 ", "revolution = 4096 "))
    stiffness = {"wall.stiffness": 1000.0}
    verdicts = [run("wall", rig=rig, settings=stiffness, duration=3.0).verdict or "" for rig in (coarse, fine)]
    assert "the wall chatters" in verdicts[0]
    assert "chatter" not in verdicts[1]
