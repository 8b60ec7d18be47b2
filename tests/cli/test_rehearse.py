"""`rehearse`: the day with a drive in one command, in real time; nothing is left behind that was not asked for."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from haptic_fieldbus.cli.rehearse import HEADING, OF_A_RIG, RehearseOptions
from haptic_fieldbus.protocols.catalogue import load_rig
from tests.cli.command import Command
from tests.cli.test_beside_guide import TOO_SLOW
from tests.peers.hosts import PROJECT, STARTS_WITHIN, typed

SLOW = ("--rate", "50", "--set", "wall.stiffness=max/2", "--duration", "3", "--hand", "guide")
"""A loop that a busy machine keeps up with, and a hand that keeps the limits whatever the wall does."""
REHEARSE = (sys.executable, "-m", "haptic_fieldbus", "rehearse", *SLOW)


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of temporary files."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


@pytest.mark.parametrize(
    ("words", "status", "said"),
    [
        ((), 2, "no terminal to confirm on; add --yes"),
        (("nowhere", "--yes"), 2, 'no scene "nowhere"'),
        (("--yes", "--hand", "foot"), 2, 'no hand "foot"'),
        (("--yes", "--drive", "generic_cia402_modbus"), 2, "rehearse supports CANopen only"),
        (("--yes", "--set", "wall.stiffness=3000"), 4, "3000 N/m exceeds the limit of "),
        (("--yes", "--plot", "mass.doc"), 2, "mass.doc"),
        (("--yes", "--bus", "can0"), 2, "--bus"),
    ],
)
def test_what_cannot_be_rehearsed_is_refused_before_anything_begins(
    command: Command, words: tuple[str, ...], status: int, said: str
) -> None:
    finished = command("rehearse", *words)
    assert (finished.status, finished.out) == (status, "")
    assert said in finished.err


def test_a_rig_file_that_is_there_is_not_overwritten(command: Command, tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text("mine", encoding="utf-8")
    finished = command("rehearse", "--yes", "--write-rig", path)
    assert finished.status == 2
    assert "is not overwritten" in finished.err
    assert path.read_text(encoding="utf-8") == "mine"


def test_it_has_the_options_of_run_but_those_of_a_bench(command: Command) -> None:
    told = command("rehearse", "--help").out
    assert set(OF_A_RIG) <= set(RehearseOptions.__dataclass_fields__)
    for name in ("--bus", "--node", "--rig", "--axis", "--zero", "--faults", "--prove", "--force"):
        assert f"{name} " not in told
    assert "[default: wall]" in told


@pytest.mark.thorough("real time")
@pytest.mark.xdist_group("peers")
class TestTheDay:
    def test_a_person_answers_and_everything_comes_in_its_order(self, temporary: Path, tmp_path: Path) -> None:
        status, seen = typed((*REHEARSE, "--write-rig", str(tmp_path / "rig.toml")), os.environ, PROJECT, "y")
        _skip_if_too_slow(seen)
        assert status == 0, seen
        told = [
            "step       haptic-fieldbus watch --rig rig.toml",
            "switch on disabled",
            "step       haptic-fieldbus run wall --rig rig.toml",
            "about to test the drive watchdog of axis handle",
            "about to enable torque on maxon EPOS4",
            "[y/N]",
            "axis handle is off: move the handle 10 mm to the positive side",
            "axis handle: drive watchdog fired after ",
            "Rehearsed on a simulated drive",
        ]
        places = [seen.find(text) for text in told]
        assert -1 not in places, seen
        assert places == sorted(places), seen
        assert "not confirmed" not in seen or "none missed" not in seen, "pulses between missed periods show nothing"
        axis = load_rig(tmp_path / "rig.toml").axis["handle"]
        assert axis.proved is not None
        assert (axis.proved.guard, axis.seen.direction) == ("proved", "confirmed")
        kept = (tmp_path / "rig.toml").read_text(encoding="utf-8")
        assert kept.startswith("".join(f"# {line}\n" for line in HEADING.splitlines()))
        assert list(temporary.iterdir()) == []

    def test_a_person_who_says_no_gets_no_torque(self, temporary: Path) -> None:
        status, seen = typed(REHEARSE, os.environ, PROJECT, "n")
        assert status == 2, seen
        assert "not enabled" in seen
        assert list(temporary.iterdir()) == []

    def test_a_script_gets_the_object_of_a_run_and_a_handle_that_moved(self, temporary: Path) -> None:
        done = subprocess.run(
            [*REHEARSE, "--yes", "--json"],
            cwd=PROJECT,
            capture_output=True,
            text=True,
            check=False,
            timeout=2 * STARTS_WITHIN,
        )
        _skip_if_too_slow(done.stderr)
        assert done.returncode == 0, done.stderr
        result = json.loads(done.stdout)
        assert (result["bus"], result["clock"], result["cycles"]) == (
            "haptic_sim:maxon_epos4@1@1000000",
            "monotonic",
            150,
        )
        assert result["verdict"].startswith("Rehearsed on a simulated drive")
        assert result["missed_cycles"] or not any("not confirmed" in warning for warning in result.get("warnings", ()))
        watched = [line for line in done.stderr.splitlines() if " counts)" in line]
        counts = [int(line.partition(" counts)")[0].rpartition("(")[2]) for line in watched]
        assert max(counts) - min(counts) > 3000, "40 of 60 mm at least: 4096 counts are 50 mm"
        assert "move the handle 10 mm to the positive side" in done.stderr
        assert list(temporary.iterdir()) == []


def _skip_if_too_slow(told: str) -> None:
    """Skip where only the time was missing that another program took."""
    if TOO_SLOW.search(told) and "the limit of" not in told:
        pytest.skip(f"this computer is too slow: {told.splitlines()[-1]}")
