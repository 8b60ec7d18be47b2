"""canopen's RemoteNode as the master: SDO, PDO, NMT, error control and emergencies, with its own thread."""

import struct
import time
from collections.abc import Callable

import canopen
import pytest
from canopen.emcy import EmcyError

from tests.peers.conftest import LONG, Connect
from tests.peers.dictionary import dictionary
from tests.peers.hosts import Reach

pytestmark = pytest.mark.xdist_group("peers")

MASTER = 0x7F
OPERATIONAL = 1
"""NMT command."""
STATES = {"STOPPED": 4, "OPERATIONAL": 5, "PRE-OPERATIONAL": 127}
"""CiA 301, 7.2.8.3.2: the octet of a heartbeat."""


GENERIC = 6
"""Node-ID of the generic drive, which is always beside the other one."""


@pytest.fixture
def node(reach: Reach, connect: Connect) -> canopen.RemoteNode:
    return connect(canopen.RemoteNode(reach.node, dictionary()))


def until(condition: Callable[[], bool]) -> None:
    """Wait for what another thread notices."""
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)


def answers(node: canopen.RemoteNode) -> bool:
    """Whether it takes requests; it takes none while it is reset."""
    node.sdo.RESPONSE_TIMEOUT = 0.2
    try:
        return bool(node.sdo[0x1000].raw)
    except canopen.SdoCommunicationError:
        return False
    finally:
        node.sdo.RESPONSE_TIMEOUT = LONG


class TestSdo:
    """Expedited, segmented, refused."""

    def test_identity_and_name(self, node: canopen.RemoteNode) -> None:
        assert node.sdo[0x1000].raw == 0x0002_0192
        assert node.sdo[0x1018][0].raw == 4
        assert node.sdo[0x1018][4].raw > 0
        assert len(node.sdo[0x1008].raw) > 4

    def test_a_value_is_written_and_read_back(self, node: canopen.RemoteNode) -> None:
        node.sdo[0x6071].raw = -123
        assert node.sdo[0x6071].raw == -123

    def test_a_segmented_download(self, node: canopen.RemoteNode) -> None:
        node.sdo.download(0x1017, 0, struct.pack("<H", 1234), force_segment=True)
        assert node.sdo[0x1017].raw == 1234
        node.sdo[0x1017].raw = 0

    @pytest.mark.parametrize(
        ("index", "subindex", "data", "code"),
        [
            (0x2FFF, 0, b"\0", 0x0602_0000),
            (0x1018, 9, b"\0", 0x0609_0011),
            (0x6041, 0, b"\0\0", 0x0601_0002),
            (0x6040, 0, b"\0\0\0\0", 0x0607_0012),
        ],
        ids=["unknown object", "unknown sub-index", "read-only", "too long"],
    )
    def test_refusals(self, node: canopen.RemoteNode, index: int, subindex: int, data: bytes, code: int) -> None:
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo.download(index, subindex, data)
        assert caught.value.code == code


class TestBlockTransfer:
    """SDO block transfers of 10 kB."""

    DATA = bytes(range(256)) * 39 + b"sixteen and more"

    @pytest.mark.thorough("4 cases of one rule", quick=1)
    @pytest.mark.parametrize("crc", [True, False], ids=["with CRC", "without CRC"])
    def test_there_and_back(self, node: canopen.RemoteNode, crc: bool) -> None:
        """canopen can send without CRC; to read it takes the server's word that there is one for its own wish."""
        assert len(self.DATA) == 10_000
        with node.sdo.open(
            0x5FF0, 1, "wb", size=len(self.DATA), block_transfer=True, request_crc_support=crc
        ) as download:
            download.write(self.DATA)
        with node.sdo.open(0x5FF0, 1, "rb", block_transfer=True) as upload:
            assert upload.read() == self.DATA

    def test_what_was_sent_in_blocks_is_read_in_segments(self, node: canopen.RemoteNode) -> None:
        data = self.DATA[:500]
        with node.sdo.open(0x5FF0, 2, "wb", size=len(data), block_transfer=True) as download:
            download.write(data)
        assert node.sdo.upload(0x5FF0, 2) == data

    def test_a_short_object_comes_in_one_segment(self, node: canopen.RemoteNode) -> None:
        with node.sdo.open(0x1008, 0, "rb", block_transfer=True) as upload:
            assert upload.read() == node.sdo.upload(0x1008, 0)

    def test_an_object_that_is_not_there_is_refused(self, node: canopen.RemoteNode) -> None:
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo.open(0x2FFF, 0, "rb", block_transfer=True)
        assert caught.value.code == 0x0602_0000


