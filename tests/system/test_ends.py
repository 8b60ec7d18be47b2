"""Ends of runs in processes of their own: signals, kill −9, a sleeping host, a full disk; memory of a long run."""

import csv
import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random

import can
import pytest

from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start

pytestmark = pytest.mark.xdist_group("peers")
BUS = f"udp_multicast:{GROUP}@1000000"
RATE = 20.0
"""[Hz]; two processes keep it also on a busy machine: the drive waits for a quarter of a second."""
NODE = 5


@pytest.fixture
def port() -> Iterator[int]:
    """Of a bus with a drive on it, moved to and fro by a hand."""
    port = free_port()
    require_multicast(port)
    drive = start("simulate", "--drive", f"maxon_epos4@{NODE}", "--bus", BUS, "--hand", "sine", port=port)
    try:
        line_of(drive)
        yield port
    finally:
        drive.kill()
        drive.communicate()


class Listener:
    """Hears all frames; the drive's TPDO tells its state, our RPDO the torque that is asked for."""

    def __init__(self, port: int) -> None:
        self.bus = can.Bus(interface="udp_multicast", channel=GROUP, port=port)

    def until(self, run: "subprocess.Popen[str]", seen: Callable[[can.Message], bool]) -> None:
        """Wait for a frame."""
        for _ in range(20_000):
            message = self.bus.recv(20.0)
            assert message is not None, "no frame came"
            assert run.poll() is None, run.communicate()[1]
            if seen(message):
                return
        raise AssertionError("the frame did not come")

    def until_torque(self, run: "subprocess.Popen[str]") -> None:
        """Wait until a set-point asks for torque: the handle is in contact."""
        self.until(run, asks_for_torque)

    def last_set_point(self) -> bytes:
        """The last one of all that were heard; the run is over. The drive's heartbeats go on."""
        last = b"none"
        while (message := self.bus.recv(0.0)) is not None:
            if message.arbitration_id == 0x200 + NODE:
                last = bytes(message.data)
        return last


def asks_for_torque(message: can.Message) -> bool:
    return message.arbitration_id == 0x200 + NODE and any(message.data[2:4])


def configures(message: can.Message) -> bool:
    """An SDO download of our master."""
    return message.arbitration_id == 0x600 + NODE and message.data[0] >> 5 == 1


def enables(message: can.Message) -> bool:
    return message.arbitration_id == 0x200 + NODE and message.data[0] in (0x06, 0x07)


def is_enabled(message: can.Message) -> bool:
    return message.arbitration_id == 0x200 + NODE and message.data[0] == 0x0F


@pytest.fixture
def listener(port: int) -> Iterator[Listener]:
    listener = Listener(port)
    yield listener
    listener.bus.shutdown()


STATUS = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}


def rendering(port: int, *words: str, out: int = subprocess.PIPE) -> "subprocess.Popen[str]":
    return start(
        "run", "wall", "--set", "wall.stiffness=100", "--set", "wall.position=0.005",
        "--drive", "maxon_epos4", "--node", str(NODE), "--bus", BUS, "--rate", str(RATE),
        "--duration", "60", "--yes", "--force", *words, port=port, out=out,
    )  # fmt: skip


def ended(process: "subprocess.Popen[str]") -> tuple[int, str, str]:
    out, err = process.communicate(timeout=STARTS_WITHIN)
    return process.returncode, out, err


