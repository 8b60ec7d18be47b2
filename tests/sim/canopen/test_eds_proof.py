"""Profiles beside the files of their vendors: what agrees, what is a fault, what the profile explains."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.drive.cia402 import IdentitySection, MappedObject, OptionCode, WrittenObject
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.eds import Eds, EdsType
from haptic_fieldbus.protocols.canopen.eds_check import Comparison
from haptic_fieldbus.protocols.canopen.from_eds import profile_from_eds
from haptic_fieldbus.protocols.canopen.profile import (
    CanopenProfile,
    CommissioningSection,
    SetupSection,
    ShownObject,
    SimulatedObject,
)
from haptic_fieldbus.protocols.catalogue import profile_file
from haptic_fieldbus.sim.canopen.eds_proof import proof_of
from tests.builders import canopen, shipped
from tests.eds.peculiar import DRIVES
from tests.eds.sheets import changed, generic, own, without, without_member
from tests.eds.vendor_files import FILES, both, eds_of, needs_files
from tests.sim.canopen.profile_mutants import NOT_SHOWN, configure, mutants, told_by

PROJECT = Path(__file__).resolve().parents[3]
GENERIC = "generic_cia402"
ITS_FILES = {
    "delta_asda_a2": ("delta_asda_a2.eds",),
    "elmo_gold": ("elmo_gold_drive.dcf",),
    "faulhaber_mclm": ("faulhaber_mclm3002p_co.eds",),
    "ingenia_everest": ("ingenia_everest_xcr.eds",),
    "maxon_epos2": ("maxon_epos2_50_5_347717.eds", "maxon_epos2_70_10.eds"),
    "maxon_epos4": ("maxon_epos4_70_15.eds", "maxon_epos4_compact_50_5_can.eds", "maxon_epos4_module_50_5_6150h.eds",
                    "maxon_epos4_module_50_5_older.eds"),
    "nanotec_c5_e": ("nanotec_c5_e_1_09.eds",),
    "nanotec_pd4_c": ("nanotec_pd4_c6018.eds", "nanotec_pd4_cb59.eds"),
    "oriental_blvd_krd": ("orientalmotor_blvd_krd_v400.eds",),
    "technosoft_ipos": ("technosoft_ipos.eds",),
    "zeroerr_erob": ("zeroerr_erob_v1_5.eds",),
}  # fmt: skip
"""Shipped profiles, and the vendors' files of the same drive."""
EVERY = [(profile, name) for profile, names in ITS_FILES.items() for name in names]


def proved(eds: Eds, **changes: object) -> Comparison:
    profile = replace(canopen(GENERIC), **changes)  # type: ignore[arg-type]
    return proof_of(profile, replace(eds, source="own.eds"))


def told(eds: Eds, **changes: object) -> dict[str, str]:
    """Faults by their keys."""
    return {fault.key: fault.message for fault in proved(eds, **changes).faults}


def plain() -> Eds:
    """Content of the generic profile, and nothing beyond it."""
    return without(changed(generic(), 0x1018, 2, default=0), 0x1006, 0x60C2)


def test_a_profile_agrees_with_the_file_of_its_own_simulated_drive() -> None:
    found = proved(plain())
    assert not found.faults
    assert not found.known
    assert {"torque.target", "position.actual", "pdo.entries", "link_loss.heartbeat_consumer"} <= {
        each.key for each in found.agreed
    }
    target = next(each for each in found.agreed if each.key == "torque.target")
    assert target.shows == "6071h:00 INTEGER16 rw, mappable"
    assert target.line == plain().objects[0x6071].line


@pytest.mark.parametrize(
    ("index", "changes", "key", "message"),
    [
        (0x6071, {"type": EdsType.INTEGER32}, "torque.target", '6071h:00 is INTEGER32, the profile says "int16"'),
        (0x6071, {"type": None}, "torque.target", "6071h:00 is of a type that only the drive defines"),
        (0x6071, {"access": "ro"}, "torque.target", "its AccessType is ro, expected rw or rww or wo"),
        (0x6071, {"mappable": False}, "torque.target", "received in a PDO: its PDOMapping is 0, expected 1"),
        (0x6064, {"mappable": False}, "position.actual", "sent in a PDO: its PDOMapping is 0, expected 1"),
        (0x6076, {"access": "wo"}, "torque.rated", "6076h:00 cannot be read by SDO"),
        (0x6007, {"access": "ro"}, "link_loss.abort_connection_option", "6007h:00 cannot be written by SDO"),
        (
            0x6007,
            {"low": 0, "high": 1, "default": 0},
            "link_loss.abort_connection_option",
            "2; 6007h:00 accepts 0 to 1",
        ),
        (0x6060, {"low": 0, "high": 8}, "torque.mode_of_operation", "10; [6060] accepts 0 to 8"),
        (0x6502, {"default": 0x6D}, "torque.mode_of_operation", "10, which is not in 6502h = 6Dh"),
        (0x6060, {"type": EdsType.UNSIGNED8}, "drive.usable", '6060h:00 is UNSIGNED8, the profile says "int8"'),
        (0x60A8, {"type": EdsType.UNSIGNED32, "default": 0xFF41_0000}, "position.actual.unit", 'expected "0.1 deg"'),
    ],
)
def test_an_entry_that_the_file_has_otherwise_is_a_fault(
    index: int, changes: dict[str, object], key: str, message: str
) -> None:
    assert message in told(changed(plain(), index, **changes))[key]