class TestPdo:
    """Mapping as canopen reads and saves it, and the process data that follows."""

    def test_what_is_saved_is_read_back(self, node: canopen.RemoteNode, reach: Reach) -> None:
        self._map(node)
        other = canopen.RemoteNode(reach.node, dictionary())
        other.associate_network(node.network)
        other.sdo.RESPONSE_TIMEOUT = LONG
        other.tpdo[1].read()
        other.rpdo[1].read()
        assert [variable.index for variable in other.tpdo[1]] == [0x6041, 0x6064]
        assert [variable.index for variable in other.rpdo[1]] == [0x6040, 0x6071]
        assert (other.tpdo[1].trans_type, other.tpdo[1].enabled) == (1, True)
        other.remove_network()

    def test_sync_brings_tpdos_and_rpdos_are_obeyed(self, node: canopen.RemoteNode, network: canopen.Network) -> None:
        self._map(node)
        node.nmt.state = "OPERATIONAL"
        network.sync.start(0.01)
        heard: list[int] = []
        node.tpdo[1].add_callback(lambda pdo: heard.append(pdo[0x6041].raw))
        until(lambda: len(heard) >= 5)
        assert heard[-1] & 0x6F in (0x40, 0x60)
        for controlword, state in ((0x06, 0x21), (0x07, 0x23), (0x0F, 0x27), (0x00, 0x40)):
            node.rpdo[1][0x6040].raw = controlword
            node.rpdo[1].transmit()
            until(lambda state=state: heard[-1] & 0x4F == state & 0x4F)  # type: ignore[misc]

    @pytest.mark.thorough("on every wire", quick=("haptic_sim-5",))
    def test_a_change_of_state_sends_a_tpdo_without_sync(self, node: canopen.RemoteNode) -> None:
        self._map(node, tpdo_type=255)
        heard: list[int] = []
        node.tpdo[1].add_callback(lambda pdo: heard.append(pdo[0x6041].raw))
        node.nmt.state = "OPERATIONAL"
        until(lambda: bool(heard))
        node.sdo[0x6040].raw = 0x06
        until(lambda: heard[-1] & 0x6F == 0x21)

    @pytest.mark.thorough("on every wire", quick=("haptic_sim-5",))
    def test_a_tpdo_comes_on_request(self, node: canopen.RemoteNode) -> None:
        self._map(node, tpdo_type=253)
        heard: list[int] = []
        node.tpdo[1].add_callback(lambda pdo: heard.append(pdo[0x6041].raw))
        node.nmt.state = "OPERATIONAL"
        for count in (1, 2):
            node.tpdo[1].remote_request()
            until(lambda count=count: len(heard) == count)  # type: ignore[misc]

    def _map(self, node: canopen.RemoteNode, tpdo_type: int = 1) -> None:
        for pdo, type_, indices in ((node.tpdo[1], tpdo_type, (0x6041, 0x6064)), (node.rpdo[1], 255, (0x6040, 0x6071))):
            pdo.read()
            pdo.clear()
            for index in indices:
                pdo.add_variable(index)
            pdo.trans_type, pdo.enabled, pdo.rtr_allowed = type_, True, type_ == 253
            pdo.save()


