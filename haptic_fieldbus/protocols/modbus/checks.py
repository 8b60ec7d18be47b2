"""Checks of a Modbus profile that its dataclasses cannot state."""

from collections.abc import Iterator

from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.units import (
    ABSOLUTE_TORQUE_UNITS,
    COUNTS,
    FULL_SCALE,
    METRES,
    RATED_TORQUE_UNITS,
    TENTH_DEGREE,
    TORQUE_UNITS,
    VELOCITY_UNITS,
)
from haptic_fieldbus.protocols.modbus.profile import (
    ECHOES,
    READ_HOLDING,
    READ_INPUT,
    READ_WRITE,
    WRITE_MULTIPLE,
    WRITE_SINGLE,
)

_SIGNED = ("int16", "int32")
_ALL = ("int16", "uint16", "int32", "uint32")
_TYPES: dict[KeyPath, tuple[str, ...]] = {
    ("power", "status"): ("uint16", "uint32"),
    ("power", "command"): ("uint16", "uint32"),
    ("torque", "target"): _SIGNED,
    ("torque", "actual"): _SIGNED,
    ("torque", "demand"): _SIGNED,
    ("position", "actual"): ("int32",),
    ("velocity", "actual"): _SIGNED,
}
"""Register → types that the master can scale or compare; all others may have any of a register."""
_UNITS = {
    ("torque", "target"): TORQUE_UNITS + ABSOLUTE_TORQUE_UNITS,
    ("torque", "actual"): TORQUE_UNITS + ABSOLUTE_TORQUE_UNITS,
    ("torque", "demand"): TORQUE_UNITS + ABSOLUTE_TORQUE_UNITS,
    ("torque", "limit"): TORQUE_UNITS + ABSOLUTE_TORQUE_UNITS,
    ("torque", "rated"): tuple(RATED_TORQUE_UNITS),
    ("position", "actual"): (COUNTS, TENTH_DEGREE, *METRES),
    ("velocity", "actual"): VELOCITY_UNITS,
    ("watchdog", "time"): ("ms", "s"),
}
_READ: tuple[KeyPath, ...] = (
    ("power", "status"), ("torque", "demand"), ("torque", "actual"), ("position", "actual"), ("velocity", "actual"),
)  # fmt: skip
_WRITTEN: tuple[KeyPath, ...] = (
    ("power", "command"), ("torque", "target"), ("torque", "limit"), ("mode", "write"), ("watchdog", "time"),
)  # fmt: skip
"""Registers with a use of their own. What is read may be what is written, as a mode that is status and command."""
_LAST = 0xFFFF


def check_profile(document: Document) -> None:
    """Note all faults of a profile that go beyond its schema."""
    _check_line(document)
    _check_places(document, _READ)
    _check_places(document, (*_WRITTEN, *_setup(document)))
    if document.value("drive", "usable") is False:
        if "drive.usable" not in document.table("sources"):
            document.fault(
                ("drive", "usable"), 'false without its reason; expected an entry "drive.usable" in [sources]'
            )
        return
    _check_motion(document)
    _check_functions(document)
    _check_types(document)
    _check_units(document)
    _check_echo(document)
    _check_power(document)


def _check_line(document: Document) -> None:
    """Note ranges of addresses in the wrong order, and facts of a serial line about a drive that has none."""
    transports = document.value("line", "transports")
    for key in ("baud", "parity", "stop_bits", "silence"):
        if isinstance(transports, list) and "rtu" not in transports and key in document.table("line"):
            document.fault(("line", key), 'without effect; expected "rtu" in line.transports, or no such key')
    ranges = document.value("line", "readable")
    for number, each in enumerate(ranges if isinstance(ranges, list) else ()):
        if isinstance(each, list) and len(each) == 2 and all(type(end) is int for end in each) and each[0] > each[1]:
            document.refuse(("line", "readable", number), "the first address before the last one")


def _check_motion(document: Document) -> None:
    """Note a profile that has neither a position nor a velocity, so that the motion of the handle is unknown."""
    if "position" not in document.data and "velocity" not in document.data:
        document.fault(
            ("position",), "missing, and so is [velocity]; expected position.actual, velocity.actual or both"
        )


