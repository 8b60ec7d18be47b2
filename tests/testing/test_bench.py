"""A simulated bus with its drives as the plugin's fixtures give them, in virtual and in real time."""

import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import can
import canopen
import pytest

from haptic_fieldbus.drive.rig import BusSection, Rig, default_axis
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.errors import FaultFileError, UsageError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.faults import AnswerLost, DriveFault, Fault, MissingNode, Silence
from haptic_fieldbus.testing import DriveRequest, FaultPlan, SimulatedDrive, VirtualCanBus, plan_faults

NODE = 5
TORQUE_MODE = 10
VIRTUAL = pytest.mark.virtual_can_bus(time="virtual")
pytestmark = pytest.mark.simulated_drive("generic_cia402", node=NODE)


def enable(node: canopen.RemoteNode, permille: int = 0) -> None:
    """By SDO alone."""
    node.sdo.download(0x6060, 0, struct.pack("<b", TORQUE_MODE))
    for controlword in (0x06, 0x07, 0x0F):
        node.sdo.download(0x6040, 0, struct.pack("<H", controlword))
    node.sdo.download(0x6071, 0, struct.pack("<h", permille))


def add_node(network: canopen.Network, number: int = NODE) -> canopen.RemoteNode:
    return network.add_node(number, canopen.ObjectDictionary())


@VIRTUAL
class TestVirtualTime:
    """In one thread; only `wait`, SDO requests and `recv` let time pass."""

    def test_canopen_drives_the_motor(self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive) -> None:
        node = add_node(virtual_can_bus.network())
        enable(node, 100)
        assert simulated_drive.state == "operation enabled"
        virtual_can_bus.wait(0.1)
        assert simulated_drive.torque == pytest.approx(0.1 * simulated_drive.rated_torque)
        # Torque over inertia of the shipped bench, less friction; 0.1 s.
        expected = (simulated_drive.torque - 2.0e-3) / 4.0e-5 * 0.1
        assert simulated_drive.velocity == pytest.approx(expected, rel=0.15)
        counts = struct.unpack("<i", node.sdo.upload(0x6064, 0))[0]
        assert counts == pytest.approx(simulated_drive.position * 4096 / 6.2832, rel=0.01)
        assert simulated_drive.value(0x6064) >= counts

    def test_pdos_and_emergencies_arrive_while_the_program_waits(
        self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive
    ) -> None:
        network = virtual_can_bus.network()
        node = add_node(network)
        heard: list[bytes] = []
        network.subscribe(0x180 + NODE, lambda _id, data, _time: heard.append(bytes(data)))
        network.nmt.send_command(1)
        enable(node)
        simulated_drive.fail(0x4310)
        assert not node.emcy.log
        virtual_can_bus.wait(0.01)
        assert [error.code for error in node.emcy.log] == [0x4310]
        assert simulated_drive.error_code == 0x4310
        words = [struct.unpack_from("<H", data)[0] & 0x6F for data in heard]
        assert 0x27 in words[:-1]
        assert words[-1] == 0x28

    def test_what_needs_a_thread_is_refused(self, virtual_can_bus: VirtualCanBus) -> None:
        network = virtual_can_bus.network()
        with pytest.raises(RuntimeError, match="080h cannot be sent periodically in virtual time"):
            network.sync.start(0.01)

    def test_a_request_without_an_answer_takes_the_time_of_canopen(
        self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive
    ) -> None:
        node = add_node(virtual_can_bus.network())
        node.sdo.RESPONSE_TIMEOUT = 0.001  # by the wall clock, which nobody needs here
        simulated_drive.happen(Silence("silence", 0.0))
        began_ns = virtual_can_bus.clock.now_ns()
        with pytest.raises(canopen.SdoCommunicationError):
            node.sdo.upload(0x1000, 0)
        requests = 1 + node.sdo.MAX_RETRIES
        assert virtual_can_bus.clock.now_ns() - began_ns == pytest.approx(requests * 0.3e9, abs=1e6)

    def test_a_condition_is_awaited_and_given_up(self, virtual_can_bus: VirtualCanBus) -> None:
        began_ns = virtual_can_bus.clock.now_ns()
        assert virtual_can_bus.wait_until(lambda: virtual_can_bus.clock.now_ns() - began_ns >= 500_000_000)
        assert not virtual_can_bus.wait_until(lambda: False, longest=100.0)
        assert virtual_can_bus.clock.now_ns() - began_ns == 100_500_000_000


