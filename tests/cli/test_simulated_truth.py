"""A simulated bench that differs from its rig: it moves otherwise, and no plan and no limit knows."""

from pathlib import Path

import pytest

from tests.cli.command import Command

RIG = """\
[bus.can0]
interface = "socketcan"
channel = "can0"

[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3

[axis.handle.mechanism]
kind = "linear"
metres_per_revolution = 0.05

[axis.handle.simulation]
"""
TRUTHS = (
    "inertia = 1.2e-4",
    'viscous_damping = "0.3 mN·m·s/rad"',
    "coulomb_friction = 6.0e-3",
    "torque_bandwidth = 300.0",
    "encoder_counts_per_revolution = 1024",
    "torque_scale = 0.5",
)
UNREAD = (
    ("plan", "wall"),
    ("stability", "wall"),
    ("plan", "wall", "--bus", "sim"),
    ("stability", "wall", "--bus", "sim"),
)


def rig(folder: Path, *lines: str) -> str:
    path = folder / "rig.toml"
    path.write_text(RIG + "\n".join(lines), encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("truth", TRUTHS)
def test_nothing_that_plans_reads_what_the_simulated_bench_really_is(
    tmp_path: Path, command: Command, truth: str
) -> None:
    stated = [command(*asked, "--rig", rig(tmp_path), "--json") for asked in UNREAD]
    assert [command(*asked, "--rig", rig(tmp_path, truth), "--json") for asked in UNREAD] == stated


@pytest.mark.parametrize("truth", TRUTHS)
def test_a_run_on_the_simulated_bench_goes_otherwise(tmp_path: Path, command: Command, truth: str) -> None:
    def run(*lines: str) -> str:
        recording = tmp_path / "run.csv"
        recording.unlink(missing_ok=True)
        bench = rig(tmp_path, *lines)
        ended = command("run", "wall", "--rig", bench, "--bus", "sim", "--duration", "0.4", "--record", str(recording))
        assert ended.status in (0, 3)
        return recording.read_text()

    assert run(truth) != run()


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("torque_scale = 0", "torque_scale"),
        ("torque_scale = -1.0", "torque_scale"),
        ('inertia = "4 N·m"', "inertia"),
        ("viscous_damping = -1e-4", "viscous_damping"),
        ("encoder_counts = 1024", "encoder_counts"),
        ("inertia = 2e-5\ncoupling = { stiffness = 20, load_inertia = 3e-5 }", "less than simulation.inertia"),
    ],
)
def test_a_bench_that_cannot_be_is_refused(tmp_path: Path, command: Command, line: str, complaint: str) -> None:
    refused = command("plan", "wall", "--rig", rig(tmp_path, line))
    assert refused.status == 2
    assert complaint in refused.err
