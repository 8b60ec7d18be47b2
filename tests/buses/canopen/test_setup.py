"""Opening a bus: what is written, in which order, and what is refused."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import pytest

from haptic_fieldbus.drive.cia402 import IdentitySection, MappedObject
from haptic_fieldbus.drive.profile import DataType, Identity
from haptic_fieldbus.errors import BusConfigurationError, BusError, BusTimeoutError, DriveFaultError, PlanError
from haptic_fieldbus.protocols.canopen.profile import LinkLossSection
from haptic_fieldbus.scenes.wall import Wall
from tests.builders import PROFILE, WALL, plan_of, rig_of, scene_of
from tests.buses.canopen.benches import LISTENING_NS, NODE, TORQUE_FREE, Bench
from tests.buses.canopen.fake_can import FakeDrive

PRE_OPERATIONAL = (0x000, bytes((0x80, NODE)))
OPERATIONAL = (0x000, bytes((0x01, NODE)))


def test_a_drive_is_configured_entry_by_entry_in_the_order_of_the_standard() -> None:
    bench = Bench().open()
    assert bench.written() == [
        ("1017h:00", 100),
        ("1016h:01", 127 << 16 | 50),
        ("6007h:00", 2),
        ("605Eh:00", 0),
        ("6060h:00", 10),
        ("1800h:01", 0xC000_0181),
        ("1A00h:00", 0),
        ("1A00h:01", 0x6041_0010),
        ("1A00h:02", 0x6064_0020),
        ("1A00h:03", 0x6077_0010),
        ("1A00h:00", 3),
        ("1800h:02", 1),
        ("1800h:01", 0x4000_0181),
        ("1400h:01", 0x8000_0201),
        ("1600h:00", 0),
        ("1600h:01", 0x6040_0010),
        ("1600h:02", 0x6071_0010),
        ("1600h:00", 2),
        ("1400h:02", 255),
        ("1400h:01", 0x0000_0201),
    ]


def test_every_write_is_read_back() -> None:
    bench = Bench().open()
    requests = [data for _, can_id, data in bench.can.sent if can_id == 0x600 + NODE]
    for before, after in pairwise(requests):
        if before[0] >> 5 == 1:
            assert after[:4] == b"\x40" + before[1:4]


def test_pdos_that_the_plan_does_not_use_are_switched_off() -> None:
    bench = Bench()
    bench.drive.objects[0x1802, 1] = (0x4000_0381).to_bytes(4, "little")
    bench.drive.objects[0x1401, 1] = (0x0000_0301).to_bytes(4, "little")
    bench.open()
    assert bench.drive.value(0x1802, 1) == 0xC000_0381
    assert bench.drive.value(0x1401, 1) == 0x8000_0301


def test_the_node_is_pre_operational_while_it_is_written_and_operational_at_the_end() -> None:
    bench = Bench().open()
    sent = [(can_id, data) for _, can_id, data in bench.can.sent]
    commands = [at for at, (can_id, _) in enumerate(sent) if can_id == 0x000]
    writes = [at for at, (can_id, data) in enumerate(sent) if can_id == 0x601 and data[0] >> 5 == 1]
    assert [sent[at] for at in commands] == [PRE_OPERATIONAL, OPERATIONAL]
    assert commands[0] < writes[0]
    assert writes[-1] < commands[1]
    assert bench.drive.state == 0x05


def test_what_the_drive_said_is_kept_as_facts() -> None:
    facts = Bench().open().bus.facts["handle"]
    assert (facts.node, facts.identity) == (NODE, Identity(0xFB, 0x6050_0000, 0x0168_0000, 0x1234))
    assert facts.rated_torque == pytest.approx(0.4)
    assert facts.link_loss == "on link loss the shaft is free within 50 ms"


def test_a_rig_may_ask_for_a_brake_on_link_loss() -> None:
    """Only of a drive whose quick stop ends without torque: 605Ah is written and read back."""
    plan = plan_of(rig=rig_of(WALL, on_link_loss="brake"))
    bench = Bench(plan)
    bench.drive.objects[0x605A, 0] = (6).to_bytes(2, "little")
    bench.open()
    assert (bench.drive.value(0x6007), bench.drive.value(0x605A)) == (3, 2)
    assert "begins to brake" in bench.bus.facts["handle"].link_loss
    with pytest.raises(BusConfigurationError, match="605Ah:00 quick stop option code: refused"):
        Bench(plan).open()


def test_a_drive_left_enabled_is_disabled_first() -> None:
    bench = Bench()
    bench.drive.objects[0x6041, 0] = (0x27).to_bytes(2, "little")
    bench.open()
    assert bench.written()[1] == ("6040h:00", 0)
    assert bench.drive.value(0x6041) == 0x40


def test_objects_that_only_some_drives_have_may_be_absent() -> None:
    bench = Bench()
    for key in ((0x1005, 0), (0x1018, 3), (0x1018, 4)):
        del bench.drive.objects[key]
    facts = bench.open().bus.facts["handle"]
    assert facts.identity == Identity(0xFB, 0x6050_0000)


def test_answers_and_restarts_from_before_opening_are_dropped() -> None:
    bench = Bench()
    bench.can.reply(0x580 + NODE, b"\x43\x00\x10\x00\xff\xff\xff\xff", delay_ns=0)
    bench.drive.restart()
    bench.open()


def test_the_answer_to_a_question_that_is_not_ours_is_passed_over() -> None:
    """One of ours that was given up, or somebody else's, whose own request is heard as such."""
    bench = Bench()
    bench.can.reply(0x580 + NODE, b"\x43\x08\x10\x00\xff\xff\xff\xff", delay_ns=LISTENING_NS + 1)
    assert bench.open().bus.facts["handle"].identity.vendor == 0xFB


