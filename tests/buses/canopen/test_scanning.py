"""Scanning simulated buses in virtual time: who is found, what is told, and that nothing is written."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import can
import pytest

from haptic_fieldbus.buses.canopen.access import scan_bus
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.scan_result import Scan
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.cia402 import IdentitySection, MappedObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.drive.dictionary import Access, Entry
from tests.builders import shipped
from tests.buses.canopen.test_other_master import COMMANDS, QUESTIONS
from tests.buses.canopen.two_programs import TwoPrograms, assert_uploads_alone

PROFILES = [canopen_profile(load_profile(name)) for name in ("generic_cia402", "maxon_epos4")]
OF_A_MASTER = {**COMMANDS, **{name: (can_id, data) for name, (can_id, data, _) in QUESTIONS.items()}}
ANY_NODE_MAY_SEND = {"our heartbeat", "boot-up of our node-ID"}


@pytest.fixture
def two() -> Iterator[TwoPrograms]:
    made = TwoPrograms()
    yield made
    made.close()


def scanned(two: TwoPrograms) -> Scan:
    return scan_bus(two.wire, 1.0, 1_000_000, PROFILES)


def test_both_drives_are_found_with_identity_state_and_profile(two: TwoPrograms) -> None:
    epos, generic = scanned(two).nodes
    assert (epos.node, epos.vendor_id, epos.name, epos.profile) == (5, 0xFB, "maxon EPOS4", "maxon_epos4")
    assert (generic.node, generic.profile) == (99, "generic_cia402")
    assert {each.nmt_state for each in (epos, generic)} == {"pre-operational"}
    assert {each.power_state for each in (epos, generic)} == {"switch on disabled"}
    assert (epos.sure or "").startswith("likely")
    assert (generic.sure or "").startswith("possible match")
    assert None not in (epos.product_code, epos.revision, epos.serial)


def test_where_no_node_answers_the_bus_is_to_be_checked(two: TwoPrograms) -> None:
    found = scan_bus(two.wire, 0.0, 1_000_000, PROFILES, [20])
    told = " ".join(word for row in found.rows() for word in row.note)
    assert found.nodes == ()
    assert "no node answered: check the power of the drives, the wiring, both 120 Ω terminators" in told


@pytest.mark.parametrize(("bitrate", "room"), [(1_000_000, 1e-3), (50_000, 6e-3)])
def test_nodes_are_asked_no_faster_than_the_bus_carries_their_answers(
    two: TwoPrograms, bitrate: int, room: float
) -> None:
    """A request and its answer are 300 bits, and at least a millisecond."""
    scan_bus(two.wire, 0.1, bitrate, PROFILES, range(20, 26))
    asked = [frame.timestamp for frame in two.sent() if 0x600 + 20 <= frame.arbitration_id < 0x600 + 26]
    assert len(asked) == 6
    assert min(later - earlier for earlier, later in pairwise(asked)) == pytest.approx(room, rel=0.01)


@pytest.mark.thorough("eleven drives, each asked for the objects of all that may fit")
def test_each_shipped_drive_is_taken_for_itself() -> None:
    profiles = [canopen_profile(load_profile(name)) for name in shipped()]
    two = TwoPrograms(",".join(f"{profile.name}@{10 + place}" for place, profile in enumerate(profiles)))
    found = scan_bus(two.wire, 0.1, 1_000_000, profiles).nodes
    assert_uploads_alone([frame for frame in two.sent() if not frame.is_remote_frame])
    two.close()
    names = [profile.name if profile.drive.usable else None for profile in profiles]
    assert [node.profile for node in found] == names
    for node, profile in zip(found, profiles, strict=True):
        if profile.drive.usable:
            assert (node.sure or "").startswith("certain") is bool(profile.identity.product_codes)
        else:
            assert f"it cannot render force by {profile.name}" in (node.sure or "")


def test_two_profiles_that_fit_alike_are_both_named(two: TwoPrograms) -> None:
    twin = replace(PROFILES[0], name="a_twin")
    generic = scan_bus(two.wire, 0.1, 1_000_000, [*PROFILES, twin]).nodes[1]
    assert generic.profile == "generic_cia402"
    assert "a_twin would match too" in (generic.sure or "")


def test_a_profile_that_cannot_render_force_is_named_and_not_proposed(two: TwoPrograms) -> None:
    useless = replace(PROFILES[0], name="useless", drive=replace(PROFILES[0].drive, usable=False))
    generic = scan_bus(two.wire, 0.1, 1_000_000, [useless]).nodes[1]
    assert generic.profile is None
    assert (generic.sure or "").startswith("no matching profile: none; it cannot render force by useless (possible")
    sure = replace(useless, name="sure", identity=IdentitySection(0xFB))
    epos = scan_bus(two.wire, 0.1, 1_000_000, [sure, PROFILES[0]]).nodes[0]
    assert epos.profile == "generic_cia402"
    assert "cannot render force by sure (possible:" in (epos.sure or "")


def test_a_node_with_several_axes_in_sub_indices_is_named() -> None:
    two = TwoPrograms("generic_cia402@7")
    dictionary = two.bus.world.slave(7).drive.dictionary
    dictionary.remove(0x6064)
    dictionary.add_record([Entry(0x6064, number, DataType.INT32, access=Access.RO) for number in (1, 2)])
    (node,) = scan_bus(two.wire, 0.1, 1_000_000, PROFILES).nodes
    two.close()
    assert node.profile is None
    assert "6064h:00 position actual value of generic_cia402 missing; several axes share this node" in (node.sure or "")
    assert "(6064h:01 and :02): write one profile per axis, with subindex = 1, 2 …" in (node.sure or "")


def test_nothing_is_sent_but_uploads_and_a_question_for_the_state(two: TwoPrograms) -> None:
    scanned(two)
    sent = two.sent()
    asked = [frame for frame in sent if frame.is_remote_frame]
    assert [frame.arbitration_id for frame in asked] == [0x705, 0x763]
    assert_uploads_alone([frame for frame in sent if not frame.is_remote_frame])
    assert len(sent) > 127


def test_a_drive_under_life_guarding_is_not_asked_for_its_state(two: TwoPrograms) -> None:
    two.put(99, 0x100C, 0, 100, 2)
    two.put(99, 0x100D, 0, 3, 1)
    two.forget()
    nodes = scanned(two).nodes
    assert [frame.arbitration_id for frame in two.sent() if frame.is_remote_frame] == [0x705]
    assert [node.nmt_state for node in nodes] == ["pre-operational", None]


def test_a_heartbeat_tells_the_state_without_a_question(two: TwoPrograms) -> None:
    two.put(99, 0x1017, 0, 1500, 2)  # rarer than we listen
    two.forget()
    nodes = scanned(two).nodes
    assert [frame.arbitration_id for frame in two.sent() if frame.is_remote_frame] == [0x705]
    assert [node.nmt_state for node in nodes] == ["pre-operational", "pre-operational"]


def test_a_heartbeat_that_comes_once_a_minute_is_waited_for_two_seconds_at_most(two: TwoPrograms) -> None:
    began_ns = two.clock.now_ns()
    scanned(two)
    usual_ns = two.clock.now_ns() - began_ns
    two.put(99, 0x1017, 0, 60_000, 2)
    two.forget()
    began_ns = two.clock.now_ns()
    assert [node.nmt_state for node in scanned(two).nodes] == ["pre-operational", None]
    assert two.clock.now_ns() - began_ns == pytest.approx(usual_ns + 2e9, abs=2e7)


def test_a_drive_without_the_objects_of_any_profile_has_none() -> None:
    two = TwoPrograms()
    target = MappedObject(0x2FF1, DataType.INT16, unit="permille_of_rated_torque")
    own = [replace(profile, torque=replace(profile.torque, target=target)) for profile in PROFILES]
    found = scan_bus(two.wire, 0.1, 1_000_000, own).nodes
    two.close()
    assert [(node.node, node.profile) for node in found] == [(5, None), (99, None)]
    assert "2FF1h:00" in (found[0].sure or "")


@pytest.mark.parametrize("name", sorted(OF_A_MASTER.keys() - ANY_NODE_MAY_SEND))
def test_with_another_master_it_only_listens(two: TwoPrograms, name: str) -> None:
    two.send(0x733, b"\x05")
    two.send(*OF_A_MASTER[name])
    found = scanned(two)
    assert "another master on" in found.masters
    assert (0x33, "operational", None, None) in [(n.node, n.nmt_state, n.vendor_id, n.profile) for n in found.nodes]
    assert two.sent() == []


def test_a_master_that_begins_while_nodes_are_asked_ends_the_questions(two: TwoPrograms) -> None:
    asked: list[int] = []
    send = two.wire._send

    def sent(can_id: int, data: bytes | bytearray) -> None:
        asked.append(can_id)
        if can_id == 0x67F:
            two.send(0x080)
        send(can_id, data)

    two.wire._send = sent
    found = scanned(two)
    assert "SYNC (080h)" in found.masters
    assert asked == [0x600 + node for node in range(1, 128)]
    assert [(node.node, node.vendor_id) for node in found.nodes] == [(5, None), (99, None)]


def test_an_empty_bus_has_no_nodes_and_one_that_only_beats_is_told() -> None:
    with can.Bus(interface="virtual", channel="scan") as bus, can.Bus(interface="virtual", channel="scan") as other:
        wire = Wire(bus, Ticking(), "wire")
        assert scan_bus(wire, 0.001, 1_000_000, PROFILES).nodes == ()
        other.send(can.Message(arbitration_id=0x77F, data=b"\x04", is_extended_id=False))
        (node,) = scan_bus(wire, 0.001, 1_000_000, PROFILES).nodes
        assert (node.node, node.nmt_state, node.vendor_id, node.profile) == (127, "stopped", None, None)


def test_a_bus_of_nothing_but_error_frames_is_not_asked() -> None:
    """A frame at a wrong bit rate destroys the frames of others."""
    with can.Bus(interface="virtual", channel="noise") as bus, can.Bus(interface="virtual", channel="noise") as other:
        for _ in range(3):
            other.send(can.Message(is_error_frame=True, arbitration_id=0x08, dlc=8, data=bytes(8)))
        with pytest.raises(BusError, match=r"only error frames.*bit rate"):
            scan_bus(Wire(bus, Ticking(), "wire"), 0.01, 1_000_000, PROFILES)
        assert other.recv(0.0) is None


class Ticking(VirtualClock):
    """Time that passes whenever somebody looks, as on a bus where nothing comes."""

    def now_ns(self) -> int:
        self.compute(1_000_000)
        return super().now_ns()
