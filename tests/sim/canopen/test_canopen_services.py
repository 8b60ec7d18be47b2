"""Foreign masters and the services of CiA 301 and CiA 305: canopen's block transfers, LSS master, TIME, NMT."""

from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import can
import canopen
import pytest
from canopen.lss import (
    CS_INQUIRE_PRODUCT_CODE,
    CS_INQUIRE_REVISION_NUMBER,
    CS_INQUIRE_SERIAL_NUMBER,
    CS_INQUIRE_VENDOR_ID,
    LssError,
)

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from tests.sim.bench import NODE, axis
from tests.sim.canopen.responses import Responses

USER_DATA = 0x5FF0
TEN_KB = bytes(range(256)) * 40
S = 1_000_000_000


class Foreign:
    """canopen's network, its SDO client of a node and its LSS master on a simulated wire, without threads."""

    def __init__(self, *nodes: int) -> None:
        self.clock = VirtualClock()
        self.world = World(self.clock)
        for node in nodes or (NODE,):
            self.world.add(DriveOnBus(node, load_profile("generic_cia402"), axis()))
        self.bus = SimulatedBus(world=self.world)
        self.network = canopen.Network()
        self.network.bus = self.bus
        lss: Any = self.network.lss
        lss.responses = Responses(self.network, self.bus)
        self.node = self.add(NODE)

    def add(self, number: int) -> canopen.RemoteNode:
        node = canopen.RemoteNode(number, canopen.ObjectDictionary())  # type: ignore[no-untyped-call]
        node.associate_network(self.network)
        node.sdo.responses = Responses(self.network, self.bus)
        self.network.nodes[number] = node
        return node

    def hear(self, duration_ns: int) -> list[can.Message]:
        """Frames that come for a while; canopen gets it too."""
        end_ns, heard = self.clock.now_ns() + duration_ns, []
        while (rest_ns := end_ns - self.clock.now_ns()) > 0:
            message = self.bus.recv(rest_ns * 1e-9)
            if message is not None:
                heard.append(message)
                self.network.notify(message.arbitration_id, message.data, message.timestamp)
        return heard


@pytest.fixture
def foreign(monkeypatch: pytest.MonkeyPatch) -> Iterator[Foreign]:
    monkeypatch.setattr("canopen.lss.time.sleep", lambda _seconds: None)  # virtual time does not wait
    subject = Foreign()
    yield subject
    subject.bus.shutdown()


@pytest.mark.thorough("2 cases of one rule", quick=1)
@pytest.mark.parametrize("crc", [True, False])
def test_ten_kilobytes_go_there_and_back_in_blocks(foreign: Foreign, crc: bool) -> None:
    sdo = foreign.node.sdo
    with sdo.open(
        USER_DATA, 1, "wb", size=len(TEN_KB), buffering=7, block_transfer=True, request_crc_support=crc
    ) as stream:
        stream.write(TEN_KB)
    with sdo.open(USER_DATA, 1, "rb", block_transfer=True, request_crc_support=crc) as stream:
        assert stream.read() == TEN_KB


def test_ten_kilobytes_go_there_and_back_in_segments(foreign: Foreign) -> None:
    foreign.node.sdo.download(USER_DATA, 2, TEN_KB)
    assert foreign.node.sdo.upload(USER_DATA, 2) == TEN_KB


def test_blocks_are_much_faster_than_segments(foreign: Foreign) -> None:
    durations = []
    for block in (False, True):
        begun_ns = foreign.clock.now_ns()
        with foreign.node.sdo.open(USER_DATA, 1, "wb", size=len(TEN_KB), buffering=7, block_transfer=block) as stream:
            stream.write(TEN_KB)
        durations.append(foreign.clock.now_ns() - begun_ns)
    assert durations[1] < 0.6 * durations[0]


def test_names_and_numbers_are_read_in_blocks_too(foreign: Foreign) -> None:
    for index in (0x1000, 0x1008):
        with foreign.node.sdo.open(index, 0, "rb", block_transfer=True) as stream:
            octets = stream.read()
        assert octets == foreign.node.sdo.upload(index, 0)


