"""How a foreign master reaches simulated drives: in its own process on `haptic_sim`, or in another one on a wire."""

import os
import pty
import random
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import Any

import can
import pytest

PROJECT = Path(__file__).resolve().parents[2]
GROUP = "239.74.163.2"
DRIVES = ("maxon_epos4@5", "generic_cia402@6")
SEED = 473
"""With it node 5 has a serial number with few ones: canopen's fastscan waits for a time-out at each."""
STYLE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
"""Codes that make text on a terminal bold, or clear a line."""
STARTS_WITHIN = 60.0
"""[s] A Python process with numpy, on a busy machine."""


@dataclass(frozen=True)
class Reach:
    """Arguments of `can.Bus` or `canopen.Network.connect`, and the node that the master is to talk to."""

    options: dict[str, Any]
    node: int


def in_this_process(node: int, drives: Sequence[str] = DRIVES) -> Reach:
    """The paced bus."""
    return Reach({"interface": "haptic_sim", "channel": ",".join(drives), "seed": SEED}, node)


@contextmanager
def in_another_process(node: int, drives: Sequence[str] = DRIVES, vcan: str | None = None) -> Iterator[Reach]:
    """`haptic-fieldbus simulate`, until the end; then it must end by itself, with status 0.

    It is on the SocketCAN interface `vcan`, without one on UDP multicast.
    """
    named = [word for drive in drives for word in ("--drive", drive)]
    port = free_port()
    if vcan is None:
        require_multicast(port)
        options = {"interface": "udp_multicast", "channel": GROUP, "port": port}
    else:
        options = {"interface": "socketcan", "channel": vcan}
    bus = f"{options['interface']}:{options['channel']}"
    process = start("simulate", *named, "--bus", bus, "--seed", str(SEED), port=None if vcan else port)
    try:
        for drive in drives:
            assert f"{drive.partition('@')[0]}, node {drive.partition('@')[2]}" in line_of(process)
        yield Reach(options, node)
        assert process.poll() is None, f"simulate ended early: {process.stderr.read() if process.stderr else ''}"
        process.send_signal(signal.SIGINT)
        assert process.wait(STARTS_WITHIN) == 0
    finally:
        process.kill()
        process.communicate()


def hear_signals() -> None:
    """Hear what a job in the background (Ctrl-C) or under `nohup` (SIGHUP) ignores; a run would leave it so."""
    for each in (signal.SIGINT, signal.SIGHUP):
        signal.signal(each, signal.SIG_DFL)


def start(*words: str, port: int | None, out: int = subprocess.PIPE) -> "subprocess.Popen[str]":
    """The command line in a process of its own; the bus name cannot say the port, python-can's environment can."""
    wire = {} if port is None else {"CAN_CONFIG": f'{{"port": {port}}}'}
    return subprocess.Popen(
        [sys.executable, "-m", "haptic_fieldbus", *words],
        cwd=PROJECT,
        env={**os.environ, **wire},
        stdout=out,
        stderr=out,
        text=True,
        preexec_fn=hear_signals,
    )


def typed(command: Sequence[str], environment: Mapping[str, str], folder: Path, answer: str) -> tuple[int, str]:
    """Exit status, and what a person sees on a terminal who types `answer` when a question ends with [y/N]."""
    ours, theirs = pty.openpty()
    wide = {**environment, "COLUMNS": "400", "NO_COLOR": "1"}
    process = subprocess.Popen(command, cwd=folder, env=wide, text=True, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    seen, asked = "", False
    try:
        while True:
            try:
                seen += os.read(ours, 4096).decode(errors="replace")
            except OSError:  # the end of the other side
                break
            if not asked and "[y/N]" in seen:
                asked = True
                os.write(ours, answer.encode() + b"\n")
        return process.wait(STARTS_WITHIN), STYLE.sub("", seen).replace("\r\n", "\n")
    finally:
        process.kill()
        process.communicate()
        os.close(ours)


def line_of(process: "subprocess.Popen[str]") -> str:
    """The next line that it prints; what it says on standard error when it ends instead."""
    assert process.stdout is not None
    assert process.stderr is not None
    giving_up = Timer(STARTS_WITHIN, process.kill)
    giving_up.start()
    try:
        line = process.stdout.readline()
    finally:
        giving_up.cancel()
    assert line, process.stderr.read()
    return line


def free_port() -> int:
    """Sockets of one machine hear every multicast group on their port, so each test has a port of its own."""
    while True:
        port = random.SystemRandom().randrange(20_000, 30_000)  # below the range that the system itself gives away
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                continue
            return port


def require_multicast(port: int) -> None:
    """Skip, and say so, where a datagram to the group does not come back."""
    try:
        with (
            can.Bus(interface="udp_multicast", channel=GROUP, port=port) as one,
            can.Bus(interface="udp_multicast", channel=GROUP, port=port) as other,
        ):
            one.send(can.Message(arbitration_id=0x7FF, is_extended_id=False))
            heard = other.recv(5.0)
    except (can.CanError, OSError) as error:
        pytest.skip(f"UDP multicast does not work on this machine: {error}")
    if heard is None:
        pytest.skip("UDP multicast does not work on this machine: a frame did not come back")
