"""The commands `scan`, `watch` and `doctor` on a simulated bus, and what they refuse."""

import json
import socket
from pathlib import Path

import pytest

from haptic_fieldbus.buses.scan_result import Check
from haptic_fieldbus.cli import bench as doctor_command
from haptic_fieldbus.cli.bench import view_lines
from haptic_fieldbus.running.watch import View
from tests.cli.command import Command

FAULTY = View(
    node=5, position=0.0124, position_counts=1016, velocity=-0.5, torque_actual=None, torque_actual_raw=12,
    statusword=0x0218, state="fault", nmt_state="operational", error_code=0x8130, age_s=0.0062, life_age_s=0.05,
    note="it is so", unit="m",
)  # fmt: skip


@pytest.mark.parametrize("asked", ["8-6", ",", "1,", "1-1000000000", "256", "-1", "a", "1-b"])
def test_nodes_that_are_no_numbers_are_refused_before_anything_is_asked(asked: str, command: Command) -> None:
    finished = command("scan", "--node", asked)
    assert (finished.status, finished.out) == (2, "")
    assert f"--node {asked}: expected numbers up to 255, as in 1-8 or 1,3" in finished.err


def test_scan_finds_the_simulated_drive(command: Command) -> None:
    finished = command("scan")
    assert (finished.status, finished.err) == (0, "")
    bus, heading, row, sure = finished.out.splitlines()
    assert "without sending" in bus
    assert heading.split()[-1] == "profile"
    assert row.split()[-1] == "maxon_epos4"
    assert sure.startswith("node 1     likely")


def test_all_axes_of_a_rig_are_found_and_watched(command: Command, tmp_path: Path) -> None:
    axis = """
[axis.{0}]
bus = "one"
node = {1}
profile = "generic_cia402"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
mechanism = {{ kind = "rotary" }}
"""
    rig = tmp_path / "rig.toml"
    head = '[bus.one]\ninterface = "haptic_sim"\nchannel = "one"\nlisten = 0.0\n'
    rig.write_text(head + axis.format("left", 7) + axis.format("right", 9), encoding="utf-8")
    nodes = json.loads(command("scan", "--rig", rig, "--json").out)["nodes"]
    assert [(node["node"], node["profile"]) for node in nodes] == [(7, "generic_cia402"), (9, "generic_cia402")]
    finished = command("watch", "--rig", rig, "--duration", "0.2", "--json")
    axes = json.loads(finished.out)["axes"]
    assert [(name, view["node"], view["unit"]) for name, view in axes.items()] == [
        ("left", 7, "rad"),
        ("right", 9, "rad"),
    ]
    assert finished.status == 0


@pytest.mark.thorough("opens a bus each time", quick=1)
@pytest.mark.parametrize("words", [("scan",), ("watch",), ("doctor",)], ids=" ".join)
def test_a_bus_that_cannot_be_opened_says_what_to_do(command: Command, words: tuple[str, ...]) -> None:
    finished = command(*words, "--bus", "socketcan:no_such_can")
    assert finished.status in (1, 2)
    assert "cannot open socketcan:no_such_can" in finished.out + finished.err
    advice = "ip -details link show" if has_can() else "modprobe -a can can_raw"
    assert advice in finished.out + finished.err


def has_can() -> bool:
    """Return whether this kernel has CAN; that of a container often has none."""
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except (OSError, AttributeError):
        return False
    return True


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("watch", "--duration", "0"), "seconds above 0"),
        (("watch", "--duration", "nan"), "seconds above 0"),
        (("doctor", "--node", "128"), "node-ID is a whole number"),
        (("doctor", "--rate", "0"), "rate 0"),
        (("watch", "--rig", "rig.toml", "--node", "3"), "omit --node"),
        (("scan", "--bus", "can0"), "socketcan:can0"),
        (("watch", "--drive", "maxon_epos5"), "maxon_epos4"),
    ],
    ids=str,
)
def test_wrong_values_are_refused(command: Command, words: tuple[str, ...], expected: str) -> None:
    finished = command(*words)
    assert finished.status == 2
    assert expected in finished.err


def test_a_faulty_check_is_followed_by_its_advice_and_a_dead_bus_is_a_failure(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = [Check("queue", False, "10 frames", "lengthen it"), Check("bit_rate", None, "unknown")]
    monkeypatch.setattr("haptic_fieldbus.api.bench.examined", lambda bench: checks)
    finished = command("doctor")
    assert finished.status == 0
    assert finished.out.splitlines() == [
        "not ok     queue: 10 frames",
        "           lengthen it",
        "-          bit rate: unknown",
    ]
    for name in doctor_command.FAILED:
        checks.append(Check(name, False, "dead"))
        assert command("doctor", "--json").status == 1
        checks.pop()


def test_a_line_has_every_value_with_its_unit_and_the_note_below() -> None:
    line, note = view_lines(FAULTY)
    assert line == (
        "node 5 · fault (0218h) · error code 8130h · 0.0124 m (1016 counts) · -0.5 m/s · torque 12 "
        "(steps of the drive) · 6.2 ms old · operational, heartbeat 50 ms ago"
    )
    assert note == "it is so"
