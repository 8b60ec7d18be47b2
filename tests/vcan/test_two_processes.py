"""`simulate` and `run` on a real SocketCAN interface, and what happens to them: torque-free in time, and told why."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from haptic_fieldbus.planning.deadlines import EndCause
from tests.system.test_tshark import assert_well_formed, dissected
from tests.vcan.links import Link
from tests.vcan.rendering import EMCY, HEARTBEAT, NODE, OPERATION_ENABLED, RPDO, STATE, TPDO, Busy, Rendering, tried

pytestmark = [pytest.mark.vcan, pytest.mark.thorough("two processes in a guest kernel")]

FOREIGN_FRAMES = 5400
"""Of others each second, as a bus at 1 Mbit/s can carry beside ours."""


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("rig") / "rig.toml"


@contextmanager
def candump(link: Link, path: Path) -> Iterator[None]:
    """Record all frames by another program."""
    with path.open("w") as file:
        process = subprocess.Popen(["candump", "-L", link.name], stdout=file)
        try:
            yield
        finally:
            process.terminate()
            process.wait()


def test_a_wall_is_rendered_and_what_is_on_the_bus_is_canopen(vcan: Link, rig: Path, tmp_path: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed: apt-get install tshark")
    path = tmp_path / "all.log"

    def body(run: Rendering) -> None:
        _, result = run.ended()
        assert result["cycles"] == 3.0 * run.rate
        assert run.watcher.is_free()

    with candump(vcan, path):
        tried(body, vcan, rig, duration=3.0)
    frames = dissected(tshark, path)
    assert_well_formed(frames)
    assert {0x080, TPDO, RPDO, HEARTBEAT, 0x77F} <= {seen.number("can.id") for seen in frames}


def _error_frame(run: Rendering) -> None:
    run.watcher.bus.send(can.Message(arbitration_id=0x040, is_error_frame=True, is_extended_id=False, data=bytes(8)))


def _storm(run: Rendering) -> None:
    for code in (0x8130, *range(0x2000, 0x2400)):
        data = code.to_bytes(2, "little") + bytes((1, 0, 0, 0, 0, 0))
        run.watcher.bus.send(can.Message(arbitration_id=EMCY, data=data, is_extended_id=False))


def _kill(run: Rendering) -> None:
    os.kill(run.master.pid, signal.SIGKILL)


EVENTS = {
    "bus-off": (_error_frame, EndCause.FAULT, "bus off", "the CAN controller went bus-off"),
    "emergency storm": (_storm, EndCause.FAULT, "emergency", "node 5 sent emergency 8130h"),
    "master killed": (_kill, EndCause.KILLED, None, ""),
}


@pytest.mark.parametrize("name", EVENTS)
def test_torque_is_gone_in_time_and_the_reason_is_named(name: str, vcan: Link, rig: Path) -> None:
    event, cause, trip, words = EVENTS[name]

    def body(run: Rendering) -> None:
        began = time.monotonic()
        event(run)
        run.watcher.read(0x6077)
        # The host takes frames in order: by this answer it has heard all that the master had sent before.
        late = time.monotonic() - began
        assert run.watcher.last_torque(began) < run.stated(cause) + late + run.watcher.slowest
        if trip is not None:
            assert words in run.ended(trip)[0]
        assert run.watcher.is_free()

    tried(body, vcan, rig)


FAULTS = {
    "missing_tpdos": ("count = 100000", "feedback lost", "feedback lost: the last from node 5"),
    "node_reset": ("", "node reset", "node 5 restarted"),
    "heartbeat_lost": ("", "heartbeat lost", "the heartbeat of node 5 was lost"),
    "missing_rpdos": ("count = 100000", "set-points do not act", "set-points do not act"),
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_the_drive_ends_the_run_by_its_name(kind: str, vcan: Link, rig: Path) -> None:
    values, trip, words = FAULTS[kind]

    def body(run: Rendering) -> None:
        told, _ = run.ended(trip)
        assert words in told
        assert run.watcher.is_free()

    # Set-points that no longer act are seen as soon as they change: while the handle still swings in the wall.
    at = 0.7 if kind == "missing_rpdos" else 3.0
    tried(body, vcan, rig, faults=f'[[fault]]\nkind = "{kind}"\nat = {at}\n{values}\n')


def test_a_drive_that_stands_still_is_told_and_is_free_when_it_goes_on(vcan: Link, rig: Path) -> None:
    def body(run: Rendering) -> None:
        os.kill(run.drive.pid, signal.SIGSTOP)
        told, _ = run.ended("feedback lost")
        assert f"feedback lost: the last from node {NODE}" in told
        while run.watcher.receive(0.0) is not None:
            """All that was on the bus."""
        last = next(frame for frame in reversed(run.watcher.heard) if frame.arbitration_id == TPDO)
        if last.data[0] & STATE != OPERATION_ENABLED:
            raise Busy("feedback was lost before the drive was stopped, so the drive confirmed")
        assert "Switch the power off" in told, "it did not confirm"
        os.kill(run.drive.pid, signal.SIGCONT)
        assert run.watcher.is_free()

    tried(body, vcan, rig)


def test_a_drive_that_is_gone_is_told_and_gets_no_torque_any_more(vcan: Link, rig: Path) -> None:
    def body(run: Rendering) -> None:
        run.drive.kill()
        killed = time.time()
        told, result = run.ended("feedback lost")
        assert f"feedback lost: the last from node {NODE}" in told
        while run.watcher.receive(0.0) is not None:
            """All that was on the bus."""
        sent = [frame for frame in run.watcher.heard if frame.arbitration_id == RPDO and frame.timestamp > killed]
        pushing = [frame.timestamp - killed for frame in sent if bytes(frame.data[2:4]) != bytes(2)]
        late = 1e-6 * max((result["timing"]["lateness_us"] or {"max": 0.0}).values())
        assert max([0.0, *pushing]) < run.stated(EndCause.FEEDBACK) + 1.0 / run.rate + late
        assert bytes(sent[-1].data) == bytes(4)

    tried(body, vcan, rig)


@pytest.mark.parametrize("soon", [True, False], ids=["up again soon", "down until the end"])
def test_an_interface_that_goes_down_is_named_and_the_drive_is_free(vcan: Link, rig: Path, *, soon: bool) -> None:
    """Down until the end, its guard alone frees the drive. Up again soon, it may confirm. Nothing enables again."""

    def body(run: Rendering) -> None:
        vcan.down()
        if not soon:
            run.master.wait(60.0)
        vcan.up()
        told, _ = run.ended("bus failed")
        assert vcan.name in told
        assert "the interface is down or gone" in told
        assert soon or "Switch the power off" in told
        assert run.master.returncode == 1
        assert run.watcher.is_free()

    tried(body, vcan, rig)


def test_a_bus_full_of_frames_for_others_is_nothing_to_a_master(vcan: Link, rig: Path) -> None:
    def body(run: Rendering) -> None:
        told, _ = run.ended()
        assert "another master" not in told
        assert run.watcher.is_free()

    gap = f"{1000.0 / FOREIGN_FRAMES:.3f}"
    with subprocess.Popen(["cangen", vcan.name, "-g", gap, "-I", "2A7", "-L", "8"]) as noise:
        try:
            tried(body, vcan, rig, duration=3.0)
        finally:
            noise.kill()
