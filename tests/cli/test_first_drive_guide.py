"""Steps of docs/how-to/your_first_real_drive.md are walked in its order on real sockets beside a simulated drive."""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from haptic_fieldbus.buses.canopen.opening import hears_its_group_alone
from haptic_fieldbus.cli.bench import view_lines
from haptic_fieldbus.running.watch import View
from tests.cli.test_beside_guide import TOO_SLOW
from tests.peers.hosts import GROUP, PROJECT, STARTS_WITHIN, free_port, line_of, require_multicast, typed

pytestmark = pytest.mark.xdist_group("peers")

TEXT = (PROJECT / "docs" / "how-to" / "your_first_real_drive.md").read_text(encoding="utf-8")
COMMANDS = re.findall(r"^```console\nhaptic-fieldbus (.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)
REHEARSE, SIMULATE, SCAN, WATCH, DOCTOR, RUN, WALL = COMMANDS
SCANNED, WATCHED, EXAMINED = re.findall(r"^```text\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
(LIMITS,) = re.findall(r"^```toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
ON_PAGE = "socketcan:can0@1000000"
(BUS,) = re.findall(r"--bus (\S+)", SIMULATE)
OTHER = "simulate --drive generic_cia402@9 --hand guide --bus udp_multicast:239.74.163.3@1000000"
"""A drive on another group of the same port."""


HERE = (sys.executable, "-m", "haptic_fieldbus")


class Walk:
    """The folder and the port in which the page is walked, and the program that is called."""

    def __init__(self, folder: Path, program: Sequence[str] = HERE, seen: str = str(PROJECT)) -> None:
        """`seen` is the PYTHONPATH of the program."""
        self.folder, self.port, self._program = folder, free_port(), program
        self.environment = {**os.environ, "CAN_CONFIG": f'{{"port": {self.port}}}', "PYTHONPATH": seen}

    def start(self, command: str) -> "subprocess.Popen[str]":
        words = command.replace(ON_PAGE, BUS).split()
        return subprocess.Popen(
            [*self._program, *words],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def done(self, command: str) -> tuple[int, str, str]:
        process = self.start(command)
        out, err = process.communicate(timeout=2 * STARTS_WITHIN)
        return process.returncode, out, err

    def answered(self, command: str) -> tuple[int, str]:
        """Exit status, and what a person sees who says yes."""
        return typed([*self._program, *command.split()], self.environment, self.folder, "y")

    @contextmanager
    def beside(self, command: str, said: str) -> Iterator[None]:
        """Host drives meanwhile; then they must end by themselves."""
        hosting = self.start(command)
        try:
            assert said in line_of(hosting)
            yield
            hosting.send_signal(signal.SIGINT)
            assert hosting.wait(STARTS_WITHIN) == 0
        finally:
            hosting.kill()
            hosting.communicate()


@contextmanager
def another_bench(walk: Walk) -> Iterator[None]:
    """A drive and a master on another group of the same port, with SYNC and heartbeats: another bus."""
    group = OTHER.partition("udp_multicast:")[2].partition("@")[0]
    with (
        walk.beside(OTHER, "generic_cia402, node 9"),
        can.Bus(interface="udp_multicast", channel=group, port=walk.port) as master,
    ):
        sync = master.send_periodic(can.Message(arbitration_id=0x080, is_extended_id=False), 0.02)
        beat = master.send_periodic(can.Message(arbitration_id=0x77F, data=b"\x05", is_extended_id=False), 0.05)
        yield
        sync.stop()
        beat.stop()


@pytest.fixture
def walk(tmp_path: Path) -> Iterator[Walk]:
    """A walk beside the simulated drive of the page, and beside another bench on another group."""
    walk = Walk(tmp_path)
    require_multicast(walk.port)
    with walk.beside(SIMULATE, "maxon_epos4, node 5"), another_bench(walk):
        yield walk


def test_the_page_has_the_commands_in_their_order() -> None:
    assert [command.split()[0] for command in COMMANDS] == [
        "rehearse", "simulate", "scan", "watch", "doctor", "run", "run"
    ]  # fmt: skip


@pytest.mark.thorough("real time beside drives in other processes")
def test_scan_watch_doctor_and_run_in_the_order_of_the_page(walk: Walk) -> None:
    walked(walk)


def walked(walk: Walk) -> None:
    """Type the commands of the page in their order."""
    rig = walk.folder / "rig.toml"
    _scanned(walk)
    # Step 4: the limits of the first day.
    before = re.sub(r"\[axis\.handle\.limits\]\n(?:.+\n)+", LIMITS, rig.read_text(encoding="utf-8"))
    rig.write_text(before, encoding="utf-8")
    _watched(walk)
    _examined(walk)
    assert rig.read_text(encoding="utf-8") == before, "so far everything was only read"
    for command in (RUN, re.sub(r"--duration \d+", "--duration 3", WALL)):
        status, seen = walk.answered(command)
        # The page's hand keeps the page's limits: only a computer without time for both may end the run.
        assert status == 0 or (TOO_SLOW.search(seen) and "the limit of" not in seen), seen
        assert "at most 2 % of rated torque, 0.5 m/s" in seen, "1 N of 50.3 N"
        if "drive watchdog fired" in seen:
            assert "[axis.handle.proved]" in rig.read_text(encoding="utf-8")
            assert "move the handle 10 mm to the positive side" in seen or command != RUN
    # After the run, as before it, the drive is off, and `scan` finds it as on the first day.
    _scanned(walk)


def _scanned(walk: Walk) -> None:
    status, out, err = walk.done(SCAN)
    assert status == 0, err
    heading, row, sure = out.splitlines()[-3:]
    assert len(re.findall(r"^\d+ ", out, re.MULTILINE)) == 1, "the drive on the other group is not heard"
    assert "another master" not in out
    shown = SCANNED.splitlines()
    assert heading.split() == shown[0].split()
    assert row.split()[0] == "5"
    assert row.split()[-1] == "maxon_epos4"
    assert "switch on disabled" in row
    assert sure.split(":")[0].split()[:2] == shown[2].split(":")[0].split()[:2]


def _watched(walk: Walk) -> None:
    command = re.sub(r"--duration \d+", "--duration 6 --json", WATCH)
    status, out, err = walk.done(command)
    assert status == 0, err
    seen = [json.loads(line)["axes"]["handle"] for line in out.splitlines()]
    assert len(seen) >= 3, "looks that a busy computer was late for are left out"
    places = [each["position"] for each in seen]
    assert max(places) - min(places) > 0.02, "a hand moves the handle, 60 mm in 2 s"
    assert {each["state"] for each in seen} == {"switch on disabled"}
    assert all(each["age_s"] < 0.5 and each["note"] is None and each["torque_actual"] == 0.0 for each in seen)
    # The line of the page has the parts of a line that is told.
    told = next(view_lines(View(**seen[-1])))
    assert len(told.split(" · ")) == len(WATCHED.split(" · "))


def _examined(walk: Walk) -> None:
    status, out, err = walk.done(DOCTOR)
    # A busy computer has a slow way there and back, and is told so.
    assert status == 0 or re.search(r"^not ok +round trip:", out, re.MULTILINE), out + err
    names = re.findall(r"^(?:ok|not ok|-) +([a-zA-Z ]+):", out, re.MULTILINE)
    shown = re.findall(r"^(?:ok|not ok|-) +([a-zA-Z ]+):", EXAMINED, re.MULTILINE)
    assert set(shown) - set(names) == {"state"}, "the state is that of a SocketCAN interface"
    assert {"scheduling", "memory", "clock", "wake up", "usb latency timer", "other masters"} <= set(names)


@pytest.mark.thorough("real time beside a drive in another process")
def test_while_another_master_commands_all_three_only_listen(walk: Walk) -> None:
    with can.Bus(interface="udp_multicast", channel=GROUP, port=walk.port) as other:
        assert hears_its_group_alone(other.fileno())
        sync = other.send_periodic(can.Message(arbitration_id=0x080, is_extended_id=False), 0.05)
        status, out, err = walk.done(SCAN)
        assert (status, f"another master on udp_multicast:{GROUP}" in out) == (0, True), err
        status, out, err = walk.done(WATCH.replace("--duration 20", "--duration 1 --json"))
        assert (status, f"another master on udp_multicast:{GROUP}" in err) == (0, True)
        assert json.loads(out.splitlines()[0])["axes"]["handle"]["statusword"] is None
        status, out, err = walk.done(f"{DOCTOR} --json")
        checks = {check["name"]: check["ok"] for check in json.loads(out)["checks"]}
        assert (status, checks["other_masters"], checks["round_trip"]) == (0, False, None)
        sync.stop()
        heard = {frame.arbitration_id for frame in iter(lambda: other.recv(0.1), None)}
        assert heard <= {0x080, 0x705}, "SYNC of our own, and heartbeats of the drive"
