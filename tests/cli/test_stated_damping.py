"""A damping that somebody states and nobody has measured: every text on the limit says so, and none is sure of it."""

from pathlib import Path

import pytest

from tests.cli.command import Command
from tests.cli.test_simulated_truth import rig

SAID, CONDITION = "damping stated, not measured", "if the stated damping holds"
SOFT, HARD = ("wall", "--set", "wall.stiffness=200"), ("wall", "--set", "wall.stiffness=900")
SIMULATED = ("--bus", "sim", "--duration", "0.5")
TEXTS = {
    "plan": ("plan", *SOFT),
    "plan in full": ("plan", *SOFT, "-v"),
    "plan above the limit": ("plan", *HARD, "-v"),
    "plan without stiffness": ("plan", "damper", "-v"),
    "plan of any stiffness": ("plan", "sprung_mass", "--method", "backward-euler", "-v"),
    "stability": ("stability", *SOFT),
    "stability above the limit": ("stability", *HARD),
    "run": ("run", *SOFT, *SIMULATED),
    "run in full": ("run", *SOFT, *SIMULATED, "-v"),
    "run above the limit": ("run", *HARD, *SIMULATED),
    "refusal": ("run", *HARD, "--yes"),
}


@pytest.mark.thorough("11 texts of one rule", quick=("plan in full", "run above the limit", "refusal", "stability"))
@pytest.mark.parametrize("name", TEXTS)
def test_a_damping_three_times_too_large_is_told_as_stated_and_never_called_passive_alone(
    name: str, tmp_path: Path, command: Command
) -> None:
    command_line = TEXTS[name]
    bench = rig(tmp_path)
    path = Path(bench)
    path.write_text(path.read_text().replace("viscous_damping = 1.0e-4", "viscous_damping = 3.0e-4"))
    ended = command(*command_line, "--rig", bench)
    assert ended.status == (4 if name == "refusal" else 0), ended.err
    told = ended.out + ended.err
    assert " ".join(told.split()).count(SAID) == 1
    for line in told.replace("every passive hand", "").replace("not passive", "").splitlines():
        assert "passive" not in line.replace("passivity", "") or CONDITION in line
    assert ("passive " in told) == (CONDITION in told)


def test_numbers_of_the_command_line_are_stated_too(command: Command) -> None:
    told = command("stability", *SOFT, "--mass", "0.6", "--damping", "1.6").out
    assert told.count(SAID) == 1
    assert "verdict    passive if the stated damping holds: stable with every passive hand" in told


def test_exact_values_of_the_shipped_bench_need_no_condition(command: Command) -> None:
    told = command("stability", *SOFT).out
    assert SAID not in told
    assert "verdict    passive: stable with every passive hand" in told
