"""Guards proved over real processes and a real socket, and what the command line says of it."""

import json
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start
from tests.peers.test_master_dies import BUS, NODE, RATE, RIG, Drive

pytestmark = pytest.mark.xdist_group("peers")
DEAD = '[[fault]]\nkind = "dead_guard"\n'


@contextmanager
def hosted(*words: str) -> Iterator[int]:
    """A simulated drive in a process of its own; yields its port."""
    port = free_port()
    require_multicast(port)
    drive = start("simulate", "--drive", f"generic_cia402@{NODE}", "--bus", BUS, *words, port=port)
    try:
        line_of(drive)
        yield port
    finally:
        drive.kill()
        drive.communicate()


def run(port: int, rig: Path, *words: str) -> tuple[int, str, str]:
    """Render a wall with a guard of 100 ms, which a busy machine does not reach by itself."""
    rendered = ("run", "wall", "--rig", str(rig), "--yes", "--rate", f"{RATE:g}", "--duration", "0.4")
    process = start(*rendered, "--set", "wall.stiffness=max/2", *words, port=port)
    out, err = process.communicate(timeout=STARTS_WITHIN)
    return process.returncode, out, err


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    return path


@pytest.mark.thorough("two processes for seconds")
def test_a_guard_is_proved_before_the_first_scene_of_a_rig_and_not_before_the_second(rig: Path) -> None:
    with hosted() as port:
        status, out, err = run(port, rig)
        assert status == 0, err
        assert "about to test the drive watchdog of axis handle (the rig file has no watchdog proof yet)" in err
        assert "axis handle: drive watchdog fired after " in out
        assert "(set to 100 ms)" in out
        assert rig.read_text().startswith(f"{RIG}\n[axis.handle.proved]\nserial = 0x")
        before = rig.read_bytes()
        status, out, err = run(port, rig, "--json")
        assert status == 0, err
        assert json.loads(out)["guards"] == []
        assert rig.read_bytes() == before
        status, out, err = run(port, rig, "--json", "--prove")
        assert status == 0, err
        (proof,) = json.loads(out)["guards"]
        assert proof["guard_ms"] == 100.0
        assert 50.0 < proof["measured_ms"] <= 141.0


@pytest.mark.thorough("two processes for seconds")
def test_ctrl_c_while_the_drive_is_left_alone_frees_it(rig: Path, tmp_path: Path) -> None:
    faults = tmp_path / "faults.toml"
    faults.write_text(DEAD, encoding="utf-8")  # so that nothing else frees it
    with hosted("--faults", str(faults)) as port, can.Bus(interface="udp_multicast", channel=GROUP, port=port) as bus:
        process = start(
            "run", "wall", "--rig", str(rig), "--yes", "--rate", "5", "--set", "wall.stiffness=max/2", port=port
        )
        words: list[int] = []
        while len(words) < 2 or words[-1] != 0x0F:
            heard = bus.recv(STARTS_WITHIN)
            assert heard is not None
            words += [heard.data[0]] if heard.arbitration_id == 0x200 + NODE else []
        # The guard is a second, and four of them are waited for: the last set-point was sent, and nothing follows.
        process.send_signal(signal.SIGINT)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=STARTS_WITHIN)
        assert process.returncode == 130, out
        assert "stopped by you before enabling: no torque was applied" in err
        assert Drive(bus).read(0x6041) & 0x6F != 0x27
        assert rig.read_text() == RIG


@pytest.mark.thorough("two processes for seconds")
def test_a_drive_that_never_lets_go_is_refused_with_what_was_measured(rig: Path, tmp_path: Path) -> None:
    faults = tmp_path / "faults.toml"
    faults.write_text(DEAD, encoding="utf-8")
    with hosted("--faults", str(faults)) as port:
        status, out, err = run(port, rig, "--json")
        assert status == 4, err
        assert "did not fire in time" in err
        assert "and did not switch off (watchdog 100 ms" in err
        told = json.loads(out)
        assert told["cycles"] == 0
        assert told["guards"] == [{"axis": "handle", "guard_ms": 100.0, "measured_ms": None}]
        # From now on the plan says so, before any bus is opened.
        status, out, err = run(port, rig)
        assert status == 4
        assert "did not fire in the test on" in err
        assert 'axis.handle.emergency_stop = "power"' in err
        rig.write_text(rig.read_text().replace("[axis.handle]\n", '[axis.handle]\nemergency_stop = "power"\n'))
        status, out, err = run(port, rig)
        assert status == 0, err
        assert "at most 5 % of rated torque" in err
