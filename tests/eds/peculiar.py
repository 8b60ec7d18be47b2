"""EDS and DCF files with what is peculiar in vendors' files, so that no test needs one of theirs.

Each peculiarity was seen in a vendor's file and is written here in words of our own: a change to the file of the
simulated generic drive. A sheet is a file with some of them. `tests/eds/vendor_files.py` has the vendors' own files.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_fieldbus.eds import Eds, eds_text, read_eds
from tests.eds.sheets import generic, without

OURS = (0x5FF0, 0x5FF1, 0x5FF2)
"""Manufacturer objects of the simulated drive, which no other drive has."""
Sections = dict[str, dict[str, str]]


@dataclass(frozen=True)
class Peculiarity:
    """One way in which a file differs: lines `SECTION KEY=VALUE`, and objects that it lacks."""

    lines: str = ""
    gone: tuple[int, ...] = ()
    fault: str = ""
    """Words of the fault that the reader notes; empty where the file is in order."""


PECULIARITIES = {
    # Form.
    "a comment after a value": Peculiarity("6502 DefaultValue=0x03ED ; modes", fault="a comment after a value"),
    "CompactPDO": Peculiarity("DeviceInfo CompactPDO=1", fault="missing PDO parameters are not added"),
    "a limit beyond its type": Peculiarity("6085 HighLimit=4294967296", fault="does not fit into UNSIGNED32"),
    "a negative number of an unsigned type": Peculiarity(
        "6065 DefaultValue=-1\n6065 LowLimit=-1", fault='"-1" does not fit into UNSIGNED32'
    ),
    "octets of Windows-1252": Peculiarity("Comments Line1=made with “Tool”", fault="octet 93h is no UTF-8"),
    "fewer sub-indices than SubNumber": Peculiarity("1018 SubNumber=0x9", fault="0x9, but the file has 5 sub-indices"),
    "an object in no list": Peculiarity(
        "2FFF ParameterName=Forgotten\n2FFF DataType=0x6\n2FFF AccessType=ro",
        fault="is in no list of objects",
    ),
    "access types in capitals": Peculiarity("6071 AccessType=RWW\n6064 AccessType=RO\n1000 AccessType=CONST"),
    "the node-ID in other capitals": Peculiarity(
        "1014 DefaultValue=$NodeID + 0x80\n1400sub1 DefaultValue=$NodeID+0x200"
    ),
    "flags in hexadecimal": Peculiarity("6071 PDOMapping=0x1\n6064 PDOMapping=0x1\n605A PDOMapping=0x0"),
    "empty values": Peculiarity("6071 DefaultValue=\n6077 DefaultValue=\n6077 LowLimit="),
    "no DummyUsage": Peculiarity("".join(f"DummyUsage Dummy{number:04d}=0\n" for number in range(1, 8))),
    "the node-ID of a DCF": Peculiarity("DeviceComissioning NodeID=0x05\nDeviceComissioning Baudrate=1000"),
    "reals in hexadecimal": Peculiarity(
        "2013 ParameterName=Gain\n2013 DataType=0x8\n2013 AccessType=rw\n2013 DefaultValue=0x437A0000"
    ),
    "wide types and strings": Peculiarity(
        "2014 ParameterName=Runtime\n2014 DataType=0x1B\n2014 AccessType=ro\n"
        "2015 ParameterName=Trace\n2015 DataType=0xA\n2015 AccessType=rw\n"
        "2016 ParameterName=Invert\n2016 DataType=0x1\n2016 AccessType=rw\n2016 DefaultValue=1\n2016 PDOMapping=0"
    ),
    # PDOs after power-on.
    "configured values beside the defaults": Peculiarity(
        "1400sub2 ParameterValue=1\n1600sub0 ParameterValue=2\n1600sub1 ParameterValue=0x60400010\n"
        "1600sub2 ParameterValue=0x60600008\n1A00sub0 ParameterValue=2\n1A00sub2 ParameterValue=0x60640020"
    ),
    "PDOs without an identifier": Peculiarity(
        "1401sub1 DefaultValue=\n1801sub1 DefaultValue=\n1801sub2 DefaultValue=\n1A01sub0 DefaultValue="
    ),
    "PDOs that are switched off": Peculiarity(
        "".join(f"{0x1400 + n:04X}sub1 DefaultValue=$NODEID+0x80000{n + 2}00\n" for n in range(4))
    ),
    "an inhibit time": Peculiarity("".join(f"{0x1800 + n:04X}sub3 DefaultValue=1000\n" for n in range(4))),
    "transmission types 0 and 253": Peculiarity("1800sub2 DefaultValue=0\n1801sub2 DefaultValue=253"),
    "fixed mappings": Peculiarity(
        "".join(
            f"{first + n:04X}sub{sub} AccessType={access}\n"
            for first, sub, access in ((0x1400, 1, "ro"), (0x1800, 1, "ro"), (0x1600, 0, "const"), (0x1A00, 0, "ro"))
            for n in range(3)
        )
        + "1601sub0 DefaultValue=1\n1601sub1 DefaultValue=0x60400010",
        gone=(0x1403, 0x1603, 0x1803, 0x1A03),
    ),
    "gaps between PDOs": Peculiarity(gone=(0x1401, 0x1601, 0x1403, 0x1603, 0x1801, 0x1A01, 0x1803, 0x1A03)),
    # What the drive can do.
    "no guard by the heartbeat": Peculiarity(gone=(0x1016,)),
    "no option codes": Peculiarity(gone=(0x6007, 0x605E)),
    "no abort connection option": Peculiarity("605E DefaultValue=2", gone=(0x6007,)),
    "a fault reaction that is read-only": Peculiarity("605E AccessType=ro\n605E DefaultValue=2"),
    "no SYNC objects": Peculiarity(gone=(0x1005, 0x1006, 0x1007, 0x1019)),
    "no interpolation time": Peculiarity(gone=(0x60C2,)),
    "an interpolation time that is read-only": Peculiarity("60C2sub1 AccessType=ro\n60C2sub2 AccessType=ro"),
    "no rated values": Peculiarity(gone=(0x6075, 0x6076)),
    "no torque demand": Peculiarity(gone=(0x6074,)),
    "no torque": Peculiarity(gone=(0x6071, 0x6072, 0x6074, 0x6076, 0x6077, 0x6087)),
    "no supported modes": Peculiarity(gone=(0x6502,)),
    "supported modes without a value": Peculiarity("6502 DefaultValue="),
    "profile torque alone, as INTEGER32": Peculiarity("6502 DataType=0x0004\n6502 DefaultValue=0x6D"),
    "modes of the manufacturer": Peculiarity("6502 DefaultValue=0x303EF"),
    "a torque limit of zero": Peculiarity("6072 DefaultValue=0"),
    "a torque limit below zero": Peculiarity(
        "60E1 DataType=0x3\n60E1 DefaultValue=-1000\n60E1 LowLimit=\n60E1 HighLimit="
    ),
    "units of position and velocity": Peculiarity(
        "60A8 ParameterName=Position unit\n60A8 DataType=0x7\n60A8 AccessType=rw\n60A8 DefaultValue=0x00B50000\n"
        "60A9 ParameterName=Velocity unit\n60A9 DataType=0x7\n60A9 AccessType=rw\n60A9 DefaultValue=0x00B50300"
    ),
    "no drive of CiA 402": Peculiarity(gone=tuple(range(0x6007, 0x6502))),
}
"""By their names."""


@dataclass(frozen=True)
class Sheet:
    """A file of one kind of drive."""

    peculiarities: tuple[str, ...]
    mode: int = 0
    """Torque mode of operation, 0 where the drive is not usable for force."""
    lack: str = ""
    """Objects that it lacks for force."""
    end: str = "\n"
    encoding: str = "utf-8"

    @property
    def faults(self) -> list[str]:
        """Words of all faults that the reader notes."""
        return [fault for name in self.peculiarities if (fault := PECULIARITIES[name].fault)]


NO_TARGET = "there is no 6071h target torque"
SHEETS = {
    "cyclic_torque.dcf": Sheet(
        ("a comment after a value", "CompactPDO", "the node-ID of a DCF", "configured values beside the defaults",
         "PDOs without an identifier", "no SYNC objects", "wide types and strings"),
        mode=10,
    ),
    "profile_torque.eds": Sheet(
        ("profile torque alone, as INTEGER32", "a negative number of an unsigned type", "PDOs that are switched off",
         "the node-ID in other capitals", "no abort connection option", "no interpolation time", "no rated values",
         "empty values", "no DummyUsage"),
        mode=4, end="\r\n",
    ),
    "no_option_codes.eds": Sheet(
        ("no option codes", "no guard by the heartbeat", "modes of the manufacturer", "units of position and velocity",
         "an inhibit time", "a torque limit below zero", "PDOs that are switched off", "flags in hexadecimal"),
        mode=10, end="\r\n",
    ),
    "capitals.eds": Sheet(
        ("access types in capitals", "a limit beyond its type", "no torque demand",
         "an interpolation time that is read-only", "transmission types 0 and 253", "a torque limit of zero",
         "supported modes without a value"),
        mode=10,
    ),
    "fixed_mappings.eds": Sheet(
        ("octets of Windows-1252", "fixed mappings", "no torque", "no supported modes", "no guard by the heartbeat",
         "no option codes"),
        lack=NO_TARGET, end="\r\n", encoding="cp1252",
    ),
    "positions.eds": Sheet(
        ("no torque", "gaps between PDOs", "a fault reaction that is read-only", "reals in hexadecimal",
         "an object in no list", "fewer sub-indices than SubNumber"),
        lack=NO_TARGET,
    ),
    "no_drive.eds": Sheet(("no drive of CiA 402",), lack="there is no 6040h controlword"),
}  # fmt: skip
"""By the names of their files."""
FORCE = [name for name, sheet in SHEETS.items() if sheet.mode]
"""Files with all that force needs."""
DRIVES = [name for name in SHEETS if name != "no_drive.eds"]
"""Files with the objects of CiA 402."""


def octets(name: str) -> bytes:
    """Return the content of a file."""
    sheet = SHEETS[name]
    found = [PECULIARITIES[each] for each in sheet.peculiarities]
    gone = {index for each in found for index in each.gone}
    sections = _sections(eds_text(without(generic(), *OURS, *gone)))
    for each in found:
        for line in each.lines.splitlines():
            _change(sections, line)
    lines = [text for name, items in sections.items() for text in (f"[{name}]", *map("=".join, items.items()), "")]
    return sheet.end.join(lines).encode(sheet.encoding)


FOLDER = TemporaryDirectory(prefix="haptic-fieldbus-eds-")
"""Kept until the tests end, also by a run that empties all caches between tests."""


@cache
def sheet_eds(name: str) -> Eds:
    """Return a file as the reader takes it."""
    return read_eds(octets(name), name)


@cache
def sheet_path(name: str) -> Path:
    """Write a file, and return where it stands until the tests end."""
    path = Path(FOLDER.name) / name
    path.write_bytes(octets(name))
    return path


def _sections(text: str) -> Sections:
    found: Sections = {}
    for line in text.splitlines():
        if line.startswith("["):
            items = found[line[1:-1]] = {}
        elif line:
            key, _, value = line.partition("=")
            items[key] = value
    return found


def _change(sections: Sections, line: str) -> None:
    """Set a key; a section that is new is a variable, which a list names unless it is 2FFF."""
    place, _, value = line.partition("=")
    name, key = place.split()
    if name not in sections:
        sections[name] = {"ObjectType": "0x7"} if len(name) == 4 else {}
        listed = sections["ManufacturerObjects" if name < "6000" else "OptionalObjects"]
        if len(name) == 4 and name != "2FFF":
            listed["SupportedObjects"] = str(len(listed))
            listed[str(len(listed))] = f"0x{name}"
    sections[name][key] = value