def test_silence_is_explained_by_what_the_drive_said_before() -> None:
    bench = Bench()
    bench.drive.emergency(0x3210, LISTENING_NS + 1)
    bench.can.later(LISTENING_NS + 3_000_000, lambda: setattr(bench.drive, "silent", True))
    with pytest.raises(BusTimeoutError, match=r"no answer\. Before that, it sent emergency 3210h \(.*over-voltage"):
        bench.open()


def test_an_answer_of_another_kind_than_the_request_asks_for_is_refused() -> None:
    bench = Bench()
    bench.can.reply(0x580 + NODE, b"\x60\x00\x10\x00" + bytes(4), delay_ns=LISTENING_NS + 1)
    with pytest.raises(BusConfigurationError, match="wrong answer"):
        bench.open()


def _set(index: int, subindex: int, value: int, size: int) -> Callable[[FakeDrive], None]:
    def change(drive: FakeDrive) -> None:
        drive.objects[index, subindex] = value.to_bytes(size, "little")

    return change


def _silence(drive: FakeDrive) -> None:
    drive.silent = True


REFUSED_BEFORE_WRITING: dict[str, tuple[Callable[[FakeDrive], None], type[Exception], str]] = {
    "no answer": (_silence, BusTimeoutError, r"node 1 .*does not answer on bus at 1000000 bit/s: check"),
    "not a drive": (_set(0x1000, 0, 0x0000_0191, 4), BusConfigurationError, "not a CiA 402 drive.*00000191h"),
    "wrong vendor": (_set(0x1018, 1, 0x9A, 4), BusConfigurationError, "vendor 0000009Ah.*expects vendor 000000FBh"),
    "wrong rating": (_set(0x6076, 0, 500_000, 4), BusConfigurationError, r"is 0\.5 N·m.*rig has 0\.4 N·m"),
    "other SYNC": (_set(0x1005, 0, 0x81, 4), BusConfigurationError, "00000081h; a SYNC consumer at 080h"),
    "SYNC producer": (_set(0x1005, 0, 0x4000_0080, 4), BusConfigurationError, "40000080h"),
    "fault": (_set(0x6041, 0, 0x08, 2), DriveFaultError, "state fault, error code 0000h.*then reset"),
}


@pytest.mark.parametrize("name", REFUSED_BEFORE_WRITING)
def test_a_wrong_drive_is_refused_before_anything_is_written(name: str) -> None:
    change, error, words = REFUSED_BEFORE_WRITING[name]
    bench = Bench()
    change(bench.drive)
    with pytest.raises(error, match=words):
        bench.open()
    assert bench.written() == []
    assert bench.can.of(0x000) == []


