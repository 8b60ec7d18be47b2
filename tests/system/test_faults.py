"""Failures on the simulated bus, seen by the caller: torque zero on the wire first, then cause, time, status."""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.cli import main
from haptic_fieldbus.cli.failures import outcome_of
from haptic_fieldbus.errors import FaultFileError, HapticFieldbusError, SafetyTripError
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Signal, Workspace

RPDO = "201#"
CONTACT = 1.5
"""[s] after operation enabled; the pushing hand is in the wall by then."""

DURING_THE_RUN = {
    "emergency": (f'kind = "emergency"\nat = {CONTACT}\ncode = 0x4310', 1, "4310h"),
    "drive fault": (f'kind = "drive_fault"\nat = {CONTACT}', 1, "2310h"),
    "node reset": (f'kind = "node_reset"\nat = {CONTACT}', 1, "restart"),
    "silence": (f'kind = "silence"\nat = {CONTACT}', 1, "feedback"),
    "missing TPDOs": (f'kind = "missing_tpdos"\nat = {CONTACT}\ncount = 40', 1, "feedback"),
    "lost heartbeat": (f'kind = "heartbeat_lost"\nat = {CONTACT}', 1, "heartbeat"),
    "bus off": (f'kind = "bus_off"\nat = {CONTACT}', 1, "bus"),
    "encoder jump": (f'kind = "encoder_jump"\nat = {CONTACT}\ncounts = 100_000', 3, "speed"),
}
BEFORE_THE_RUN = {
    "missing node": ('kind = "missing_node"', "node 1 (axis handle) does not answer"),
    "wrong identity": ('kind = "wrong_identity"\nvendor_id = 0x1234', "00001234h"),
    "SDO abort": ('kind = "sdo_abort"\nobject = 0x6007\ncode = 0x06090030', "06090030h"),
}


def run_with(fault: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, dict[str, object]]:
    """Exit status, standard error and JSON object of a run with one fault; frames are in `frames.log`."""
    file = folder / "faults.toml"
    file.write_text(f"[[fault]]\n{fault}\n", encoding="utf-8")
    arguments = ["run", "wall", "--json", "--duration", "3", "--faults", str(file)]
    with pytest.raises(SystemExit) as ended:
        main([*arguments, "--record", str(folder / "frames.log")])
    out, err = capsys.readouterr()
    assert "Traceback" not in err
    return int(str(ended.value.code)), err, json.loads(out)


def set_points(log: Path) -> list[int]:
    """Target torque of every RPDO that was sent."""
    frames = [line.split()[2] for line in log.read_text().splitlines()]
    data = [bytes.fromhex(frame.removeprefix(RPDO)) for frame in frames if frame.startswith(RPDO)]
    return [struct.unpack("<Hh", octets)[1] for octets in data]


@pytest.mark.thorough("a run for each of 8 faults", quick=1)
@pytest.mark.parametrize("name", DURING_THE_RUN)
def test_a_fault_in_contact_ends_torque_free_with_cause_and_time(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault, status, cause = DURING_THE_RUN[name]
    code, err, result = run_with(fault, tmp_path, capsys)
    assert code == status, err
    assert cause in err
    assert " s after enabling" in err
    targets = set_points(tmp_path / "frames.log")
    assert min(targets) < -50, "the wall was being rendered"
    if name != "bus off":
        assert targets[-1] == 0
    trips = result["trips"]
    assert isinstance(trips, list)
    (trip,) = trips
    assert trip["time_s"] == pytest.approx(CONTACT, abs=0.35)
    assert result["cycles"] == pytest.approx(1000 * trip["time_s"], abs=3)


@pytest.mark.parametrize("name", BEFORE_THE_RUN)
def test_a_drive_that_cannot_be_configured_gets_no_torque(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fault, cause = BEFORE_THE_RUN[name]
    code, err, result = run_with(fault, tmp_path, capsys)
    assert code == 1, err
    assert cause in err
    assert set(set_points(tmp_path / "frames.log")) <= {0}
    assert result["cycles"] == 0


def test_a_faulty_fault_file_is_told_with_lines(tmp_path: Path) -> None:
    file = tmp_path / "faults.toml"
    file.write_text('[[fault]]\nkind = "emergency"\nat = -1\ncode = 0\n', encoding="utf-8")
    with pytest.raises(FaultFileError) as refused:
        run("wall", faults=file)
    assert [fault.line for fault in refused.value.faults] == [3, 4]


@dataclass(frozen=True)
class Broken:
    """An element that computes nonsense once the handle has moved."""

    axis: str = "handle"
    name: str = "broken"
    needs: Sequence[Signal] = (Signal.POSITION,)

    def force(self, position: float) -> float:
        return float("nan") if position > 0.001 else 0.0

    def linearised(self) -> StateSpace:
        return gain([[0.0, 0.0]])


def test_a_scene_that_computes_nonsense_trips_with_zero_on_the_wire(tmp_path: Path) -> None:
    scene = Scene("broken", "for tests", (SceneAxis("handle", Workspace.LINEAR),), (Broken(),))  # type: ignore[arg-type]
    log = tmp_path / "frames.log"
    with pytest.raises(SafetyTripError, match="is not finite: nan N") as tripped:
        run(scene, duration=2.0, record=log)
    assert outcome_of(type(tripped.value)).status == 3
    assert set(set_points(log)) == {0}
    assert isinstance(tripped.value.result, Result)
    assert tripped.value.result.trips[0].name == "force not finite"


def test_every_error_of_a_run_carries_what_was_known() -> None:
    with pytest.raises(HapticFieldbusError) as refused:
        run("wall", settings={"wall.stiffness": 1e5})
    assert isinstance(refused.value.result, Result)
    assert refused.value.result.plan is not None


def test_a_drive_that_vanishes_at_the_very_end_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, err, result = run_with('kind = "silence"\nat = 2.9992', tmp_path, capsys)
    assert (code, result["verdict"]) == (1, None)
    assert "did not confirm that their motors are off. Switch the power off" in err
