"""Names of the objects of the standards, as an EDS gives them in `ParameterName`.

Reference: CiA 301 4.2, 7.5 (communication profile area), CiA 402-2 (drive profile), object descriptions.
"""

from collections.abc import Mapping
from enum import IntEnum

# Data types of CANopen by their index in the object dictionary, as an EDS names them.
#
# Reference: CiA 301 4.2, table 44 (object dictionary data types) and 7.1 (encoding).


class EdsType(IntEnum):
    """A basic data type; the value stands behind `DataType=`."""

    BOOLEAN = 0x01
    INTEGER8 = 0x02
    INTEGER16 = 0x03
    INTEGER32 = 0x04
    UNSIGNED8 = 0x05
    UNSIGNED16 = 0x06
    UNSIGNED32 = 0x07
    REAL32 = 0x08
    VISIBLE_STRING = 0x09
    OCTET_STRING = 0x0A
    UNICODE_STRING = 0x0B
    TIME_OF_DAY = 0x0C
    TIME_DIFFERENCE = 0x0D
    DOMAIN = 0x0F
    INTEGER24 = 0x10
    REAL64 = 0x11
    INTEGER40 = 0x12
    INTEGER48 = 0x13
    INTEGER56 = 0x14
    INTEGER64 = 0x15
    UNSIGNED24 = 0x16
    UNSIGNED40 = 0x18
    UNSIGNED48 = 0x19
    UNSIGNED56 = 0x1A
    UNSIGNED64 = 0x1B

    @property
    def size(self) -> int | None:
        """Number of octets in an SDO; None when it depends on the value."""
        return _SIZES.get(self)

    @property
    def signed(self) -> bool:
        return self.name.startswith("INTEGER")

    @property
    def is_integer(self) -> bool:
        """Whether values are whole numbers; times and BOOLEAN count as such."""
        return self.size is not None and self not in REALS

    @property
    def limits(self) -> tuple[int, int] | None:
        """The lowest and the highest whole number; None for a type whose values are none."""
        if not self.is_integer:
            return None
        if self is EdsType.BOOLEAN:
            return 0, 1
        bits = 8 * (self.size or 0)
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)


REALS = (EdsType.REAL32, EdsType.REAL64)
TEXTS = (EdsType.VISIBLE_STRING, EdsType.UNICODE_STRING)
TIMES = (EdsType.TIME_OF_DAY, EdsType.TIME_DIFFERENCE)
OCTETS = (EdsType.OCTET_STRING, EdsType.DOMAIN)

_SIZES = {
    EdsType.BOOLEAN: 1,
    EdsType.REAL32: 4,
    EdsType.REAL64: 8,
    **dict.fromkeys(TIMES, 6),
} | {
    member: int(member.name.removeprefix("INTEGER").removeprefix("UNSIGNED")) // 8
    for member in EdsType
    if member.name.startswith(("INTEGER", "UNSIGNED"))
}