@pytest.mark.parametrize(
    ("index", "subindex", "changes", "key", "message"),
    [
        (0x1016, 1, {"access": "ro"}, "link_loss.heartbeat_consumer", "1016h:01 cannot be written by SDO"),
        (0x1018, 1, {"default": 0xFB}, "identity.vendor_id", "left out; 1018h:01 or [DeviceInfo] is FBh"),
        (0x1800, 3, {"default": 10}, "pdo.inhibit_time_default", "0 s; the longest 1800h:03 is 0.001 s"),
        (
            0x1400,
            2,
            {"default": 253},
            "pdo.rpdo_types",
            "without 253, the value of 1400h:02 or a later one after power-on",
        ),
        (0x1800, 2, {"low": 2, "high": 255}, "pdo.tpdo_types", "1; 1800h:02 accepts 2 to 255"),
        (0x1A02, 3, {"access": "ro"}, "pdo.entries", "8; 1A02h has 2 entries that can be written"),
    ],
)
def test_a_sub_index_that_the_file_has_otherwise_is_a_fault(
    index: int, subindex: int, changes: dict[str, object], key: str, message: str
) -> None:
    # Without sources there is no reason for what is left out.
    assert message in told(changed(plain(), index, subindex, **changes), sources={})[key]


@pytest.mark.parametrize(
    ("gone", "key", "message"),
    [
        (0x6071, "torque.target", "6071h:00 is not in the file"),
        (0x6077, "torque.actual", "6077h:00 is not in the file"),
        (0x6061, "drive.usable", "6061h:00 is not in the file"),
        (0x1803, "pdo.tpdos", "4; TPDO 4 is not in the file"),
    ],
)
def test_an_object_that_the_file_lacks_is_a_fault(gone: int, key: str, message: str) -> None:
    assert told(without(plain(), gone))[key] == message


def test_a_missing_sub_index_is_told_with_the_line_of_its_object() -> None:
    (fault,) = (each for each in proved(without_member(plain(), 0x1016, 1)).faults if "1016h" in each.message)
    assert fault.message == "1016h:01 is not in the file; it has 1016h without that sub-index"
    assert fault.line == plain().objects[0x1016].line


def test_more_pdos_than_the_profile_knows_would_stay_on() -> None:
    profile = canopen(GENERIC)
    fault = told(plain(), pdo=replace(profile.pdo, rpdos=2))["pdo.rpdos"]
    assert fault == "2; the file also has RPDO 3 and 4, which would stay active"


@pytest.mark.parametrize(
    ("changes", "key", "message"),
    [
        ({"actual": MappedObject(0x6078, DataType.INT16, unit="permille_of_rated_torque")}, "torque.actual",
         "6078h:00 object has another meaning; expected 6077h torque actual value"),
        ({"mode_of_operation": 9}, "torque.mode_of_operation", "9 is no torque mode of CiA 402-2"),
        ({"demand": None, "echo": "actual"}, "torque.demand", "missing, although the file has 6074h:00"),
        ({"echo": "none"}, "torque.echo", '"none", although the drive has an object that returns the torque'),
        ({"slope": WrittenObject(0x6087, DataType.INT16, 1)}, "torque.slope", '6087h:00 is UNSIGNED32'),
    ],
)  # fmt: skip
def test_a_torque_that_the_file_does_not_bear_out_is_a_fault(
    changes: dict[str, object], key: str, message: str
) -> None:
    profile = canopen(GENERIC)
    torque = replace(profile.torque, **changes)  # type: ignore[arg-type]
    assert message in told(plain(), torque=torque)[key]