def test_a_product_code_that_the_profile_does_not_list_is_refused_with_both_values() -> None:
    identity = IdentitySection(vendor_id=0xFB, product_codes=(0x6150_0000, 0x6151_0000))
    bench = Bench(plan_of(profile=replace(PROFILE, identity=identity)))
    with pytest.raises(BusConfigurationError, match=r"product 60500000h.*product 61500000h or 61510000h"):
        bench.open()


def _abort(index: int, subindex: int, code: int) -> Callable[[FakeDrive], None]:
    def change(drive: FakeDrive) -> None:
        drive.aborts[index, subindex] = code

    return change


def _forget(index: int, subindex: int = 0) -> Callable[[FakeDrive], None]:
    def change(drive: FakeDrive) -> None:
        drive.forgets.add((index, subindex))

    return change


def _stay(state: int) -> Callable[[FakeDrive], None]:
    def change(drive: FakeDrive) -> None:
        drive.stays_in = state

    return change


def _stay_enabled(drive: FakeDrive) -> None:
    drive.power_stays = 0x27
    drive.objects[0x6041, 0] = b"\x27\x00"


def _restart_soon(drive: FakeDrive) -> None:
    drive.bus.later(LISTENING_NS + 5_000_000, drive.restart)


FAILING: dict[str, tuple[Callable[[FakeDrive], None], type[Exception], str]] = {
    "abort": (_abort(0x6007, 0, 0x0609_0030), BusConfigurationError, "6007h.*Value range .*06090030h"),
    "vendor abort": (_abort(0x6060, 0, 0x0F00_FFC0), BusConfigurationError, "CiA 301 does not list.*0F00FFC0h"),
    "guard not kept": (_forget(0x1016, 1), BusConfigurationError, "did not keep 1016h:01.*, read back 0"),
    "reaction not kept": (_forget(0x605E), BusConfigurationError, "did not keep 605Eh:00 .*wrote 0, read back 2"),
    "mapping not kept": (_forget(0x1A00, 2), BusConfigurationError, "did not keep 1A00h:02 TPDO mapping"),
    "type not kept": (_forget(0x1800, 2), BusConfigurationError, "did not keep 1800h:02"),
    "mode not kept": (_forget(0x6060), BusConfigurationError, "did not keep 6060h:00 modes of operation"),
    "stays pre-operational": (
        _stay(0x7F),
        BusTimeoutError,
        "did not confirm operational.*the last one reports pre-operational",
    ),
    "stays operational": (
        _stay(0x05),
        BusTimeoutError,
        "did not confirm pre-operational.*the last one reports operational",
    ),
    "stays enabled": (
        _stay_enabled,
        BusConfigurationError,
        r"is still enabled after the command disable voltage .*waited 1 s",
    ),
    "restart": (_restart_soon, BusConfigurationError, "restarted while it was configured"),
}


@pytest.mark.parametrize("name", FAILING)
def test_a_drive_that_cannot_be_configured_is_left_pre_operational_and_never_enabled(name: str) -> None:
    change, error, words = FAILING[name]
    bench = Bench()
    if name == "stays operational":
        bench.drive.state = 0x05
    change(bench.drive)
    with pytest.raises(error, match=words):
        bench.open()
    assert bench.can.of(0x000)[-1] == bytes((0x80, NODE))
    assert set(bench.can.of(0x200 + NODE)) <= {TORQUE_FREE}


def test_a_mode_that_is_not_taken_over_in_time_is_named() -> None:
    bench = Bench()
    store = bench.drive._store

    def without_mode(key: tuple[int, int], data: bytes) -> None:
        store(key, data)
        if key == (0x6060, 0):
            bench.drive.objects[0x6061, 0] = b"\x00"

    bench.drive._store = without_mode  # type: ignore[method-assign]
    with pytest.raises(BusConfigurationError, match=r"mode of operation 10: 6061h:00 .* is 0 \(waited 1 s\)"):
        bench.open()


@pytest.mark.parametrize(
    "section", [LinkLossSection(), LinkLossSection(heartbeat_consumer=0x1016)], ids=["no guard", "no reaction"]
)
def test_a_drive_that_cannot_notice_the_loss_of_its_master_is_refused(section: LinkLossSection) -> None:
    rig, profile = rig_of(WALL, emergency_stop="power"), replace(PROFILE, link_loss=section)
    with pytest.raises(PlanError, match="hold its last torque"):
        plan_of(profile=profile)
    plan = plan_of(rig=rig, profile=profile)
    Bench(plan).open()
    # Nor by the bus, should a plan have forgotten it.
    (axis,) = plan.axes
    forgotten = replace(plan, axes=(replace(axis, rig=replace(axis.rig, emergency_stop=None)),))
    with pytest.raises(BusConfigurationError, match="hold the last torque"):
        Bench(forgotten).open()