@pytest.mark.thorough("two processes for seconds")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_signal_ends_a_run_torque_free_and_in_order(name: str, port: int, listener: Listener, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    process = rendering(port, "--json", "--record", str(path))
    listener.until_torque(process)
    # Again and again, as somebody does who does not want to wait: nothing interrupts the way to zero.
    process.send_signal(getattr(signal, name))
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    status, out, err = ended(process)
    assert not any(listener.last_set_point())
    result = json.loads(out)
    assert result["trips"] == []
    # Signals that are pending together are delivered by number, so that an interrupt can overtake a termination.
    assert result["stopped"]["signal"] in (name, "SIGINT")
    assert status == STATUS[result["stopped"]["signal"]], err
    assert f"{result['stopped']['message']}\n" in err
    assert result["cycles"] > 0
    with path.open() as file:
        assert len(list(csv.DictReader(file))) >= result["cycles"]


PHASES = {"configuring": configures, "enabling": enables, "enabled": is_enabled, "in contact": asks_for_torque}


@pytest.mark.thorough("two processes for seconds")
@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("seed", range(3))
def test_signals_in_every_phase_end_a_run_torque_free(phase: str, seed: int, port: int, listener: Listener) -> None:
    """The first of one to four signals counts, and the object is printed whenever it comes."""
    draw = Random(f"{phase}/{seed}")
    names = draw.choices(list(STATUS), k=draw.randint(1, 4))
    process = rendering(port, "--json")
    listener.until(process, PHASES[phase])
    for name in names:
        process.send_signal(getattr(signal, name))
    status, out, err = ended(process)
    assert status in {STATUS[name] for name in names}, err
    assert not any(listener.last_set_point()[2:4])
    assert json.loads(out)["stopped"]["message"] in err


@pytest.mark.thorough("two processes for seconds")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signals_while_the_object_is_printed_do_not_cut_it(name: str, port: int) -> None:
    process = rendering(port, "--json", "--duration", "1")
    assert process.stdout is not None
    begin = os.read(process.stdout.fileno(), 1).decode()
    for _ in range(3):
        process.send_signal(getattr(signal, name))
    status, out, err = ended(process)
    # It may have been printed, and the process have ended, before the signals came.
    assert status in (0, STATUS[name]), err
    assert json.loads(begin + out)["cycles"] == RATE


@pytest.mark.thorough("two processes, and a reader that does not read")
def test_a_stopped_terminal_holds_up_neither_zero_torque_nor_the_end(port: int, listener: Listener) -> None:
    master, slave = pty.openpty()
    process = rendering(port, "--prove", out=slave)
    listener.until_torque(process)
    os.write(master, b"\x13")  # Ctrl-S
    process.send_signal(signal.SIGTERM)
    try:
        assert process.wait(STARTS_WITHIN) == 143
        assert not any(listener.last_set_point())
    finally:
        process.kill()
        os.close(slave)
        os.close(master)


@pytest.mark.thorough("two processes for seconds")
@pytest.mark.parametrize("suffix", [".csv", ".log", ".blf"])
def test_a_killed_run_leaves_its_recording(suffix: str, port: int, listener: Listener, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    process = rendering(port, "--record", str(path))
    listener.until_torque(process)
    fewest = str(0.2 * RATE)
    if suffix == ".csv":  # on a busy computer the process that writes the rows waits long
        subprocess.run([sys.executable, "-c", WAIT, "rows", str(path), fewest], timeout=STARTS_WITHIN, check=True)
    process.kill()
    process.communicate()
    if suffix == ".csv":
        # The process that writes the rows ends after the run, when it has written all that it was handed.
        subprocess.run([sys.executable, "-c", WAIT, "end", str(path), fewest], timeout=STARTS_WITHIN, check=True)
        with path.open() as file:
            rows = list(csv.DictReader(file))
        assert len(rows) > 0.2 * RATE
        assert all(row["handle.position"] for row in rows)
    else:
        with can.LogReader(path) as reader:
            assert all(message.dlc <= 8 for message in reader)


WAIT = """
import sys, time
from pathlib import Path
path, size, fewest = Path(sys.argv[2]), -1, float(sys.argv[3])
while (sys.argv[1] == "end" and path.stat().st_size != size) or path.read_bytes().count(b"\\n") <= fewest + 1:
    size = path.stat().st_size
    time.sleep(0.5)
"""


@pytest.mark.thorough("two processes for seconds")
def test_a_host_that_slept_ends_torque_free(port: int, listener: Listener) -> None:
    process = rendering(port, "--json")
    listener.until_torque(process)
    process.send_signal(signal.SIGSTOP)
    subprocess.run([sys.executable, "-c", "import time; time.sleep(1)"], check=True)
    process.send_signal(signal.SIGCONT)
    status, out, err = ended(process)
    assert status in (1, 3), err
    assert json.loads(out)["trips"]
    assert not any(listener.last_set_point())


FULL = Path("/dev/full")


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
@pytest.mark.thorough("a process for each suffix", quick=(".csv",))
@pytest.mark.parametrize("suffix", [".csv", ".log"])
def test_a_full_disk_ends_the_recording_and_the_exit_status_tells(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    path.symlink_to(FULL)
    process = start("run", "wall", "--duration", "2", "--record", str(path), "--json", port=0)
    status, out, err = ended(process)
    assert status == 1
    assert json.loads(out)["cycles"] == 2000
    assert "the recording is incomplete: No space left on device" in err


@pytest.mark.skipif(not FULL.exists(), reason="needs /dev/full")
def test_a_recording_that_cannot_be_begun_is_refused_before_anything_moves(tmp_path: Path) -> None:
    """A .blf file begins with a header."""
    path = tmp_path / "run.blf"
    path.symlink_to(FULL)
    status, out, err = ended(start("run", "wall", "--duration", "1", "--record", str(path), "--json", port=0))
    assert status == 1
    assert json.loads(out)["cycles"] == 0
    assert f"cannot record to {path}: No space left on device" in err


LONG = """
import json, sys
from pathlib import Path
from haptic_fieldbus import run
record = Path(sys.argv[2]) if len(sys.argv) > 2 else None
result = run("wall", hand="release", duration=float(sys.argv[1]), rate=1000.0, record=record)
# The peak since the program was loaded; that of `getrusage` includes the parent, as it was when it forked.
status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
memory = int(status["VmHWM"].split()[0])
print(json.dumps({"kib": memory, "cycles": result.cycles, "points": len(result.traces[0].times)}))
"""


@pytest.mark.parametrize(
    "seconds",
    [
        pytest.param(60, id="a minute", marks=pytest.mark.thorough("renders a minute")),
        pytest.param(300, id="five minutes", marks=pytest.mark.thorough("renders minutes")),
        pytest.param(1800, id="half an hour", marks=pytest.mark.soak("renders half an hour")),
    ],
)
def test_a_long_run_that_is_recorded_needs_less_than_300_mb(seconds: int, tmp_path: Path) -> None:
    told = rendered_long(seconds, tmp_path / "run.mcap")
    assert told["cycles"] == 1000 * seconds
    assert told["kib"] * 1024 < 300e6
    assert told["points"] < 250_000


LARGEST_GROWTH = 100
"""Octets a period: its four times take 32, and of the motion of the shaft some points are kept for the picture."""


@pytest.mark.thorough("renders five minutes")
@pytest.mark.parametrize("suffix", [".mcap", ".log", ".csv"])
def test_four_times_the_periods_need_little_more_memory(suffix: str, tmp_path: Path) -> None:
    few, many = (rendered_long(seconds, tmp_path / f"run{seconds}{suffix}") for seconds in (60, 240))
    assert (many["kib"] - few["kib"]) * 1024 < LARGEST_GROWTH * (many["cycles"] - few["cycles"])


def rendered_long(seconds: int, record: Path) -> dict[str, int]:
    done = subprocess.run(
        [sys.executable, "-c", LONG, str(seconds), str(record)], capture_output=True, text=True, check=True,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    told: dict[str, int] = json.loads(done.stdout)
    return told
