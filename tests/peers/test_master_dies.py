"""kill -9 and SIGSTOP of a master that pushes a hand: real processes, and the drive tells when its torque is zero."""

import os
import signal
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.planning.deadlines import REMAINDER, EndCause
from tests.peers.hosts import GROUP, STARTS_WITHIN, free_port, line_of, require_multicast, start

pytestmark = pytest.mark.xdist_group("peers")

NODE, RATE = 5, 50.0
"""A slow loop, whose guard of 100 ms a busy machine does not reach by itself."""
RIG = f"""
[bus.can]
interface = "udp_multicast"
channel = "{GROUP}"

[axis.handle]
bus = "can"
node = {NODE}
profile = "generic_cia402"
encoder_counts_per_revolution = 4096
rated_torque = 0.4
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 10.0 }}
"""
"""The shipped bench, on a real bus."""
PROFILES = ("generic_cia402", str(Path(__file__).parents[1] / "system" / "profiles" / "life_guarded.toml"))
"""Of a drive that watches our heartbeat, and of one under life guarding."""
SETTING = ("wall.stiffness", "max/2")
BUS = f"udp_multicast:{GROUP}@1000000"
PUSHING = 30
"""Target torque with which the master pushes [‰ of rated torque]."""
OPERATION_ENABLED, STATE = 0x27, 0x6F
ATTEMPTS = 10
"""On a machine so busy that the loop trips before it is killed."""


class Drive:
    """The simulated drive as another program on the bus sees it."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus

    def is_pushed(self, master: "subprocess.Popen[str]") -> bool:
        """Wait until a set-point of the master pushes; False when the master ends before."""
        end = time.monotonic() + STARTS_WITHIN
        while time.monotonic() < end and master.poll() is None:
            heard = self._bus.recv(0.1)
            if heard is not None and heard.arbitration_id == 0x200 + NODE and len(heard.data) == 4:
                controlword, torque = struct.unpack("<Hh", heard.data)
                if controlword == 0x0F and abs(torque) >= PUSHING:
                    return True
        return False

    def read(self, index: int) -> int:
        """Upload an object of 16 bit by SDO."""
        while self._bus.recv(0) is not None:
            pass
        request = b"\x40" + index.to_bytes(2, "little") + bytes(5)
        self._bus.send(can.Message(arbitration_id=0x600 + NODE, data=request, is_extended_id=False))
        end = time.monotonic() + STARTS_WITHIN
        while time.monotonic() < end:
            heard = self._bus.recv(0.1)
            if heard is not None and heard.arbitration_id == 0x580 + NODE and heard.data[1:3] == request[1:3]:
                return int(struct.unpack_from("<h", heard.data, 4)[0])
        raise AssertionError("the simulated drive does not answer")

    def last_torque(self, since: float, largest: float) -> float:
        """Ask for the torque actual until it is zero; latest time since then at which torque was still asked for [s].

        The time is that of the question, and the answer is the torque at that time or later.
        """
        last = 0.0
        while (asked := time.monotonic() - since) < 5.0:
            if abs(self.read(0x6077)) <= largest:
                return last
            last = asked
        raise AssertionError("torque never ended")


@contextmanager
def pushing_master(
    rig: Path, profile: str, faults: str | None = None
) -> Iterator[tuple["subprocess.Popen[str]", Drive]]:
    """A drive in `simulate`, pushed into a wall by `run`, both in processes of their own; `faults` is a file."""
    port = free_port()
    require_multicast(port)
    hosted = (
        "simulate",
        "--drive",
        f"{profile}@{NODE}",
        "--bus",
        BUS,
        "--hand",
        "push",
        *(("--faults", faults) if faults else ()),
    )
    rig.write_text(RIG.replace(PROFILES[0], profile), encoding="utf-8")
    rendered = ("run", "wall", "--rig", str(rig), "--yes", "--json")
    options = ("--rate", f"{RATE:g}", "--duration", "60", "--set", "=".join(SETTING))
    for attempt in range(ATTEMPTS):
        drives = start(*hosted, port=port)
        master = None
        try:
            line_of(drives)
            with can.Bus(interface="udp_multicast", channel=GROUP, port=port) as bus:
                master = start(*rendered, *options, port=port)
                if Drive(bus).is_pushed(master):
                    yield master, Drive(bus)
                    return
                said = master.communicate()
        finally:
            for process in (master, drives):
                if process is not None:
                    process.kill()
                    process.communicate()
        assert attempt < ATTEMPTS - 1, said


def stated(rig: Path, cause: EndCause) -> float:
    """Times that the plan of this run states [s]."""
    compiled = plan("wall", rig=rig, rate=RATE, settings=dict([SETTING]))
    return next(each.seconds for each in compiled.deadlines if each.cause is cause)


@pytest.mark.thorough("two processes, and waits in real time")
@pytest.mark.parametrize(("number", "cause"), [(signal.SIGKILL, EndCause.KILLED), (signal.SIGSTOP, EndCause.STOPPED)])
@pytest.mark.parametrize("profile", PROFILES, ids=["heartbeat", "life guarding"])
def test_a_master_that_dies_leaves_no_torque_beyond_the_stated_time(
    number: signal.Signals, cause: EndCause, profile: str, tmp_path: Path
) -> None:
    rig = tmp_path / "rig.toml"
    with pushing_master(rig, profile) as (master, drive):
        died = time.monotonic()
        os.kill(master.pid, number)
        drive.read(0x6077)
        # The drive's process takes frames in order: by this answer it has heard all that the master had sent before.
        late = time.monotonic() - died
        assert drive.last_torque(died, REMAINDER * 1000) < stated(rig, cause) + late
        assert drive.read(0x6041) & STATE != OPERATION_ENABLED
        if number is signal.SIGSTOP:
            os.kill(master.pid, signal.SIGCONT)
            assert master.wait(STARTS_WITHIN) == 1, "it sees what its drive did, and does not enable again"
            assert drive.read(0x6041) & STATE != OPERATION_ENABLED
            assert drive.read(0x6077) == 0