def test_a_drive_may_be_that_of_a_rig(tmp_path: Path) -> None:
    file, bench = tmp_path / "twin.toml", default_axis(Workspace.LINEAR, bus="a", node=9, profile="generic_cia402")
    bus: dict[str, BusSection] = {"a": CanSection("haptic_sim", "sim")}
    file.write_text(rig_text(Rig(bus, {"handle": replace(bench, rated_torque=0.7)}), ""), encoding="utf-8")
    with VirtualCanBus([DriveRequest(rig=str(file))], time="virtual") as wire:
        assert wire.drives[9].rated_torque == pytest.approx(0.7)
    file.write_text(rig_text(Rig(bus, {"handle": bench, "other": replace(bench, node=10)}), ""), encoding="utf-8")
    with pytest.raises(UsageError, match="expected a rig with one axis, found 2"):
        VirtualCanBus([DriveRequest(rig=str(file))], time="virtual")


def test_all_drives_that_are_wrong_are_told_at_once() -> None:
    with pytest.raises(UsageError) as refused:
        VirtualCanBus([DriveRequest("maxon_epos5"), DriveRequest(node=500), DriveRequest(node=True)])
    assert [line.split()[:2] for line in str(refused.value).splitlines()] == [["no", "profile"], ["node", "500:"],
                                                                              ["node", "True:"]]  # fmt: skip


def test_in_virtual_time_every_run_is_the_same() -> None:
    def frames() -> list[tuple[float, int, bytes]]:
        with (
            VirtualCanBus([DriveRequest("generic_cia402", NODE)], time="virtual", seed=8) as bus,
            bus.open() as program,
        ):
            for node in (0, NODE):
                program.send(can.Message(arbitration_id=0, data=[129, node], is_extended_id=False))
            heard = iter(lambda: program.recv(1.0), None)
            return [(each.timestamp, each.arbitration_id, bytes(each.data)) for each in heard]

    first = frames()
    assert first
    assert frames() == first


class TestRealTime:
    """With canopen's own thread."""

    def test_several_programs_share_the_wire(
        self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive
    ) -> None:
        with can.Bus(**virtual_can_bus.options) as listener:
            node = add_node(virtual_can_bus.network())
            enable(node)
            heard = {frame.arbitration_id for frame in iter(lambda: listener.recv(0.05), None)}
        assert {0x580 + NODE, 0x600 + NODE} <= heard
        assert simulated_drive.state == "operation enabled"

    @pytest.mark.simulated_drive("maxon_epos4", node=2)
    def test_several_drives_share_the_wire(
        self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive
    ) -> None:
        assert sorted(virtual_can_bus.drives) == [2, NODE]
        assert simulated_drive is virtual_can_bus.drives[2]
        network = virtual_can_bus.network()
        enable(add_node(network))
        assert [drive.state for _, drive in sorted(virtual_can_bus.drives.items())] == [
            "switch on disabled",
            "operation enabled",
        ]

    def test_after_the_test_the_wire_is_gone(self) -> None:
        with VirtualCanBus() as bus:
            options = bus.options
            bus.network()
        with pytest.raises(can.CanInitializationError, match="expected profile@node-ID"):
            can.Bus(**options)


