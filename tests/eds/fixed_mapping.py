"""The EDS of a drive with the generic PDOs of CiA 402-3, whose mappings are read-only: they can only be switched on.

It is made from that of the simulated generic drive, so its objects are those of this project. The form is that of
vendors' files: eight PDOs in each direction, mapping records that end with the last object, COB-IDs without an
identifier from PDO 5 on, and bit 31 of each COB-ID set after power-on.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from haptic_fieldbus.eds import Eds, EdsEntry, EdsObject, EdsType, NodeOffset, ObjectCode, eds_text, read_eds
from haptic_fieldbus.protocols.canopen.from_eds import EdsProfile, profile_from_eds
from tests.eds.sheets import generic

Mappings = Mapping[int, tuple[int, ...]]
"""Values of the mapping entries by the number of the PDO."""
CONTROLWORD, STATUSWORD, MODE, MODE_DISPLAY = 0x60400010, 0x60410010, 0x60600008, 0x60610008
POSITION, TARGET_POSITION = 0x60640020, 0x607A0020
VELOCITY, TARGET_VELOCITY = 0x606C0020, 0x60FF0020
TORQUE, TARGET_TORQUE = 0x60770010, 0x60710010
RPDOS: Mappings = {
    1: (CONTROLWORD,),
    2: (CONTROLWORD, MODE),
    3: (CONTROLWORD, TARGET_POSITION),
    4: (CONTROLWORD, TARGET_VELOCITY),
    5: (CONTROLWORD, TARGET_TORQUE),
}
TPDOS: Mappings = {
    1: (STATUSWORD,),
    2: (STATUSWORD, MODE_DISPLAY),
    3: (STATUSWORD, POSITION),
    4: (STATUSWORD, VELOCITY),
    5: (STATUSWORD, TORQUE),
}
NAME = "Own_FixedPdos"
OFF = 0x8000_0000


def fixed_eds(rpdos: Mappings = RPDOS, tpdos: Mappings = TPDOS, access: str = "ro") -> Eds:
    """Return the file with these mappings, written and read again."""
    made = generic()
    kept = {index: item for index, item in made.objects.items() if not 0x1400 <= index < 0x1C00}
    for first, first_id, pdos in ((0x1400, 0x200, rpdos), (0x1800, 0x180, tpdos)):
        for number, maps in pdos.items():
            index = first + number - 1
            cob_id = NodeOffset(OFF + first_id + 0x100 * (number - 1)) if number <= 4 else OFF
            kept[index] = _record(index, f"PDO {number} communication", {
                0: (EdsType.UNSIGNED8, "const", 2),
                1: (EdsType.UNSIGNED32, "rw", cob_id),
                2: (EdsType.UNSIGNED8, "rw", 255),
            })  # fmt: skip
            mapping = {0: (EdsType.UNSIGNED8, access, len(maps))}
            mapping |= {place: (EdsType.UNSIGNED32, access, value) for place, value in enumerate(maps, start=1)}
            kept[index + 0x200] = _record(index + 0x200, f"PDO {number} mapping", mapping)
    device = replace(made.device, vendor_name="Own", product_name="Fixed PDOs", rpdos=len(rpdos), tpdos=len(tpdos))
    text = eds_text(replace(made, objects=dict(sorted(kept.items())), device=device, comments=("Made for tests",)))
    return read_eds(text.encode(), f"{NAME}.eds")


def fixed_profile(rpdos: Mappings = RPDOS, tpdos: Mappings = TPDOS) -> EdsProfile:
    """Return the profile that is made from the file."""
    return profile_from_eds(fixed_eds(rpdos, tpdos))


def written(folder: Path, rpdos: Mappings = RPDOS, tpdos: Mappings = TPDOS) -> Path:
    """Write the file and return its path."""
    path = folder / f"{NAME}.eds"
    path.write_text(eds_text(fixed_eds(rpdos, tpdos)), encoding="utf-8", newline="")
    return path


def _record(index: int, name: str, members: Mapping[int, tuple[EdsType, str, int | NodeOffset]]) -> EdsObject:
    entries = {
        subindex: EdsEntry(index, subindex, f"{name} {subindex}", type, access, default=value)
        for subindex, (type, access, value) in members.items()
    }
    return EdsObject(index, name, ObjectCode.RECORD, entries)
