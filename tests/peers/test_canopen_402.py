"""canopen's BaseNode402 as the master, kept within what it can do: RPDO at once, TPDO at every SYNC, SYNC running.

With a synchronous RPDO it sends nothing, with an event-driven TPDO it waits for frames that do not come; it switches a
fault off and goes to *operation enabled* in one go.
"""

import time
from collections.abc import Callable, Iterator

import canopen
import pytest
from canopen.profiles.p402 import BaseNode402, OperationMode, State402

from tests.peers.conftest import LONG, Connect
from tests.peers.dictionary import dictionary
from tests.peers.hosts import Reach

pytestmark = pytest.mark.xdist_group("peers")

SYNC_PERIOD = 0.01
TORQUE = "CYCLIC SYNCHRONOUS TORQUE"
MASTER = 0x7F
VALUE_RANGE = 0x0609_0030
"""SDO abort code: the value is out of range."""
BY_THEMSELVES = ("START", "NOT READY TO SWITCH ON", "FAULT REACTION ACTIVE", "FAULT")
"""States that are left without a command, or that no command reaches."""
HOLD_AFTER_QUICK_STOP = 6
"""605Ah: slow down on the quick stop ramp, and stay in *quick stop active*."""


@pytest.fixture
def node(reach: Reach, connect: Connect, network: canopen.Network) -> Iterator[BaseNode402]:
    """Mapped, operational, its state machine set up."""
    subject = BaseNode402(reach.node, dictionary())
    connect(subject)
    for name in ("SWITCH_OP_MODE", "SWITCH_STATE_FINAL", "SWITCH_STATE_SINGLE", "CHECK_TPDO"):
        setattr(subject, f"TIMEOUT_{name}", LONG)
    _map(subject)
    subject.setup_402_state_machine(read_pdos=False)
    # udp_multicast gives back what one sends; canopen would take the RPDO for a periodic one, and then not send it.
    network.unsubscribe(subject.rpdo[1].cob_id)
    subject.nmt.state = "OPERATIONAL"
    network.sync.start(SYNC_PERIOD)
    yield subject
    network.sync.stop()


def _map(node: BaseNode402) -> None:
    for pdo, type_, indices in (
        (node.tpdo[1], 1, (0x6041, 0x6061, 0x6064)),
        (node.rpdo[1], 255, (0x6040, 0x6060, 0x6071)),
    ):
        pdo.read()
        pdo.clear()
        for index in indices:
            pdo.add_variable(index)
        pdo.trans_type, pdo.enabled = type_, True
        pdo.save()


def test_the_way_to_operation_enabled_and_back(node: BaseNode402) -> None:
    for state in (
        "READY TO SWITCH ON",
        "SWITCHED ON",
        "OPERATION ENABLED",
        "SWITCHED ON",
        "READY TO SWITCH ON",
        "SWITCH ON DISABLED",
        "OPERATION ENABLED",
        "SWITCH ON DISABLED",
    ):
        node.state = state
        assert node.state == state


@pytest.mark.thorough("on every wire", quick=("haptic_sim-5",))
def test_every_transition_that_canopen_knows_a_command_for(node: BaseNode402) -> None:
    node.op_mode = TORQUE
    node.sdo[0x605A].raw = HOLD_AFTER_QUICK_STOP
    commanded = [(*states, word) for states, word in State402.TRANSITIONTABLE.items() if states[0] not in BY_THEMSELVES]
    assert len(commanded) == 12
    for start, end, controlword in commanded:
        node.state = start
        assert node.state == start
        node.controlword = controlword
        _until_state(node, {end})


def test_a_quick_stop_ends_where_the_drive_cannot_turn(node: BaseNode402) -> None:
    node.state = "OPERATION ENABLED"
    node.controlword = 0x02
    _until_state(node, {"QUICK STOP ACTIVE", "SWITCH ON DISABLED"})
    node.state = "SWITCH ON DISABLED"


def test_the_mode_is_switched_and_confirmed(node: BaseNode402) -> None:
    assert node.is_op_mode_supported(TORQUE)
    node.op_mode = TORQUE
    assert node.op_mode == TORQUE


@pytest.mark.thorough("on every wire", quick=("haptic_sim-5",))
def test_every_mode_that_the_drive_says_it_has_is_taken_over_and_no_other(node: BaseNode402) -> None:
    modes = [mode for mode in OperationMode.SUPPORTED if mode != "NO MODE"]
    offered = [mode for mode in modes if node.is_op_mode_supported(mode)]
    assert TORQUE in offered
    for mode in offered:
        node.op_mode = mode
        assert node.op_mode == mode
    for mode in set(modes) - set(offered):
        with pytest.raises(TypeError, match=f"Operation mode {mode} not"):
            node.op_mode = mode
        with pytest.raises(canopen.SdoAbortedError) as caught:
            node.sdo[0x6060].raw = OperationMode.NAME2CODE[mode]
        assert caught.value.code == VALUE_RANGE
        assert node.sdo[0x6061].raw == OperationMode.NAME2CODE[offered[-1]]


def test_torque_turns_the_shaft_and_no_torque_lets_it_run_out(node: BaseNode402) -> None:
    node.op_mode = TORQUE
    node.state = "OPERATION ENABLED"
    start = node.tpdo[1][0x6064].raw
    node.rpdo[1][0x6071].raw = 100
    node.rpdo[1].transmit()
    _until(lambda: node.tpdo[1][0x6064].raw > start + 4096)
    node.rpdo[1][0x6071].raw = 0
    node.rpdo[1].transmit()
    node.state = "SWITCH ON DISABLED"


@pytest.mark.thorough("waits in real time", quick=1)
def test_a_fault_is_seen_and_reset(node: BaseNode402, network: canopen.Network) -> None:
    node.sdo[0x6007].raw = 1  # a lost link is a fault
    node.sdo[0x1016][1].raw = MASTER << 16 | 150
    node.state = "OPERATION ENABLED"
    network.send_message(0x700 + MASTER, b"\x05")
    _until(lambda: bool(node.emcy.log))
    node.nmt.state = "OPERATIONAL"
    _until_state(node, {"FAULT"})
    node.sdo[0x1016][1].raw = 0
    node.reset_from_fault()
    assert node.state == "OPERATION ENABLED"
    node.state = "SWITCH ON DISABLED"


def _until_state(node: BaseNode402, states: set[str]) -> None:
    _until(lambda: node.state in states)


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + LONG
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.002)