class TestFaults:
    """By file, by list, by seed, and at once."""

    @VIRTUAL
    @pytest.mark.fault_plan([DriveFault("drive_fault", 0.2, 0x7305)])
    def test_those_of_a_list_count_from_operation_enabled(
        self, virtual_can_bus: VirtualCanBus, simulated_drive: SimulatedDrive
    ) -> None:
        node = add_node(virtual_can_bus.network())
        virtual_can_bus.wait(1.0)
        enable(node)
        virtual_can_bus.wait(0.19)
        assert simulated_drive.state == "operation enabled"
        virtual_can_bus.wait(0.02)
        assert (simulated_drive.state, simulated_drive.error_code) == ("fault", 0x7305)

    @pytest.mark.parametrize("fault_plan", ["random@3", "random@4"], indirect=True)
    def test_the_fixture_can_be_parametrised(self, fault_plan: FaultPlan, virtual_can_bus: VirtualCanBus) -> None:
        assert virtual_can_bus.faults is fault_plan
        assert fault_plan == plan_faults(f"random@{fault_plan.seed}")
        assert fault_plan.faults

    def test_those_of_a_file_are_found_beside_the_test(self, tmp_path: Path) -> None:
        (tmp_path / "faults.toml").write_text('[[fault]]\nkind = "silence"\nat = 1.0\n', encoding="utf-8")
        assert plan_faults("faults.toml", folder=tmp_path).faults == (Silence("silence", 1.0),)

    def test_one_that_exists_from_power_on_cannot_happen_later(self, simulated_drive: SimulatedDrive) -> None:
        with pytest.raises(ValueError, match='fault "missing_node" cannot begin while the bench runs'):
            simulated_drive.happen(MissingNode("missing_node"))  # type: ignore[arg-type]

    def test_what_no_file_may_have_is_refused_in_python_too(self, simulated_drive: SimulatedDrive) -> None:
        with pytest.raises(FaultFileError, match="code: 70000; expected a whole number from 1 to 65535"):
            simulated_drive.fail(70000)
        with pytest.raises(FaultFileError, match=r"at: -1\.0; expected a number from 0"):
            plan_faults([Silence("silence", -1.0)])
        with pytest.raises(TypeError, match=r"fault: expected an object of haptic_fieldbus\.sim\.faults, not 3"):
            plan_faults([3])  # type: ignore[list-item]
        with pytest.raises(TypeError, match="faults: expected a file, a list of faults"):
            plan_faults(None)  # type: ignore[arg-type]
        with pytest.raises(UsageError, match="within nan: expected a time above 0 s"):
            plan_faults("random", within=math.nan)
        assert plan_faults("random@3", kinds="silence").faults[0].kind == "silence"

    @pytest.mark.parametrize(
        ("fault", "said"),
        [
            (Silence("silence", 0.1, node=9), 'fault "silence" is of node 9; the drives have: 1'),
            (AnswerLost("answer_lost", 0.1), "drives on CAN do not support the fault answer_lost; remove it"),
        ],
    )
    def test_a_fault_that_no_drive_of_the_bus_has_is_refused(self, fault: Fault, said: str) -> None:
        """It would never happen, and a test of a master would pass for nothing."""
        with pytest.raises(UsageError, match=said):
            VirtualCanBus(faults=FaultPlan((fault,)))

    def test_a_drawn_plan_never_concerns_the_computer_of_the_master(self) -> None:
        kinds = {fault.kind for seed in range(300) for fault in plan_faults(f"random@{seed}").faults}
        assert len(kinds) > 25
        assert not kinds & {"host_late", "host_paused", "clock_step", "slow_compute"}


def test_files_of_a_mark_stand_beside_the_test_and_others_count_from_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "twin.toml").write_text("", encoding="utf-8")
    (tmp_path / "maxon_epos4").mkdir()  # a folder of that name is no profile
    request = DriveRequest("maxon_epos4", rig="twin.toml", profiles="elsewhere").beside(tmp_path)
    assert request == DriveRequest("maxon_epos4", rig=str(tmp_path / "twin.toml"), profiles="elsewhere")


@pytest.mark.parametrize("beside", [{"profile": "generic_cia402"}, {"node": 7}])
def test_a_rig_has_its_own_profile_and_node(beside: dict[str, Any]) -> None:
    with pytest.raises(UsageError, match=r"rig twin\.toml: profile and node are those of its axis"):
        VirtualCanBus([DriveRequest(rig="twin.toml", **beside)])
