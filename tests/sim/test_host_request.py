"""Requests to `simulate` are checked as a whole before a bus is opened."""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from haptic_fieldbus.drive.rig import BusSection, Mechanics, default_axis
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.canopen.bus import NODES
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.faults import AnswerLost, BusOff, Emergency, ErrorFrame, Fault, SyncIgnored, load_faults
from haptic_fieldbus.sim.host_request import HostRequest, host_on, joined_bus, numbered, resolve, rig_of


class TestRequest:
    """A request is checked as a whole before a bus is opened."""

    def test_the_drives_of_a_rig_are_hosted_with_their_benches(self) -> None:
        bench = default_axis(Workspace.LINEAR, bus="bus", node=9, profile="generic_cia402")
        axis = replace(bench, simulation=Mechanics(inertia=9e-5))
        _, (slot,) = resolve(HostRequest([], "virtual:here", axes=(axis,)))
        assert (slot.node, slot.profile.name, slot.axis.simulation.inertia) == (9, "generic_cia402", 9e-5)

    @pytest.mark.parametrize(
        ("texts", "first", "nodes"),
        [
            (["maxon_epos4"], 1, [1]),
            (["maxon_epos4", "generic_cia402"], 5, [5, 6]),
            (["maxon_epos4@9", "generic_cia402", "generic_cia402@5", "maxon_epos4"], 5, [9, 6, 5, 7]),
        ],
    )
    def test_drives_get_the_node_id_they_ask_for_or_the_next_free_one(
        self, texts: list[str], first: int, nodes: list[int]
    ) -> None:
        drives = numbered(texts, first, NODES)
        assert [drive.node for drive in drives] == nodes
        assert [drive.profile for drive in drives] == [text.partition("@")[0] for text in texts]

    @pytest.mark.parametrize(
        ("texts", "first", "said"),
        [
            (["a@5", "b@5"], 1, "node-ID 5 is used twice"),
            (["a@200"], 1, "expected profile@node-ID"),
            (["a", "b"], 127, "no free node-ID for b"),
        ],
    )
    def test_impossible_node_ids_are_refused(self, texts: list[str], first: int, said: str) -> None:
        with pytest.raises(UsageError, match=said):
            numbered(texts, first, NODES)

    @pytest.mark.parametrize("bus", ["sim", "sim@500000", "haptic_sim:maxon_epos4@5", None])
    def test_a_bus_that_no_other_program_can_join_is_refused(self, bus: str | None) -> None:
        with pytest.raises(UsageError, match="socketcan:can0"):
            joined_bus(bus)

    def test_a_drive_of_another_protocol_than_its_bus_is_refused(self) -> None:
        with pytest.raises(UsageError, match="generic_cia402_modbus uses modbus, but virtual:x is a canopen"):
            resolve(HostRequest(["generic_cia402_modbus"], "virtual:x"))

    def test_all_that_is_wrong_is_told_at_once(self) -> None:
        faults = (BusOff("bus_off", 1.0), ErrorFrame("error_frame", 1.0), Emergency("emergency", 1.0, 1, bus="can0"))
        request = HostRequest(["generic_cia402", "nonsense"], "sim", node=128, hand="foot", faults=faults)
        with pytest.raises(UsageError) as refused:
            resolve(request)
        said = str(refused.value).splitlines()
        assert [line.split()[0:2] for line in said] == [
            ["fault", '"bus_off"'], ["fault", '"error_frame"'], ["fault", '"emergency"'], ["no", "hand"],
            ["bus", '"sim":'], ["node", "128:"], ["no", "profile"],
        ]  # fmt: skip

    @pytest.mark.parametrize(
        ("bus", "drive", "fault", "said"),
        [
            ("virtual:x", "generic_cia402", AnswerLost("answer_lost", 1.0), "on canopen do not support .*answer_lost"),
            (
                "modbus-tcp:127.0.0.1:0",
                "generic_cia402_modbus",
                SyncIgnored("sync_ignored", 1.0),
                "modbus.*sync_ignored",
            ),
        ],
    )
    def test_a_fault_of_another_protocol_is_refused(self, bus: str, drive: str, fault: Fault, said: str) -> None:
        with pytest.raises(UsageError, match=said):
            resolve(HostRequest([drive], bus, faults=(fault,)))

    def test_a_fault_may_be_of_any_modbus_unit(self, tmp_path: Path) -> None:
        file = tmp_path / "faults.toml"
        file.write_text('[[fault]]\nkind = "answer_lost"\nat = 1.0\nnode = 200\n', encoding="utf-8")
        request = HostRequest(["generic_cia402_modbus@200"], "modbus-tcp:127.0.0.1:0", faults=load_faults(file))
        assert [fault.node for fault in resolve(request)[1][0].faults] == [200]

    def test_a_fault_of_a_drive_that_is_not_hosted_is_refused(self) -> None:
        request = HostRequest(["generic_cia402@5"], "virtual:x", faults=(Emergency("emergency", 1.0, 1, node=9),))
        with pytest.raises(UsageError, match='fault "emergency" is of node 9; the drives have: 5'):
            resolve(request)

    def test_without_a_drive_it_is_the_one_that_is_assumed_on_such_a_bus(self) -> None:
        assert [slot.profile.name for slot in resolve(HostRequest([], "modbus-rtu:pty"))[1]] == [
            "generic_cia402_modbus"
        ]
        assert [slot.profile.name for slot in resolve(HostRequest([], "virtual:x"))[1]] == ["maxon_epos4"]

    def test_drives_of_protocols_without_a_host_are_told(self) -> None:
        with pytest.raises(UsageError, match="drives on nobody's cannot be hosted"):
            host_on(BusName("x", Nobodys("x", "y")))


class TestWhoMovesTheHandle:
    """While a drive is off, a hand moves its handle: then a person is asked for the direction, as on a bench."""

    @pytest.mark.parametrize(
        ("bus", "hand", "led"),
        [("virtual:x", "guide", True), ("virtual:x", "none", False), ("modbus-tcp:127.0.0.1:0", "guide", False)],
    )
    def test_on_can_unless_there_is_no_hand(self, bus: str, hand: str, led: bool) -> None:
        name, (slot,) = resolve(HostRequest([], bus, hand=hand))
        assert slot.led is led
        assert rig_of(name, [slot]).axis["handle"].seen.direction == (None if led else "confirmed")

    def test_axes_have_the_names_that_are_given(self) -> None:
        name, slots = resolve(HostRequest(["maxon_epos4", "generic_cia402"], "virtual:x"))
        assert list(rig_of(name, slots, ("left", "right")).axis) == ["left", "right"]
        assert list(rig_of(name, slots).axis) == ["handle", "handle2"]


class Nobodys(BusSection):
    """A bus of a protocol that has no host."""

    protocol: ClassVar[str] = "nobody's"
