"""A rig that leaves out inertia, damping or friction has no limit: refused, capped with `--force`, and measured."""

from pathlib import Path

import pytest

from tests.cli.command import Command
from tests.cli.test_simulated_truth import rig

LINES = {
    "inertia": "inertia = 4.0e-5\n",
    "viscous_damping": "viscous_damping = 1.0e-4\n",
    "coulomb_friction": "coulomb_friction = 2.0e-3\n",
}
SIMULATED = ("--bus", "sim", "--duration", "0.3")


def rig_without(folder: Path, *keys: str) -> str:
    path = rig(folder)
    text = Path(path).read_text(encoding="utf-8")
    for key in keys:
        assert LINES[key] in text
        text = text.replace(LINES[key], "", 1)
    Path(path).write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("key", LINES)
@pytest.mark.parametrize("asked", [("run", "wall", *SIMULATED), ("plan", "wall"), ("stability", "wall")])
def test_a_bench_without_one_of_its_values_is_refused_and_identify_is_named(
    key: str, asked: tuple[str, ...], tmp_path: Path, command: Command
) -> None:
    path = rig_without(tmp_path, key)
    refused = command(*asked, "--rig", path)
    assert refused.status == 4
    told = " ".join(refused.err.split())
    assert f"lacks axis.handle.{key}. `haptic-fieldbus identify --rig {path}` measures" in told
    assert "Traceback" not in told


@pytest.mark.parametrize("keys", [("coulomb_friction",), tuple(LINES)])
def test_force_has_a_twentieth_of_the_rated_torque_and_says_that_no_limit_is_known(
    keys: tuple[str, ...], tmp_path: Path, command: Command
) -> None:
    ended = command("run", "wall", *SIMULATED, "--force", "--rig", rig_without(tmp_path, *keys))
    assert ended.status == 0
    told = " ".join(ended.out.split())
    assert f"(5 % of rated torque): no limit is known, because the rig leaves out {' and '.join(keys)}" in told
    assert "limit unknown: the rig has no valid inertia, damping or friction; identify measures them" in told
    assert "passive" not in told


def test_a_friction_that_is_stated_as_0_is_known(tmp_path: Path, command: Command) -> None:
    path = rig(tmp_path)
    text = Path(path).read_text(encoding="utf-8").replace("coulomb_friction = 2.0e-3", "coulomb_friction = 0")
    Path(path).write_text(text, encoding="utf-8")
    assert command("plan", "wall", "--set", "wall.stiffness=200", "--rig", path).status == 0


def test_a_bench_without_any_of_its_values_says_what_identify_would_move(tmp_path: Path, command: Command) -> None:
    told = command("identify", "--dry-run", "--rig", rig_without(tmp_path, *LINES))
    assert told.status == 0
    assert "5 % of rated torque" in told.out
