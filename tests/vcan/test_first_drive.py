"""`scan`, `watch`, `doctor`, `run`: the walk of docs/how-to/your_first_real_drive.md on a real SocketCAN interface."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.test_beside_guide import TOO_SLOW
from tests.peers.hosts import hear_signals
from tests.vcan.links import Link

pytestmark = [pytest.mark.vcan, pytest.mark.thorough("processes in a guest kernel")]

PROJECT = Path(__file__).parents[2]
PATIENCE = 120.0


def done(*words: str) -> tuple[int, str, str]:
    command = [sys.executable, "-m", "haptic_fieldbus", *words]
    ended = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=False, timeout=PATIENCE)
    return ended.returncode, ended.stdout, ended.stderr


def test_a_drive_on_vcan_is_found_watched_examined_and_felt(vcan: Link, tmp_path: Path) -> None:
    bus, rig = f"{vcan.bus}@1000000", str(tmp_path / "rig.toml")
    words = ("--drive", "maxon_epos4@5", "--hand", "guide", "--bus", bus, "--write-rig", rig)
    hosting = subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", "simulate", *words],
        cwd=PROJECT,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=hear_signals,
    )
    try:
        assert hosting.stdout is not None
        assert hosting.stdout.readline().startswith("ready")
        status, out, err = done("scan", "--bus", bus, "--json")
        assert status == 0, err
        (node,) = json.loads(out)["nodes"]
        assert (node["node"], node["vendor_id"], node["profile"]) == (5, 0xFB, "maxon_epos4")
        status, out, err = done("watch", "--rig", rig, "--duration", "1.5", "--json")
        assert status == 0, err
        assert json.loads(out.splitlines()[-1])["axes"]["handle"]["state"] == "switch on disabled"
        status, out, err = done("doctor", "--rig", rig, "--json")
        assert status == 0, err
        checks = {check["name"]: check for check in json.loads(out)["checks"]}
        assert checks["adapter"]["ok"] is checks["driver"]["ok"] is checks["other_masters"]["ok"] is True
        assert checks["driver"]["measured"] == "virtual"
        assert checks["queue"]["measured"].endswith("frames")
        assert checks["bit_rate"]["ok"] is None
        assert (checks["state"]["ok"], checks["state"]["measured"]) == (True, "up, virtual")
        # System calls of a guest kernel are slow, so the loop is.
        run = ("run", "wall", "--rig", rig, "--set", "wall.stiffness=50", "--duration", "2", "--rate", "100", "--yes")
        status, out, err = done(*run)
        assert status == 0 or (TOO_SLOW.search(err) and "the limit of" not in err), err
        assert "about to enable torque on maxon EPOS4, node 5" in err
    finally:
        hosting.kill()
        hosting.communicate()


def test_an_interface_that_is_down_is_told_with_the_line_that_brings_it_up(vcan: Link) -> None:
    vcan.down()
    status, out, _ = done("doctor", "--bus", f"{vcan.bus}@1000000", "--json")
    checks = {check["name"]: check for check in json.loads(out)["checks"]}
    assert status == 1
    assert checks["adapter"]["ok"] is checks["state"]["ok"] is False
    assert f"ip link set {vcan.name} up" in checks["state"]["advice"]
