"""A page beside a real bus: whatever it sends, the drive stays off until a person at the terminal says yes."""

import json
from pathlib import Path

import can
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.running.live import Live
from haptic_fieldbus.view.description import describe
from tests.peers.hosts import in_another_process
from tests.peers.test_master_dies import NODE, RIG
from tests.running.test_live import Watcher

pytestmark = [pytest.mark.xdist_group("peers"), pytest.mark.thorough("two processes, and waits in real time")]
COMMANDS: list[dict[str, object]] = [
    {"pull": ["handle", 0.03]}, {"hand": "push"}, {"speed": 10.0}, {"paused": False}, {"steps": 5}, {"page": 0.0},
    {"enable": True}, {"yes": True}, {"start": True}, {"controlword": 15},
]  # fmt: skip
READ_STATUSWORD = bytes.fromhex("40 41 60 00 00 00 00 00")
OPERATION_ENABLED, STATE = 0x27, 0x6F


def statusword(bus: can.BusABC) -> int:
    """Read the statusword of the drive by SDO."""
    bus.send(can.Message(arbitration_id=0x600 + NODE, data=READ_STATUSWORD, is_extended_id=False))
    while True:
        heard = bus.recv(60.0)
        assert heard is not None
        if heard.arbitration_id == 0x580 + NODE and heard.data[1:4] == READ_STATUSWORD[1:4]:
            return int.from_bytes(heard.data[4:6], "little")


def test_no_command_of_a_page_enables_a_drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, states = tmp_path / "rig.toml", []
    rig.write_text(RIG, encoding="utf-8")
    with in_another_process(NODE, [f"generic_cia402@{NODE}"]) as reach, can.Bus(**reach.options) as bus:
        monkeypatch.setenv("CAN_CONFIG", json.dumps({"port": reach.options["port"]}))

        def confirm(_: str) -> bool:
            watcher = Watcher(live.path)
            assert watcher.until("hello")["simulated"] is False
            for command in COMMANDS:
                watcher.reader.send(command)
            watcher.reader.send({"scene": "detents"})
            assert "expected a scene that this simulation offers" in watcher.until("refused")
            watcher.reader.send({"change": {"wall.stiffness": 100.0}})
            assert "no run uses these changes" in watcher.until("refused")  # so all before it were carried out
            states.append(statusword(bus))
            watcher.reader.close()
            return False

        refused = pytest.raises(HapticFieldbusError, match="not enabled: a real drive needs a confirmation")
        with Live(describe) as live, refused:
            run("wall", rig, rate=50.0, settings={"wall.stiffness": "max/2"}, confirm=confirm, live=live)
        states.append(statusword(bus))
    assert len(states) == 2
    assert all(state & STATE != OPERATION_ENABLED for state in states)
