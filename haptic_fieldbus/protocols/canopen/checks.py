"""Checks of a CANopen profile that its dataclasses cannot state."""

import re

from haptic_fieldbus.documents import Document
from haptic_fieldbus.drive.cia402 import ECHOES
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.units import (
    COUNTS,
    MILLIAMPERE,
    RATED_TORQUE_UNITS,
    TENTH_DEGREE,
    TORQUE_UNITS,
    VELOCITY_UNITS,
)
from haptic_fieldbus.protocols.canopen.pdo import LARGEST_PAYLOAD, OCTETS

# The types and units that the master can scale, by the key of the profile.
_TYPES = {
    ("torque", "target"): ("int16", "int32"),
    ("torque", "actual"): ("int16", "int32"),
    ("torque", "demand"): ("int16", "int32"),
    ("position", "actual"): ("int32",),
    ("velocity", "actual"): ("int32",),
}
_UNITS = {
    ("torque", "target"): TORQUE_UNITS,
    ("torque", "actual"): TORQUE_UNITS,
    ("torque", "demand"): TORQUE_UNITS,
    ("torque", "rated"): tuple(RATED_TORQUE_UNITS),
    ("torque", "rated_current"): (MILLIAMPERE,),
    ("position", "actual"): (COUNTS, TENTH_DEGREE),
    ("velocity", "actual"): VELOCITY_UNITS,
}
_PLACE = re.compile(r"[0-9A-Fa-f]{4}(-[0-9A-Fa-f]{4})?(:[0-9A-Fa-f]{1,2}(-[0-9A-Fa-f]{1,2})?)?")
"""Key of an object, or of several."""
_OPTIONS = (("link_loss", "abort_connection_option"), ("link_loss", "fault_reaction_option"))


def check_profile(document: Document) -> None:
    """Note all faults of a profile that go beyond its schema."""
    _check_motion(document)
    _check_signals(document)
    _check_objects(document)
    _check_echo(document)
    _check_guard(document)
    _check_fixed(document)
    _check_simulated(document)


def _check_motion(document: Document) -> None:
    """Note a profile that has neither a position nor a velocity, so that the motion of the handle is unknown."""
    if "position" not in document.data and "velocity" not in document.data:
        document.fault(
            ("position",), "missing, and so is [velocity]; expected position.actual, velocity.actual or both"
        )


def _check_signals(document: Document) -> None:
    """Note types and units with which force cannot be rendered; a profile of an unusable drive may have any."""
    if document.value("drive", "usable") is False:
        if "drive.usable" not in document.table("sources"):
            document.fault(
                ("drive", "usable"), 'false without its reason; expected an entry "drive.usable" in [sources]'
            )
        return
    known = [data_type.value for data_type in DataType]
    for path, types in _TYPES.items():
        found = document.value(*path, "type")
        # A type that is unknown altogether has its fault from the schema.
        if found in known and found not in types:
            document.refuse((*path, "type"), " or ".join(f'"{name}"' for name in types))
    for path, units in _UNITS.items():
        found = document.value(*path, "unit")
        if document.table(*path) and found not in units:
            document.refuse((*path, "unit"), " or ".join(f'"{name}"' for name in units))


def _check_objects(document: Document) -> None:
    """Note an object that two keys name: each object has one use, so the second is a slip of copying."""
    used: dict[tuple[int, str], str] = {}
    for path in (*_UNITS, *_OPTIONS):
        index, subindex = document.value(*path, "object"), str(document.value(*path, "subindex") or 0)
        if not isinstance(index, int):
            continue
        name = ".".join(path)
        first = used.setdefault((index, subindex), name)
        if first != name:
            document.fault((*path, "object"), f"0x{index:04X} is {first} already; expected another object")


def _check_echo(document: Document) -> None:
    """Note a way of proving set-points for which the profile names no object."""
    way = document.value("torque", "echo")
    # What is asked is the target itself, which every profile has.
    if way in ECHOES and way != "asked" and not document.table("torque", str(way)):
        document.fault(("torque", "echo"), f'"{way}" without torque.{way}; expected that object too, or "none"')


def _check_fixed(document: Document) -> None:
    """Note a fixed mapping that no frame carries, and a PDO that is named twice."""
    for key in ("tpdo_fixed", "rpdo_fixed"):
        numbers: set[object] = set()
        for place, each in enumerate(_tables(document.value("pdo", key))):
            bits = [value & 0xFF for value in _numbers(each.get("maps"))]
            if sum(bits) > 8 * LARGEST_PAYLOAD or any(each not in OCTETS for each in bits):
                expected = "objects of 8, 16 or 32 bits, 64 together, as in [0x60400010, 0x60710010]"
                document.fault(("pdo", key, place, "maps"), f"no mapping of a PDO; expected {expected}")
            if each.get("number") in numbers:
                document.fault(("pdo", key, place, "number"), f"{each['number']} is there already; expected another")
            numbers.add(each.get("number"))


def _tables(value: object) -> list[dict[str, object]]:
    return [each for each in value if isinstance(each, dict)] if isinstance(value, list) else []


def _numbers(value: object) -> list[int]:
    return [each for each in value if isinstance(each, int)] if isinstance(value, list) else []


def _check_simulated(document: Document) -> None:
    """Note a key of the simulated drive that names no object."""
    for table in ("objects", "differs"):
        for key in document.table("simulation", table):
            if not _PLACE.fullmatch(key):
                document.fault(
                    ("simulation", table, key),
                    'no object; expected hexadecimal numbers or ranges as in "6007", "60C2:01" or "1400-1403:05"',
                )


def _check_guard(document: Document) -> None:
    """Note two guards: a node has either heartbeats or node guarding (CiA 301 7.2.8.3.2)."""
    if document.value("link_loss", "life_guarding") is True and "heartbeat_consumer" in document.table("link_loss"):
        document.fault(
            ("link_loss", "life_guarding"), "true beside link_loss.heartbeat_consumer; expected exactly one of both"
        )