PARAMETERS: Mapping[int, str] = {
    0x1000: "Device type",
    0x1001: "Error register",
    0x1002: "Manufacturer status register",
    0x1003: "Pre-defined error field",
    0x1005: "COB-ID SYNC message",
    0x1006: "Communication cycle period",
    0x1007: "Synchronous window length",
    0x1008: "Manufacturer device name",
    0x1009: "Manufacturer hardware version",
    0x100A: "Manufacturer software version",
    0x100B: "Node-ID",
    0x100C: "Guard time",
    0x100D: "Life time factor",
    0x1010: "Store parameters",
    0x1011: "Restore default parameters",
    0x1012: "COB-ID time stamp object",
    0x1013: "High resolution time stamp",
    0x1014: "COB-ID EMCY",
    0x1015: "Inhibit time EMCY",
    0x1016: "Consumer heartbeat time",
    0x1017: "Producer heartbeat time",
    0x1018: "Identity object",
    0x1019: "Synchronous counter overflow value",
    0x1020: "Verify configuration",
    0x1021: "Store EDS",
    0x1022: "Store format",
    0x1023: "OS command",
    0x1024: "OS command mode",
    0x1028: "Emergency consumer object",
    0x1029: "Error behaviour object",
    0x1200: "SDO server parameter",
    0x1F80: "NMT startup",
    0x5FF0: "User data memory",
    0x5FF1: "Time of day",
    0x5FF2: "Erase user data memory",
    0x6007: "Abort connection option code",
    0x603F: "Error code",
    0x6040: "Controlword",
    0x6041: "Statusword",
    0x6042: "vl target velocity",
    0x6043: "vl velocity demand",
    0x6044: "vl velocity actual value",
    0x6046: "vl velocity min max amount",
    0x6048: "vl velocity acceleration",
    0x6049: "vl velocity deceleration",
    0x604A: "vl velocity quick stop",
    0x604C: "vl dimension factor",
    0x605A: "Quick stop option code",
    0x605B: "Shutdown option code",
    0x605C: "Disable operation option code",
    0x605D: "Halt option code",
    0x605E: "Fault reaction option code",
    0x6060: "Modes of operation",
    0x6061: "Modes of operation display",
    0x6062: "Position demand value",
    0x6063: "Position actual internal value",
    0x6064: "Position actual value",
    0x6065: "Following error window",
    0x6066: "Following error time out",
    0x6067: "Position window",
    0x6068: "Position window time",
    0x6069: "Velocity sensor actual value",
    0x606A: "Sensor selection code",
    0x606B: "Velocity demand value",
    0x606C: "Velocity actual value",
    0x606D: "Velocity window",
    0x606E: "Velocity window time",
    0x606F: "Velocity threshold",
    0x6070: "Velocity threshold time",
    0x6071: "Target torque",
    0x6072: "Max torque",
    0x6073: "Max current",
    0x6074: "Torque demand",
    0x6075: "Motor rated current",
    0x6076: "Motor rated torque",
    0x6077: "Torque actual value",
    0x6078: "Current actual value",
    0x6079: "DC link circuit voltage",
    0x607A: "Target position",
    0x607B: "Position range limit",
    0x607C: "Home offset",
    0x607D: "Software position limit",
    0x607E: "Polarity",
    0x607F: "Max profile velocity",
    0x6080: "Max motor speed",
    0x6081: "Profile velocity",
    0x6082: "End velocity",
    0x6083: "Profile acceleration",
    0x6084: "Profile deceleration",
    0x6085: "Quick stop deceleration",
    0x6086: "Motion profile type",
    0x6087: "Torque slope",
    0x6088: "Torque profile type",
    0x6089: "Position notation index",
    0x608A: "Position dimension index",
    0x608B: "Velocity notation index",
    0x608C: "Velocity dimension index",
    0x608D: "Acceleration notation index",
    0x608E: "Acceleration dimension index",
    0x608F: "Position encoder resolution",
    0x6090: "Velocity encoder resolution",
    0x6091: "Gear ratio",
    0x6092: "Feed constant",
    0x6093: "Position factor",
    0x6094: "Velocity encoder factor",
    0x6096: "Velocity factor",
    0x6097: "Acceleration factor",
    0x6098: "Homing method",
    0x6099: "Homing speeds",
    0x609A: "Homing acceleration",
    0x60A2: "Jerk factor",
    0x60A4: "Profile jerk",
    0x60A8: "SI unit position",
    0x60A9: "SI unit velocity",
    0x60AA: "SI unit acceleration",
    0x60B0: "Position offset",
    0x60B1: "Velocity offset",
    0x60B2: "Torque offset",
    0x60B8: "Touch probe function",
    0x60B9: "Touch probe status",
    0x60BA: "Touch probe 1 positive edge",
    0x60BB: "Touch probe 1 negative edge",
    0x60BC: "Touch probe 2 positive edge",
    0x60BD: "Touch probe 2 negative edge",
    0x60C0: "Interpolation sub mode select",
    0x60C1: "Interpolation data record",
    0x60C2: "Interpolation time period",
    0x60C4: "Interpolation data configuration",
    0x60C5: "Max acceleration",
    0x60C6: "Max deceleration",
    0x60D0: "Touch probe source",
    0x60D5: "Touch probe 1 positive edge counter",
    0x60D6: "Touch probe 1 negative edge counter",
    0x60D7: "Touch probe 2 positive edge counter",
    0x60D8: "Touch probe 2 negative edge counter",
    0x60E0: "Positive torque limit value",
    0x60E1: "Negative torque limit value",
    0x60E3: "Supported homing methods",
    0x60E4: "Additional position actual value",
    0x60E5: "Additional velocity actual value",
    0x60E6: "Additional position encoder resolution - encoder increments",
    0x60E8: "Additional gear ratio - motor shaft revolutions",
    0x60E9: "Additional feed constant - feed",
    0x60EB: "Additional position encoder resolution - motor revolutions",
    0x60ED: "Additional gear ratio - driving shaft revolutions",
    0x60EE: "Additional feed constant - driving shaft revolutions",
    0x60F2: "Positioning option code",
    0x60F4: "Following error actual value",
    0x60F6: "Torque control parameters",
    0x60F8: "Max slippage",
    0x60F9: "Velocity control parameter set",
    0x60FA: "Control effort",
    0x60FB: "Position control parameter set",
    0x60FC: "Position demand internal value",
    0x60FD: "Digital inputs",
    0x60FE: "Digital outputs",
    0x60FF: "Target velocity",
    0x6402: "Motor type",
    0x6410: "Motor data",
    0x6502: "Supported drive modes",
    0x6503: "Drive catalogue number",
    0x6505: "HTTP drive catalogue address",
    0x67FE: "Version number",
    0x67FF: "Single device type",
}
"""Names of the objects by index; those of PDOs are in `_RECORDS`."""