def test_an_unknown_unit_of_rated_torque_is_refused() -> None:
    torque = replace(PROFILE.torque, rated=MappedObject(0x6076, DataType.UINT32, unit="ozf·in"))
    with pytest.raises(BusConfigurationError, match=r"'ozf·in'.*is not one of µN·m"):
        Bench(plan_of(profile=replace(PROFILE, torque=torque))).open()


@pytest.mark.parametrize(("micro", "fits"), [(394_000, True), (406_000, True), (385_000, False), (415_000, False)])
def test_a_rated_torque_that_is_3_percent_beside_the_rig_is_refused(micro: int, fits: bool) -> None:
    """One that is 1.5 % beside is the drive's rounding."""
    bench = Bench()
    bench.drive.objects[0x6076, 0] = micro.to_bytes(4, "little")
    with (
        nullcontext() if fits else pytest.raises(BusConfigurationError, match=r"rated torque is 0\.\d+ N·m .*0\.4 N·m")
    ):
        bench.open()


def test_a_value_shorter_than_its_type_is_refused() -> None:
    bench = Bench()
    bench.drive.objects[0x6076, 0] = b"\x10\x27"
    with pytest.raises(BusConfigurationError, match="6076h:00 motor rated torque: received 2 octets, expected uint32"):
        bench.open()


def test_one_missing_drive_leaves_the_others_untouched() -> None:
    plan = plan_of(scene_of(Wall("left", stiffness=100.0, name="a"), Wall("right", stiffness=100.0, name="b")))
    bench = Bench(plan)
    bench.drives[1].silent = True
    with pytest.raises(BusTimeoutError, match="node 2"):
        bench.open()
    assert bench.written() == []


def test_a_bus_can_be_opened_again_after_a_failure() -> None:
    bench = Bench()
    bench.drive.aborts[0x6007, 0] = 0x0609_0030
    with pytest.raises(BusError):
        bench.open()
    bench.drive.aborts.clear()
    bench.open()
    assert bench.drive.state == 0x05


@pytest.mark.parametrize("octets", [bytes.fromhex("2c 01"), bytes.fromhex("d4 fe ff ff")])
def test_a_torque_offset_of_another_program_is_cleared_and_told(octets: bytes) -> None:
    """The drive adds 60B2h to each set-point (CiA 402-2), in 16 bits or, so Ingenia Everest XCR, in 32."""
    bench = Bench()
    bench.drive.objects[0x60B2, 0] = octets
    bench.open()
    assert bench.drive.objects[0x60B2, 0] == bytes(len(octets))
    names = [name for name, _ in bench.written()]
    assert names.index("60B2h:00") > names.index("1400h:01")
    held = int.from_bytes(octets, "little", signed=True)
    assert bench.bus.warnings == [
        f"node 1 (axis handle): 60B2h:00 torque offset was {held}, and is 0 now: the drive adds it to each set-point"
    ]


def test_a_torque_offset_that_stays_is_refused() -> None:
    bench = Bench()
    bench.drive.objects[0x60B2, 0] = bytes((44, 1))
    bench.drive.forgets.add((0x60B2, 0))
    with pytest.raises(BusConfigurationError, match="did not keep 60B2h:00 torque offset: wrote 0, read back 300"):
        bench.open()


def test_no_torque_offset_is_not_written() -> None:
    bench = Bench()
    bench.drive.objects[0x60B2, 0] = bytes(2)
    bench.open()
    assert "60B2h:00" not in [name for name, _ in bench.written()]


def test_a_torque_offset_that_the_drive_refuses_to_show_is_told() -> None:
    """Drives name an object that they lack by many abort codes."""
    bench = Bench()
    bench.drive.refusals[0x60B2, 0] = 0x0601_0000
    bench.open()
    (told,) = bench.bus.warnings
    assert "reading 60B2h:00 torque offset" in told
    assert told.endswith("So it is not known whether the drive adds a torque offset to each set-point")
