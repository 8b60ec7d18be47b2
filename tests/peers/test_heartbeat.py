"""A run on a real bus: no thread receives for it, and a heartbeat that stays away is noticed in time."""

import json
import struct
import threading
from itertools import pairwise
from pathlib import Path

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.errors import HapticFieldbusError
from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start
from tests.peers.test_master_dies import ATTEMPTS, NODE, PROFILES, RATE, RIG, SETTING, Drive, pushing_master

pytestmark = [
    pytest.mark.xdist_group("peers"),
    pytest.mark.thorough("two processes, and waits in real time"),
]

HEARTBEAT, LOST_AFTER = 0.1, 0.3
"""Requests of the master to the drive, and three of them [s]."""


def test_no_thread_receives_while_the_loop_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """python-can's Notifier ends at the first error, and canopen's network starts one."""
    port = free_port()
    require_multicast(port)
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"port": port}))
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG, encoding="utf-8")
    before, during = set(threading.enumerate()), set[threading.Thread]()
    drive = start("simulate", "--drive", f"generic_cia402@{NODE}", "--bus", f"udp_multicast:{GROUP}", port=port)
    try:
        line_of(drive)
        seen = []

        def look(done: int, of: int) -> None:
            seen.append(done)
            during.update(threading.enumerate())

        try:
            run("wall", rig=rig, rate=RATE, duration=1.0, settings=dict([SETTING]), confirm=_yes, progress=look)
        except HapticFieldbusError as error:  # of a busy machine
            if not seen:
                pytest.skip(f"the run ended before its loop was seen: {error}")
        assert during
        assert during <= before, [thread.name for thread in during - before]
    finally:
        drive.kill()
        drive.communicate()


def _yes(question: str) -> bool:
    return True


def test_a_heartbeat_that_stays_away_is_noticed_within_its_time_give_or_take_a_period(tmp_path: Path) -> None:
    """The lateness of this computer comes on top: of the loop as it tells it, and of the drive's own heartbeat."""
    faults = tmp_path / "faults.toml"
    faults.write_text('[[fault]]\nkind = "heartbeat_lost"\nat = 2.5\n', encoding="utf-8")
    for _ in range(ATTEMPTS):
        with pushing_master(tmp_path / "rig.toml", PROFILES[0], str(faults)) as (master, drive):
            beats, end = _heard(drive)
            out, told = master.communicate(timeout=STARTS_WITHIN)
            result = json.loads(out)
            if [trip["name"] for trip in result["trips"]] == ["heartbeat lost"]:
                late = 1e-6 * result["timing"]["lateness_us"]["max"]
                late += max([0.0, *[abs(there - due) for due, there in _intervals(beats)]])
                assert abs(end - beats[-1] - LOST_AFTER) <= 1.0 / RATE + late
                assert "the heartbeat of node 5 was lost" in told
                assert drive.read(0x6077) == 0
                return
    pytest.skip(f"the loop ended before, on a busy machine: {told}")


def _heard(drive: Drive) -> tuple[list[float], float]:
    """Instants of the drive's heartbeats, and of the first set-point after them that takes the torque away."""
    beats: list[float] = []
    while True:
        message = drive._bus.recv(STARTS_WITHIN)
        assert message is not None
        if message.arbitration_id == 0x700 + NODE:
            beats.append(message.timestamp)
        if message.arbitration_id == 0x200 + NODE and struct.unpack("<H", message.data[:2]) == (0,):
            return beats, message.timestamp


def _intervals(beats: list[float]) -> list[tuple[float, float]]:
    """The time that should be between two heartbeats, and the one that was."""
    return [(HEARTBEAT, two - one) for one, two in pairwise(beats)]