_RECORDS: tuple[tuple[range, str], ...] = (
    (range(0x1400, 0x1600), "RPDO communication parameter"),
    (range(0x1600, 0x1800), "RPDO mapping parameter"),
    (range(0x1800, 0x1A00), "TPDO communication parameter"),
    (range(0x1A00, 0x1C00), "TPDO mapping parameter"),
)
_COMMUNICATION = {
    1: "COB-ID",
    2: "Transmission type",
    3: "Inhibit time",
    4: "Compatibility entry",
    5: "Event timer",
    6: "SYNC start value",
}
# Sub-indices of 1010h and 1011h.
_GROUPS = {1: "all", 2: "communication", 3: "application", 4: "manufacturer"}
_SUBINDICES: Mapping[int, Mapping[int, str]] = {
    0x1010: {number: f"Save {group} parameters" for number, group in _GROUPS.items()},
    0x1011: {number: f"Restore {group} default parameters" for number, group in _GROUPS.items()},
    0x1018: {1: "Vendor-ID", 2: "Product code", 3: "Revision number", 4: "Serial number"},
    0x1029: {1: "Communication error"},
    0x1200: {1: "COB-ID client to server (rx)", 2: "COB-ID server to client (tx)"},
    0x5FF1: {1: "Milliseconds after midnight", 2: "Days since 1984"},
    0x608F: {1: "Encoder increments", 2: "Motor revolutions"},
    0x6091: {1: "Motor shaft revolutions", 2: "Driving shaft revolutions"},
    0x6092: {1: "Feed", 2: "Shaft revolutions"},
    0x6099: {1: "Speed during search for switch", 2: "Speed during search for zero"},
    0x60C2: {1: "Interpolation time period value", 2: "Interpolation time index"},
}
_ARRAY_ELEMENTS = {0x1003: "Standard error field", 0x1016: "Consumer heartbeat time"}
HIGHEST = "Highest sub-index supported"
MAPPED_COUNT = "Number of mapped application objects in PDO"


def parameter_name(index: int) -> str:
    """Return the name of an object, such as "Object 2000h" for one without a name here."""
    for records, name in _RECORDS:
        if index in records:
            return f"{name} {index - records.start + 1}"
    return PARAMETERS.get(index, f"Object {index:04X}h")


def member_name(index: int, subindex: int) -> str:
    """Return the name of a sub-index of a record or an array."""
    # The parameters of the 512 PDOs of a direction fill a block of 200h objects.
    record = index & ~0x1FF
    if record in (0x1600, 0x1A00):
        return f"Application object {subindex}" if subindex else MAPPED_COUNT
    if not subindex:
        return HIGHEST
    names = _COMMUNICATION if record in (0x1400, 0x1800) else _SUBINDICES.get(index, {})
    element = _ARRAY_ELEMENTS.get(index, parameter_name(index))
    return names.get(subindex, f"{element} {subindex}")
