"""A foreign master against the simulated drive: canopen's own SDO client and PDO classes, without its thread."""

import struct
from collections.abc import Iterator

import can
import canopen
import numpy as np
import pytest

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.sim.bench import NODE, axis
from tests.sim.canopen.responses import Responses

NAMES = ["maxon_epos4", "generic_cia402"]


class Bench:
    """canopen's network and node on a simulated wire."""

    def __init__(self, name: str) -> None:
        self.clock = VirtualClock()
        self.world = World(self.clock)
        self.profile = load_profile(name)
        self.world.add(DriveOnBus(NODE, self.profile, axis(coulomb_friction=0.0)))
        self.bus = SimulatedBus(world=self.world)
        self.network = canopen.Network()
        self.network.bus = self.bus
        self.node = canopen.RemoteNode(NODE, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        self.node.associate_network(self.network)
        self.node.sdo.responses = Responses(self.network, self.bus)
        self.network.nodes[NODE] = self.node

    def read(self, index: int, subindex: int = 0) -> int:
        return int.from_bytes(self.node.sdo.upload(index, subindex), "little")

    def write(self, index: int, subindex: int, value: int, size: int) -> None:
        self.node.sdo.download(index, subindex, (value & (1 << 8 * size) - 1).to_bytes(size, "little"))

    def map(self, communication: int, can_id: int, type_: int, entries: list[int]) -> None:
        self.write(communication, 1, can_id | 1 << 31, 4)
        self.write(communication, 2, type_, 1)
        self.write(communication + 0x200, 0, 0, 1)
        for position, entry in enumerate(entries, start=1):
            self.write(communication + 0x200, position, entry, 4)
        self.write(communication + 0x200, 0, len(entries), 1)
        self.write(communication, 1, can_id, 4)

    def period(self, deadline_ns: int, controlword: int, target: int) -> tuple[int, int]:
        """SYNC and RPDO by hand, the TPDO decoded."""
        self.clock.sleep_until(deadline_ns)
        self.bus.send(can.Message(arbitration_id=0x80, is_extended_id=False))
        message = self.bus.recv(0.0005)
        assert message is not None
        statusword, position = struct.unpack("<Hi", message.data)
        data = struct.pack("<Hh", controlword, target)
        self.bus.send(can.Message(arbitration_id=0x200 + NODE, data=data, is_extended_id=False))
        return statusword, position


@pytest.fixture(params=NAMES)
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    subject = Bench(request.param)
    yield subject
    subject.bus.shutdown()


def test_identity_and_name_are_read(bench: Bench) -> None:
    assert bench.read(0x1000) == 0x0002_0192
    assert bench.read(0x1018) == 4
    name = bench.node.sdo.upload(0x1008, 0)
    assert len(name) > 4
    assert name.decode()


def test_a_segmented_download_is_understood(bench: Bench) -> None:
    bench.node.sdo.download(0x6060, 0, b"\x0a", force_segment=True)
    assert bench.read(0x6061) == 10


@pytest.mark.parametrize(
    ("index", "subindex", "data", "code"),
    [
        (0x2FFF, 0, b"\0", 0x0602_0000),
        (0x1018, 9, b"\0", 0x0609_0011),
        (0x6041, 0, b"\0\0", 0x0601_0002),
        (0x6040, 0, b"\0\0\0\0", 0x0607_0012),
        (0x6040, 0, b"\0", 0x0607_0013),
        (0x6060, 0, b"\x63", 0x0609_0030),
        (0x1A00, 1, bytes(4), 0x0601_0000),
    ],
)
def test_refusals_reach_the_foreign_client(bench: Bench, index: int, subindex: int, data: bytes, code: int) -> None:
    with pytest.raises(canopen.SdoAbortedError) as caught:
        bench.node.sdo.download(index, subindex, data)
    assert caught.value.code == code


def test_the_drive_is_mapped_enabled_and_moved_and_the_motion_is_the_closed_form(bench: Bench) -> None:
    bench.map(0x1800, 0x180 + NODE, 1, [0x6041_0010, 0x6064_0020])
    bench.map(0x1400, 0x200 + NODE, 255, [0x6040_0010, 0x6071_0010])
    assert bench.read(0x1A00, 2) == 0x6064_0020
    bench.write(0x6060, 0, 10, 1)
    bench.network.nmt.send_command(1)
    start_ns = bench.clock.now_ns() + 1_000_000
    states = []
    for k, controlword in enumerate((0x06, 0x07, 0x0F, 0x0F)):
        statusword, _ = bench.period(start_ns + k * 1_000_000, controlword, 0)
        states.append(statusword & 0x6F)
    assert states == [0x60, 0x21, 0x23, 0x27]
    for k in range(4, 104):
        _, counts = bench.period(start_ns + k * 1_000_000, 0x0F, -80)
    trajectory = bench.world.trajectory(NODE)
    times, torques = trajectory.targets()
    begin = times[np.flatnonzero(torques)[0]]
    # J·ω' = u·(1 − e^(−t/T)) − b·ω, integrated twice.
    inertia, damping, target = 4e-5, 1e-4, -0.032
    lag = 1 / (2 * np.pi * bench.profile.timing.torque_bandwidth)
    pole = damping / inertia
    fast = target / inertia / (1 / lag - pole)
    t = (trajectory.end_ns - begin) * 1e-9
    slow = target / damping
    position = slow * t - (slow + fast) / pole * (1 - np.exp(-pole * t)) + fast * lag * (1 - np.exp(-t / lag))
    sampled, _, _ = trajectory.sample(np.array([trajectory.end_ns]))
    assert sampled[0] == pytest.approx(position, rel=1e-9)
    assert counts == pytest.approx(position * 4096 / (2 * np.pi), abs=60)


def test_emergencies_and_heartbeats_are_understood_by_the_foreign_classes(bench: Bench) -> None:
    bench.write(0x1017, 0, 10, 2)
    bench.network.nmt.send_command(1)
    bench.world.run()
    bench.world.slave(NODE).drive.fault(0x4210, bench.clock.now_ns())
    end_ns = bench.clock.now_ns() + 30_000_000
    while bench.clock.now_ns() < end_ns:
        message = bench.bus.recv((end_ns - bench.clock.now_ns()) * 1e-9)
        if message is not None:
            bench.network.notify(message.arbitration_id, message.data, message.timestamp)
    assert bench.node.nmt.state == "OPERATIONAL"
    assert [(error.code, error.register) for error in bench.node.emcy.active] == [(0x4210, 0x09)]
