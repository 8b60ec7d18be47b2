"""Any frame at all, sent through python-can: the simulated world neither falls over nor stands still.

What each frame may do to one drive is looked at in `test_random_frames`; here there are two, their wire, and threads.
"""

import struct
from concurrent.futures import ThreadPoolExecutor

import can
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from tests.lanes import examples

NODES = (5, 6)
CHANNEL = "maxon_epos4@5,generic_cia402@6"
NMT_STATES = {0, 4, 5, 127}
STATUS_MASK, STATES = 0x006F, {0x00, 0x40, 0x60, 0x21, 0x23, 0x27, 0x07, 0x0F, 0x2F, 0x08, 0x28}
"""CiA 402-2, table 30: what the bits of 006Fh may say; where bit 5 does not matter, both."""

# Identifiers that somebody listens to, and others.
BASES = (0x000, 0x080, 0x100, 0x180, 0x200, 0x280, 0x300, 0x400, 0x500, 0x580, 0x600, 0x700, 0x77F, 0x7E4, 0x7E5)
identifiers = st.one_of(
    st.builds(lambda base, node: min(base + node, 0x7FF), st.sampled_from(BASES), st.sampled_from((0, *NODES))),
    st.integers(0, 0x7FF),
)
OBJECTS = (
    0x1000, 0x1005, 0x1008, 0x1010, 0x1016, 0x1017, 0x1018, 0x1029, 0x1400, 0x1600, 0x1800, 0x1A00, 0x5FF0, 0x6040,
    0x6060, 0x6071, 0x607A, 0x60FF,
)  # fmt: skip
# Half of the octets are made so that they reach beyond the first check of a service.
sdo = st.builds(
    lambda command, index, subindex, data: struct.pack("<BHB", command, index, subindex) + data,
    st.integers(0, 255),
    st.sampled_from(OBJECTS),
    st.integers(0, 8),
    st.binary(min_size=4, max_size=4),
)
frames = st.builds(
    lambda can_id, data, remote, extended: can.Message(
        arbitration_id=can_id | (1 << 28 if extended else 0),
        data=None if remote else data,
        dlc=len(data),
        is_remote_frame=remote,
        is_extended_id=extended,
    ),
    identifiers,
    st.one_of(st.binary(max_size=8), sdo),
    st.sampled_from((False,) * 9 + (True,)),
    st.sampled_from((False,) * 9 + (True,)),
)


@settings(max_examples=examples(100))
@given(st.lists(frames, max_size=60), st.integers(0, 3))
def test_any_frames_leave_a_world_that_answers(sequence: list[can.Message], gap_ms: int) -> None:
    with SimulatedBus(CHANNEL, clock=VirtualClock()) as bus:
        for message in sequence:
            bus.send(message)
            bus.recv(gap_ms * 1e-3)
        assert_alive(bus)


@settings(max_examples=3)
@given(st.lists(frames, min_size=100, max_size=100))
def test_any_frames_of_several_threads_leave_a_paced_world_that_answers(sequence: list[can.Message]) -> None:
    with SimulatedBus(CHANNEL) as bus, ThreadPoolExecutor(3) as threads:
        listening = threads.submit(_listen, bus, 0.1)
        for sending in [threads.submit(_send_all, part) for part in (sequence[::2], sequence[1::2])]:
            sending.result(60)
        listening.result(60)
        assert_alive(bus)


def _send_all(sequence: list[can.Message]) -> None:
    with SimulatedBus(CHANNEL) as bus:
        for message in sequence:
            bus.send(message, timeout=10.0)


def _listen(bus: SimulatedBus, timeout: float) -> None:
    """Take what comes, until nothing comes in this time [s]."""
    while (message := bus.recv(timeout)) is not None:
        assert len(message.data) <= 8


def assert_alive(bus: SimulatedBus) -> None:
    """After a reset of all nodes each says what it is, in a state of the table; LSS may have moved it to another ID."""
    for world_node in NODES:
        slave = bus.world.slave(world_node)
        assert slave.node.state.value in NMT_STATES
        assert slave.drive.objects.statusword.value & STATUS_MASK in STATES
    while bus.recv(0.0) is not None:
        pass
    bus.send(can.Message(arbitration_id=0, data=bytes((129, 0)), is_extended_id=False))
    booted = 0
    for _ in range(100):  # heartbeats and node guarding may still be heard before the reset
        message = bus.recv(0.5)
        booted += message is not None and message.arbitration_id & 0x780 == 0x700 and message.data == b"\0"
        if booted == len(NODES):
            return
    raise AssertionError(f"{booted} drives came back")