def test_current_is_an_actual_torque_where_the_unit_is_one_of_current() -> None:
    actual = MappedObject(0x6078, DataType.INT16, unit="mA")
    assert "torque.actual" not in told(plain(), torque=replace(canopen(GENERIC).torque, actual=actual))


def test_what_is_left_out_is_excused_by_its_reason_and_by_no_other_text() -> None:
    profile = canopen(GENERIC)
    torque = replace(profile.torque, demand=None, echo="actual")
    for source, faults in (("left out: it lies", 0), ("CiA 402-2", 1)):
        found = proved(plain(), torque=torque, sources={**profile.sources, "torque.demand": source})
        assert sum(fault.key == "torque.demand" for fault in found.faults) == faults
        assert [known.reason for known in found.known] == ["left out: it lies"] * (1 - faults)


def test_a_value_is_kept_against_the_file_with_its_reason() -> None:
    eds = changed(plain(), 0x6502, default=0x6D)
    sources = {"torque.mode_of_operation": "against the file: its 6502h is that of another model"}
    found = proved(eds, sources={**canopen(GENERIC).sources, **sources})
    assert found.faults == ()
    assert [known.fault.key for known in found.known] == ["torque.mode_of_operation"]


def test_an_identity_that_differs_is_a_fault() -> None:
    eds = changed(changed(plain(), 0x1018, 1, default=0xFB), 0x1018, 2, default=0x6150_0000)
    assert told(eds, identity=IdentitySection(0xFB, (1, 2))) == {
        "identity.product_codes": "1h or 2h; 1018h:02 or [DeviceInfo] is 61500000h"
    }


def test_life_guarding_is_left_out_where_there_is_no_other_guard() -> None:
    link_loss = replace(canopen(GENERIC).link_loss, heartbeat_consumer=None)
    fault = told(without(plain(), 0x1016), link_loss=link_loss)["link_loss.life_guarding"]
    assert fault.startswith("missing, although the file has 100Ch:00")


def test_what_is_written_and_shown_is_looked_up_too() -> None:
    shown = ShownObject("gain", 0x2000, DataType.UINT16)
    writes = (WrittenObject(0x2001, DataType.UINT16, 7), WrittenObject(0x2002, DataType.UINT16, 7))
    eds = changed(plain(), 0x2000, type=EdsType.UNSIGNED32)
    eds = changed(changed(eds, 0x2001, access="const", default=7), 0x2002, access="const", default=8)
    found = told(eds, commissioning=CommissioningSection("tool", (shown, shown)), setup=SetupSection(writes))
    assert found["setup.writes"].startswith("2002h:00 cannot be written by SDO: its AccessType is const")
    assert found["commissioning.shown"] == "2000h:00 appears twice; expected once"


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("I²t time constants of the winding", ""),
        ("i2t time constant (thermal)", ""),
        ("Winding: I2T time-constant", ""),
        ("rated current", '"rated current"; 2000h:00 is "I2t Time Constant Winding"'),
        ("I2t gain", '"I2t gain"; 2000h:00 is "I2t Time Constant Winding"'),
    ],
)
def test_a_value_is_shown_under_a_name_that_the_file_has_for_it(name: str, fault: str) -> None:
    eds = changed(plain(), 0x2000, name="I2t Time Constant Winding", type=EdsType.UNSIGNED16)
    shown = CommissioningSection("tool", (ShownObject(name, 0x2000, DataType.UINT16),))
    assert told(eds, commissioning=shown).get("commissioning.shown.name", "").startswith(fault)
    assert bool(fault) is ("commissioning.shown.name" in told(eds, commissioning=shown))


def test_an_option_of_a_second_axis_is_another_object() -> None:
    """The drive is enabled by the objects of its first axis, so the reactions must be those of the first axis too."""
    option = OptionCode(0x6807, 2)
    link_loss = replace(canopen(GENERIC).link_loss, abort_connection_option=option)
    faults = told(changed(plain(), 0x6807, type=EdsType.INTEGER16), link_loss=link_loss)
    assert "6807h:00 object has another meaning" in faults["link_loss.abort_connection_option"]


def test_a_drive_that_is_not_usable_is_not_asked_for_torque() -> None:
    eds = without(plain(), 0x6071)
    profile = profile_from_eds(replace(eds, source="own.eds"))
    assert proof_of(profile, eds).faults == ()


