"""The object dictionary that the foreign masters use: CiA 301 and CiA 402-2, written out by hand, for canopen."""

from canopen import ObjectDictionary
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

U8, U16, U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
I8, I16, I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
TEXT, DOMAIN = datatypes.VISIBLE_STRING, datatypes.DOMAIN

VARIABLES = {
    0x1000: ("device type", U32, "ro"),
    0x1001: ("error register", U8, "ro"),
    0x1005: ("COB-ID SYNC", U32, "rw"),
    0x1008: ("manufacturer device name", TEXT, "const"),
    0x100C: ("guard time", U16, "rw"),
    0x100D: ("life time factor", U8, "rw"),
    0x1014: ("COB-ID EMCY", U32, "rw"),
    0x1017: ("producer heartbeat time", U16, "rw"),
    0x6007: ("abort connection option code", I16, "rw"),
    0x603F: ("error code", U16, "ro"),
    0x6040: ("controlword", U16, "rw"),
    0x6041: ("statusword", U16, "ro"),
    0x605A: ("quick stop option code", I16, "rw"),
    0x6060: ("modes of operation", I8, "rw"),
    0x6061: ("modes of operation display", I8, "ro"),
    0x6064: ("position actual value", I32, "ro"),
    0x606C: ("velocity actual value", I32, "ro"),
    0x6071: ("target torque", I16, "rw"),
    0x6077: ("torque actual value", I16, "ro"),
    0x6502: ("supported drive modes", U32, "ro"),
}
RECORDS = {
    0x1003: ("pre-defined error field", [("standard error field", U32, "ro")] * 4),
    0x1016: ("consumer heartbeat time", [("consumer", U32, "rw")]),
    0x1018: (
        "identity object",
        [("vendor-ID", U32, "ro"), ("product code", U32, "ro"), ("revision", U32, "ro"), ("serial", U32, "ro")],
    ),
    0x5FF0: ("user data memory", [("block 1", DOMAIN, "rw"), ("block 2", DOMAIN, "rw")]),
}
PDOS = 4
_COMMUNICATION = [("COB-ID", U32, "rw"), ("transmission type", U8, "rw"), ("inhibit time", U16, "rw")]


def dictionary() -> ObjectDictionary:
    """A new one; canopen keeps values in it."""
    objects = ObjectDictionary()
    for index, (name, data_type, access) in VARIABLES.items():
        objects.add_object(_variable(name, index, 0, data_type, access))
    for index, (name, members) in RECORDS.items():
        objects.add_object(_record(name, index, members))
    for number in range(PDOS):
        for base, name in ((0x1400, "RPDO"), (0x1800, "TPDO")):
            objects.add_object(_record(f"{name} {number + 1} communication", base + number, _COMMUNICATION))
            mapping = [("mapped object", U32, "rw")] * 8
            objects.add_object(_record(f"{name} {number + 1} mapping", base + 0x200 + number, mapping, count="rw"))
    return objects


def _record(name: str, index: int, members: list[tuple[str, int, str]], count: str = "ro") -> ODRecord:
    record = ODRecord(name, index)
    record.add_member(_variable("number of entries", index, 0, U8, count))
    for subindex, (member, data_type, access) in enumerate(members, start=1):
        record.add_member(_variable(f"{member} {subindex}", index, subindex, data_type, access))
    return record


def _variable(name: str, index: int, subindex: int, data_type: int, access: str) -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type = data_type
    variable.access_type = access
    return variable