class TestNmt:
    """States, heartbeat, node guarding."""

    @pytest.mark.parametrize("state", ["OPERATIONAL", "STOPPED", "PRE-OPERATIONAL"])
    def test_the_heartbeat_tells_the_state_that_was_commanded(self, node: canopen.RemoteNode, state: str) -> None:
        node.sdo[0x1017].raw = 20
        told: list[int] = []
        node.nmt.add_heartbeat_callback(told.append)
        node.nmt.state = state
        until(lambda: told[-3:] == [STATES[state]] * 3)
        node.nmt.state = "PRE-OPERATIONAL"
        node.sdo[0x1017].raw = 0

    @pytest.mark.parametrize("command", [129, 130], ids=["reset node", "reset communication"])
    def test_a_reset_brings_a_boot_up_message(self, node: canopen.RemoteNode, command: int) -> None:
        told: list[int] = []
        node.nmt.add_heartbeat_callback(told.append)
        node.nmt.send_command(command)
        until(lambda: told == [0])
        assert node.sdo[0x1017].raw == 0

    @pytest.mark.thorough("on every wire", quick=("haptic_sim-5-stop", "haptic_sim-5-reset communication"))
    @pytest.mark.parametrize("command", [2, 128, 130], ids=["stop", "pre-operational", "reset communication"])
    def test_a_link_that_ends_at_rest_is_no_fault(self, node: canopen.RemoteNode, command: int) -> None:
        """Whatever 6007h says, for there is no torque that a master could be missed for."""
        said: list[EmcyError] = []
        node.emcy.add_callback(said.append)
        for option in (0, 1, 2, 3):
            node.sdo[0x6007].raw = option
            node.nmt.send_command(OPERATIONAL)
            node.nmt.send_command(command)
            node.nmt.send_command(128)
            until(lambda: answers(node))
            assert node.sdo[0x6041].raw & 0x4F == 0x40, f"6007h = {option}"
            assert (node.sdo[0x603F].raw, node.sdo[0x1001].raw, node.sdo[0x1003][0].raw) == (0, 0, 0)
        node.sdo[0x6007].raw = 2
        assert not said

    @pytest.mark.thorough("waits in real time", quick=1)
    def test_node_guarding(self, node: canopen.RemoteNode, network: canopen.Network, reach: Reach) -> None:
        octets: list[int] = []
        network.subscribe(0x700 + reach.node, lambda _can_id, data, _timestamp: octets.extend(data))
        node.nmt.start_node_guarding(0.05)
        until(lambda: len(octets) >= 6)
        node.nmt.stop_node_guarding()
        assert {octet & 0x7F for octet in octets} == {STATES["PRE-OPERATIONAL"]}
        toggles = [octet >> 7 for octet in octets[:6]]
        assert toggles == [0, 1] * 3

    @pytest.mark.thorough("waits for a life time of a second")
    def test_life_guarding_begins_with_the_first_request_and_ends_after_the_life_time(self, connect: Connect) -> None:
        """100Ch × 100Dh = 1 s, in CiA 301 7.5.2.11 and 7.5.2.12; the error is 8130h. An EPOS4 has neither."""
        node = connect(canopen.RemoteNode(GENERIC, dictionary()))
        said: list[tuple[float, EmcyError]] = []
        node.emcy.add_callback(lambda error: said.append((time.monotonic(), error)))
        node.sdo[0x100C].raw, node.sdo[0x100D].raw = 200, 5
        began = time.monotonic()
        until(lambda: time.monotonic() - began > 1.5)
        assert not said, "nobody has asked yet"
        node.nmt.start_node_guarding(0.1)
        began = time.monotonic()
        until(lambda: time.monotonic() - began > 1.5)
        assert not said
        node.nmt.stop_node_guarding()
        stopped = time.monotonic()
        until(lambda: bool(said))
        assert said[0][1].code == 0x8130
        assert 0.8 < said[0][0] - stopped < 1.5
        node.sdo[0x100D].raw = 0


class TestEmergency:
    """Emergencies reach canopen's consumer."""

    @pytest.mark.thorough("waits in real time", quick=1)
    def test_a_master_that_falls_silent_is_reported(self, node: canopen.RemoteNode, network: canopen.Network) -> None:
        said: list[EmcyError] = []
        node.emcy.add_callback(said.append)
        node.sdo[0x1016][1].raw = MASTER << 16 | 100
        node.nmt.state = "OPERATIONAL"
        network.send_message(0x700 + MASTER, b"\x05")
        until(lambda: bool(said))
        assert (said[0].code, said[0].register & 0x11) == (0x8130, 0x11)
        assert node.sdo[0x1001].raw & 0x11 == 0x11
