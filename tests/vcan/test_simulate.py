"""`simulate` on a real SocketCAN interface that goes down and comes back."""

import signal
import subprocess
import sys
import time
from pathlib import Path

import can
import pytest

from tests.peers.hosts import hear_signals
from tests.vcan.links import Link

pytestmark = [pytest.mark.vcan, pytest.mark.thorough("a process in a guest kernel")]

PROJECT = Path(__file__).parents[2]
NODE = 5
HEARTBEAT_50_MS = bytes.fromhex("2B 17 10 00 32 00 00 00")
PATIENCE = 60.0
"""[s] for a heartbeat, on a busy machine."""


def beats(link: Link) -> int:
    """Heartbeats of the drive that another program hears, three at most; 0 when none comes."""
    with can.Bus(interface="socketcan", channel=link.name) as bus:
        end, heard = time.monotonic() + PATIENCE, 0
        while heard < 3 and time.monotonic() < end:
            message = bus.recv(0.1)
            heard += message is not None and message.arbitration_id == 0x700 + NODE
        return heard


def test_drives_go_on_when_the_interface_goes_down_and_comes_back(vcan: Link) -> None:
    words = ("simulate", "--drive", f"generic_cia402@{NODE}", "--bus", f"{vcan.bus}@1000000")
    process = subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *words],
        cwd=PROJECT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_signals,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("ready")
        with can.Bus(interface="socketcan", channel=vcan.name) as bus:
            bus.send(can.Message(arbitration_id=0x600 + NODE, data=HEARTBEAT_50_MS, is_extended_id=False))
        assert beats(vcan) == 3
        for _ in range(2):
            vcan.down()
            time.sleep(1.2)
            vcan.up()
            assert beats(vcan) == 3
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
        process.communicate()
    assert (process.returncode, out) == (0, "")
    assert err.count("the interface is down or gone") == err.count("frames pass again") == 2


def test_the_kernel_wakes_it_only_for_frames_that_concern_its_drives(vcan: Link) -> None:
    words = ("simulate", "--drive", f"generic_cia402@{NODE}", "--bus", f"{vcan.bus}@1000000")
    process = subprocess.Popen([sys.executable, "-m", "haptic_fieldbus", *words], cwd=PROJECT,
                               stdout=subprocess.PIPE, text=True)  # fmt: skip
    try:
        assert process.stdout is not None
        assert process.stdout.readline().startswith("ready")
        everything = Path("/proc/net/can/rcvlist_all").read_text()
        single = Path("/proc/net/can/rcvlist_sff").read_text()
    finally:
        process.kill()
        process.communicate()
    assert vcan.name not in everything.replace(f"({vcan.name}: no entry)", "")
    wanted = {int(line.split()[1], 16) & 0x7FF for line in single.splitlines() if line.split()[:1] == [vcan.name]}
    assert {0x000, 0x080, 0x600 + NODE, 0x200 + NODE, 0x7E5} <= wanted
    assert 0x2A7 not in wanted