def test_the_simulated_drive_is_compared_where_the_profile_describes_it() -> None:
    profile = canopen(GENERIC)
    described = replace(profile.simulation, objects={"6007": SimulatedObject(value=1)})
    eds = changed(without(plain(), 0x5FF0), 0x605A, default=6)
    assert told(eds) == {}
    (fault,) = (each for each in proved(eds, simulation=described).faults if "605A" in each.message)
    assert fault.message == "605A:00: the file has value 6, the simulated drive has it otherwise"
    excused = replace(described, differs={"605A": "chosen by hand", "1000-1FFF": "as it is", "60C2": "as it is"})
    assert all("605A" not in each.message for each in proved(eds, simulation=excused).faults)


def own_file(profile: CanopenProfile) -> Eds:
    """Return the file of the simulated drive of a profile, its values named as the profile shows them."""
    eds = own(profile)
    for shown in profile.commissioning.shown:
        eds = changed(eds, shown.object, shown.subindex, name=shown.name)
    return eds


def test_a_shipped_profile_has_no_fault_beside_the_file_of_its_own_simulated_drive() -> None:
    for name in ITS_FILES:
        profile = canopen(name)
        found = proof_of(profile, own_file(profile))
        assert [str(fault) for fault in found.faults] == [], name
        assert len(found.agreed) > (25 if profile.drive.usable else 10), name


# Vendors' files.


def test_files_are_named_of_shipped_profiles_alone() -> None:
    """A profile that is added may name its vendor's files here; it need not."""
    assert set(shipped()) - {GENERIC} >= ITS_FILES.keys()


@needs_files
@pytest.mark.parametrize(("name", "file"), EVERY)
def test_a_shipped_profile_has_no_fault_beside_its_vendors_file_but_for_those_it_explains(name: str, file: str) -> None:
    profile = canopen(name)
    found = proof_of(profile, eds_of(file))
    assert [str(fault) for fault in found.faults] == []
    assert len(found.agreed) > (25 if profile.drive.usable else 10)
    assert all(known.reason for known in found.known)


@pytest.mark.parametrize("file", both(DRIVES, FILES))
def test_a_profile_made_from_a_file_has_no_fault_beside_it(file: str) -> None:
    if file != "roboteq_v60.eds":
        eds = eds_of(file)
        assert [str(fault) for fault in proof_of(profile_from_eds(eds), eds).faults] == []


UNNOTICED = {"sync.powers"}
"""Keys where a wrong value can pass: a power of ten within the drive's limits, or where the file has neither limits nor
a value after power-on."""


def test_the_page_lists_the_keys_whose_wrong_values_can_pass() -> None:
    page = (PROJECT / "docs" / "how-to" / "add_a_drive.md").read_text(encoding="utf-8")
    told = page.partition("**What neither the check nor the drive can show.**")[2].partition("\n## ")[0]
    slip, _, unknown = told.partition("And no file and no object shows")
    assert set(re.findall(r"`([a-z_]+\.[a-z_.]+)`", slip)) == UNNOTICED
    assert set(re.findall(r"`([a-z_]+\.[a-z_.]+)`", unknown)) == NOT_SHOWN


def unnoticed(name: str, profile: CanopenProfile, sheets: list[Eds], folder: Path) -> tuple[int, list[str]]:
    """Number of mutants of a profile, and those that nobody noticed beside the files of its drive."""
    assert not any(proof_of(profile, eds).faults for eds in sheets)
    configure(profile, name)
    by = [(mutant, told_by(mutant, profile, sheets, folder)) for mutant in mutants(profile_file(name).read_text())]
    assert {"load", "check"} <= Counter(who for _, who in by).keys()
    return len(by), [mutant.key for mutant, who in by if not who]


@needs_files
@pytest.mark.parametrize("name", [name for name in ITS_FILES if canopen(name).drive.usable])
def test_of_one_step_mutations_nearly_all_are_noticed_before_torque(name: str, tmp_path: Path) -> None:
    count, missed = unnoticed(name, canopen(name), [eds_of(file) for file in ITS_FILES[name]], tmp_path)
    assert count > 60
    assert set(missed) <= UNNOTICED
    assert len(missed) <= 0.02 * count, missed


@pytest.mark.thorough("a hundred mutants of each profile")
@pytest.mark.parametrize("name", [name for name in shipped() if canopen(name).drive.usable])
def test_mutations_of_a_profile_are_noticed_beside_its_own_sheet(name: str, tmp_path: Path) -> None:
    profile = canopen(name)
    count, missed = unnoticed(name, profile, [plain() if name == GENERIC else own_file(profile)], tmp_path)
    assert count > 60
    # The file of one drive has one of the product codes.
    assert set(missed) <= UNNOTICED | ({"identity.product_codes"} if len(profile.identity.product_codes) > 1 else set())
    assert len(missed) <= 0.02 * count, missed