def _check_functions(document: Document) -> None:
    """Note functions with which no feedback can be read, or no set-point written."""
    functions = document.value("line", "functions")
    known = set(functions) if isinstance(functions, list) else {READ_WRITE}
    both = READ_WRITE in known
    if not both and not {READ_HOLDING, READ_INPUT} & known:
        document.refuse(("line", "functions"), "3, 4 or 23 among them: without one of them nothing can be read")
    single = _count(document.value("torque", "target", "type")) == 1
    if not both and WRITE_MULTIPLE not in known and not (single and WRITE_SINGLE in known):
        wanted = "6, 16 or 23" if single else "16 or 23"
        document.refuse(("line", "functions"), f"{wanted} among them: without it no target torque can be written")


def _check_types(document: Document) -> None:
    """Note types that no register has, and those with which force cannot be rendered."""
    known = [each.value for each in DataType]
    for path in _registers(document):
        found, types = document.value(*path, "type"), _TYPES.get(path, _ALL)
        # A type that is unknown altogether has its fault from the schema.
        if found in known and found not in types:
            document.refuse((*path, "type"), " or ".join(f'"{name}"' for name in types))


def _check_units(document: Document) -> None:
    """Note units with which force cannot be rendered, and a full scale that is missing."""
    for path, units in _UNITS.items():
        if document.table(*path) and document.value(*path, "unit") not in units:
            document.refuse((*path, "unit"), " or ".join(f'"{name}"' for name in units))
    used = any(document.value("torque", key, "unit") == FULL_SCALE for key in ("target", "actual", "demand", "limit"))
    if used and "full_scale" not in document.table("torque"):
        document.fault(("torque", "full_scale"), f'missing; the unit "{FULL_SCALE}" needs the torque at 32767 [N·m]')


def _check_echo(document: Document) -> None:
    """Note a way of proving set-points for which the profile names no register."""
    way = document.value("torque", "echo")
    if way in ECHOES and not document.table("torque", str(way)):
        document.fault(("torque", "echo"), f'"{way}" without torque.{way}; expected that register too, or "none"')


def _check_power(document: Document) -> None:
    """Note a power table that is not there, or that nobody reads."""
    rows, table = document.value("power", "rows"), document.value("power", "table")
    if table == "rows" and not rows:
        document.fault(("power", "rows"), 'missing; expected a row for each state, since power.table is "rows"')
    if table != "rows" and rows:
        document.fault(("power", "rows"), 'without effect; expected power.table = "rows" beside it')
    if table != "rows" and document.value("power", "reset") is not None:
        document.fault(("power", "reset"), 'without effect; expected power.table = "rows" beside it')


def _check_places(document: Document, paths: tuple[KeyPath, ...]) -> None:
    """Note a register that two keys name, or that ends beyond the last address."""
    used: dict[int, str] = {}
    for path in paths:
        address = document.value(*path, "address")
        if type(address) is not int:
            continue
        name, count = ".".join(map(str, path)), _count(document.value(*path, "type"))
        if address + count - 1 > _LAST:
            document.fault((*path, "address"), f"0x{address:04X} and the one behind it; the last address is 0xFFFF")
        first = next((used[each] for each in range(address, address + count) if each in used), name)
        if first != name:
            document.fault((*path, "address"), f"0x{address:04X} is {first} already; expected another register")
        used |= dict.fromkeys(range(address, address + count), first)


def _count(data_type: object) -> int:
    """Return the number of registers of a type, 1 of an unknown one."""
    return 2 if data_type in ("int32", "uint32") else 1


def _setup(document: Document) -> tuple[KeyPath, ...]:
    """Return the places of the registers that are written before the drive is enabled."""
    found: list[KeyPath] = []
    for table in (("setup",), ("watchdog", "writes")):
        rows = document.value(*table)
        found += [(*table, number) for number in range(len(rows) if isinstance(rows, list) else 0)]
    return tuple(found)


def _registers(document: Document) -> Iterator[KeyPath]:
    """Yield the places of all registers that the file gives."""
    for path in (
        *_READ, *_WRITTEN, *_setup(document), ("power", "error"), ("torque", "rated"), ("mode", "display"), ("serial",),
    ):  # fmt: skip
        if document.table(*path):
            yield path
    rows = document.value("identity")
    yield from (("identity", number) for number in range(len(rows) if isinstance(rows, list) else 0))