def test_a_client_that_vanishes_in_a_block_leaves_a_server_for_the_next_one(foreign: Foreign) -> None:
    vanished = foreign.node.sdo.open(USER_DATA, 1, "wb", size=100, buffering=7, block_transfer=True)
    vanished.raw.send(bytes(7))
    aborts = [bytes(message.data) for message in foreign.hear(2 * S) if message.arbitration_id == 0x580 + NODE]
    assert aborts == [bytes.fromhex("80 f0 5f 01 00 00 04 05")]
    foreign.node.sdo.responses = Responses(foreign.network, foreign.bus)
    assert foreign.node.sdo.upload(0x1000, 0) == bytes.fromhex("92 01 02 00")
    with pytest.raises(canopen.SdoAbortedError):
        vanished.close()


def test_a_saved_parameter_outlives_the_reset_that_canopen_sends(foreign: Foreign) -> None:
    sdo = foreign.node.sdo
    sdo.download(0x1017, 0, (100).to_bytes(2, "little"))
    sdo.download(0x1010, 1, b"save")
    foreign.node.nmt.send_command(129)
    heard = foreign.hear(S // 4)
    assert [bytes(message.data) for message in heard if message.arbitration_id == 0x700 + NODE][:2] == [b"\0", b"\x7f"]
    assert foreign.node.nmt.state == "PRE-OPERATIONAL"


def test_time_is_taken_from_canopens_producer(foreign: Foreign) -> None:
    foreign.node.sdo.download(0x1012, 0, (0x8000_0100).to_bytes(4, "little"))
    foreign.network.time.transmit(datetime(1984, 1, 4, 0, 1, tzinfo=UTC).timestamp())
    assert int.from_bytes(foreign.node.sdo.upload(0x5FF1, 2), "little") == 3
    assert int.from_bytes(foreign.node.sdo.upload(0x5FF1, 1), "little") == pytest.approx(60_000, abs=2)


def test_guarding_by_remote_frames_of_python_can(foreign: Foreign) -> None:
    request = can.Message(arbitration_id=0x700 + NODE, is_remote_frame=True, is_extended_id=False, dlc=1)
    answers = []
    for _ in range(3):
        foreign.bus.send(request)
        answers += [bytes(message.data) for message in foreign.hear(S // 100)]
    assert answers == [b"\x7f", b"\xff", b"\x7f"]


class TestLss:
    """canopen's LssMaster."""

    def test_the_address_is_inquired_and_selects(self, foreign: Foreign) -> None:
        lss: Any = foreign.network.lss
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        parts = (CS_INQUIRE_VENDOR_ID, CS_INQUIRE_PRODUCT_CODE, CS_INQUIRE_REVISION_NUMBER, CS_INQUIRE_SERIAL_NUMBER)
        address = [lss.inquire_lss_address(part) for part in parts]
        assert lss.inquire_node_id() == NODE
        lss.send_switch_state_global(lss.WAITING_STATE)
        assert address == [int.from_bytes(foreign.node.sdo.upload(0x1018, k), "little") for k in range(1, 5)]

    def test_a_node_without_node_id_is_found_by_fastscan_and_gets_one(self, foreign: Foreign) -> None:
        lss: Any = foreign.network.lss
        address = [int.from_bytes(foreign.node.sdo.upload(0x1018, k), "little") for k in range(1, 5)]
        assert lss.fast_scan() == (False, None)
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        lss.configure_node_id(255)
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        foreign.node.nmt.send_command(129)
        assert foreign.hear(S // 10) == []
        assert lss.fast_scan() == (True, address)
        lss.configure_node_id(33)
        with pytest.raises(LssError, match="1"):
            lss.configure_node_id(200)
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        assert [message.arbitration_id for message in foreign.hear(S // 10)] == [0x700 + 33]
        assert foreign.add(33).sdo.upload(0x1000, 0) == bytes.fromhex("92 01 02 00")

    def test_bit_timing_is_configured_and_activated(self, foreign: Foreign) -> None:
        lss: Any = foreign.network.lss
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        lss.configure_bit_timing(0)
        with pytest.raises(LssError, match="1"):
            lss.configure_bit_timing(5)
        lss.activate_bit_timing(20)
        foreign.hear(S // 20)
        assert lss.inquire_node_id() == NODE
