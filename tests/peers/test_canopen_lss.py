"""canopen's LssMaster against the simulated LSS slave, all its services."""

import time
from collections.abc import Iterator

import canopen
import pytest
from canopen.lss import (
    CS_INQUIRE_PRODUCT_CODE,
    CS_INQUIRE_REVISION_NUMBER,
    CS_INQUIRE_SERIAL_NUMBER,
    CS_INQUIRE_VENDOR_ID,
    LssError,
    LssMaster,
)

from tests.peers.conftest import LONG, VCAN, VCAN_MARKS, Connect
from tests.peers.dictionary import dictionary
from tests.peers.hosts import Reach, in_another_process, in_this_process

pytestmark = pytest.mark.xdist_group("peers")

NODE = 5
DRIVE = f"maxon_epos4@{NODE}"
NO_NODE = 0xFF
OTHER = 0x2A
REQUESTS = (CS_INQUIRE_VENDOR_ID, CS_INQUIRE_PRODUCT_CODE, CS_INQUIRE_REVISION_NUMBER, CS_INQUIRE_SERIAL_NUMBER)


@pytest.fixture(scope="module", params=["haptic_sim", "simulate", pytest.param("vcan", marks=VCAN_MARKS)])
def reach(request: pytest.FixtureRequest) -> Iterator[Reach]:
    """One drive, for canopen does not expect that several answer."""
    if request.param == "haptic_sim":
        yield in_this_process(NODE, (DRIVE,))
        return
    with in_another_process(NODE, (DRIVE,), VCAN if request.param == "vcan" else None) as there:
        yield there


@pytest.fixture
def lss(network: canopen.Network, connect: Connect) -> Iterator[LssMaster]:
    """The master, the drive in *waiting*; afterwards its node-ID is again what it was, for good."""
    connect(canopen.RemoteNode(NODE, dictionary()))
    master = network.lss
    master.RESPONSE_TIMEOUT = LONG
    yield master
    master.RESPONSE_TIMEOUT = LONG
    master.send_switch_state_global(master.CONFIGURATION_STATE)
    master.configure_node_id(NODE)
    master.store_configuration()
    booted = _boot_ups(network, NODE)
    network.nmt.send_command(130)
    _await(booted)


@pytest.fixture
def identity(network: canopen.Network, lss: LssMaster) -> tuple[int, ...]:
    """The LSS address, read by SDO."""
    del lss
    sdo = network[NODE].sdo
    return tuple(int.from_bytes(sdo.upload(0x1018, subindex), "little") for subindex in range(1, 5))


class TestLss:
    """Switching, inquiring, configuring, identifying, fastscan."""

    @pytest.mark.thorough("waits in real time", quick=1)
    def test_in_configuration_it_tells_who_it_is(self, lss: LssMaster, identity: tuple[int, ...]) -> None:
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        assert lss.inquire_node_id() == NODE
        assert tuple(lss.inquire_lss_address(request) for request in REQUESTS) == identity
        lss.send_switch_state_global(lss.WAITING_STATE)
        lss.RESPONSE_TIMEOUT = 0.2
        with pytest.raises(LssError, match="No LSS response"):
            lss.inquire_node_id()

    @pytest.mark.thorough("waits in real time", quick=1)
    def test_one_slave_is_selected_by_its_address_and_gets_a_node_id(
        self, lss: LssMaster, identity: tuple[int, ...], network: canopen.Network
    ) -> None:
        assert lss.send_switch_state_selective(*identity)
        lss.configure_node_id(OTHER)
        lss.store_configuration()
        lss.send_switch_state_global(lss.WAITING_STATE)
        booted = _boot_ups(network, OTHER)
        network[NODE].nmt.send_command(130)
        _await(booted)
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        assert lss.inquire_node_id() == OTHER

    @pytest.mark.thorough("waits in real time", quick=1)
    def test_settings_that_are_impossible_are_refused(self, lss: LssMaster) -> None:
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        lss.configure_bit_timing(0)
        lss.configure_node_id(NODE)
        for refused in (lambda: lss.configure_node_id(0), lambda: lss.configure_bit_timing(99)):
            with pytest.raises(LssError, match="LSS Error: 1"):
                refused()
        lss.activate_bit_timing(1)
        time.sleep(0.2)  # it is silent for twice the delay
        assert lss.inquire_node_id() == NODE

    @pytest.mark.thorough("waits for 130 answers that do not come")
    def test_fastscan_finds_a_slave_without_node_id_and_gives_it_one(
        self, lss: LssMaster, identity: tuple[int, ...], network: canopen.Network
    ) -> None:
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        lss.configure_node_id(NO_NODE)
        lss.send_switch_state_global(lss.WAITING_STATE)
        network[NODE].nmt.send_command(130)
        for timeout in (0.1, 0.2, 0.4):  # an answer that a busy machine delays beyond it spoils a scan
            lss.RESPONSE_TIMEOUT = timeout  # every one of the address costs this
            found, address = lss.fast_scan()
            if found and tuple(address) == identity:
                break
        assert (found, tuple(address or ())) == (True, identity)
        lss.RESPONSE_TIMEOUT = LONG
        lss.configure_node_id(OTHER)
        booted = _boot_ups(network, OTHER)
        lss.send_switch_state_global(lss.WAITING_STATE)
        _await(booted)

    @pytest.mark.thorough("waits for answers that do not come")
    def test_identify_asks_for_ranges(self, lss: LssMaster, identity: tuple[int, ...]) -> None:
        """canopen sends the six frames and does not wait for the answer; it is in its queue then."""
        vendor, product, revision, serial = identity
        lss.send_identify_remote_slave(vendor, product, revision, revision, serial, serial)
        assert lss.responses.get(timeout=LONG)[0] == 0x4F
        lss.send_identify_non_configured_remote_slave()
        assert lss.responses.empty()


def _boot_ups(network: canopen.Network, node: int) -> list[int]:
    heard: list[int] = []
    network.subscribe(0x700 + node, lambda _can_id, data, _timestamp: heard.extend(data))
    return heard


def _await(heard: list[int]) -> None:
    deadline = time.monotonic() + LONG
    while not heard:
        assert time.monotonic() < deadline
        time.sleep(0.002)
    assert heard[0] == 0
