"""Tests of master.py with the simulated drive of haptic-fieldbus. Run them with `pytest` in this folder.

`master` is the view of the program. `simulated_drive` is the true state of the drive.
"""

from collections.abc import Iterator

import canopen
import pytest
from master import Master, MasterError

from haptic_fieldbus.sim.faults import Silence
from haptic_fieldbus.testing import SimulatedDrive, VirtualCanBus

pytestmark = pytest.mark.simulated_drive(profile="generic_cia402", node=5)

OVER_CURRENT = 0x2310


@pytest.fixture
def network(virtual_can_bus: VirtualCanBus) -> canopen.Network:
    return virtual_can_bus.network()


@pytest.fixture
def master(network: canopen.Network) -> Iterator[Master]:
    with Master(network, node_id=5) as subject:
        yield subject


def test_nothing_moves_before_the_drive_is_enabled(master: Master, simulated_drive: SimulatedDrive) -> None:
    assert simulated_drive.nmt_state == "operational"
    assert simulated_drive.state == "switch on disabled"
    assert simulated_drive.torque == 0.0


def test_the_drive_is_enabled_and_stopped(master: Master, simulated_drive: SimulatedDrive) -> None:
    master.enable()
    assert simulated_drive.state == "operation enabled"
    master.stop()
    assert simulated_drive.state == "switch on disabled"


def test_the_motor_makes_the_torque_that_was_asked_for(
    master: Master, simulated_drive: SimulatedDrive, virtual_can_bus: VirtualCanBus
) -> None:
    master.enable()
    master.torque = 0.05
    virtual_can_bus.wait(0.1)
    assert simulated_drive.torque == pytest.approx(0.05, abs=0.001)
    assert simulated_drive.velocity > 0.0
    assert master.position > 0
    master.torque = -0.02
    virtual_can_bus.wait(0.1)
    assert simulated_drive.torque == pytest.approx(-0.02, abs=0.001)


def test_a_fault_of_the_drive_is_seen_and_nothing_enables_it_again(
    master: Master, simulated_drive: SimulatedDrive, virtual_can_bus: VirtualCanBus
) -> None:
    master.enable()
    master.torque = 0.05
    simulated_drive.fail(OVER_CURRENT)
    assert virtual_can_bus.wait_until(lambda: master.state == "fault")
    assert master.errors == [OVER_CURRENT]
    assert master.torque == 0.0
    virtual_can_bus.wait(0.1)
    assert simulated_drive.state == "fault"
    master.reset()
    virtual_can_bus.wait(0.1)
    assert simulated_drive.state == "switch on disabled"
    master.enable()
    assert simulated_drive.state == "operation enabled"
    assert simulated_drive.torque == pytest.approx(0.0, abs=0.001)


def test_a_master_that_is_gone_leaves_no_torque(
    master: Master, network: canopen.Network, simulated_drive: SimulatedDrive, virtual_can_bus: VirtualCanBus
) -> None:
    master.enable()
    master.torque = 0.05
    virtual_can_bus.wait(0.05)
    network.disconnect()
    assert virtual_can_bus.wait_until(lambda: abs(simulated_drive.torque) < 0.001, longest=1.0)
    assert simulated_drive.state == "switch on disabled"


def test_a_cut_cable_is_told(master: Master, simulated_drive: SimulatedDrive, virtual_can_bus: VirtualCanBus) -> None:
    master.enable()
    simulated_drive.happen(Silence("silence", at=0.0))
    assert virtual_can_bus.wait_until(lambda: master.state == "silent")
    with pytest.raises(MasterError, match="silent"):
        master.enable()


@pytest.mark.fault_plan(kinds=["drive_fault", "heartbeat_lost", "missing_rpdos", "safe_torque_off"], within=0.2)
@pytest.mark.parametrize("fault_plan", ["random@1", "random@2", "random@3"], indirect=True)
def test_whatever_goes_wrong_no_torque_remains(
    network: canopen.Network, simulated_drive: SimulatedDrive, virtual_can_bus: VirtualCanBus
) -> None:
    with Master(network, node_id=5) as master:
        master.enable()
        master.torque = 0.05
        virtual_can_bus.wait(0.3)
    assert virtual_can_bus.wait_until(lambda: abs(simulated_drive.torque) < 0.001, longest=1.0)
