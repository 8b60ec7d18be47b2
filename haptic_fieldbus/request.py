"""What a caller may ask for, checked before anything is opened: all faults at once, in one `UsageError`.

The Python API and the command line both pass through here, so both are equally safe and say the same sentences.
"""

import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import entry_points
from pathlib import Path

from haptic_fieldbus.documents import suggestion
from haptic_fieldbus.errors import UsageError

DEFAULT_BITRATE = 1_000_000
"""[bit/s]; taken where the bit rate cannot be known."""
BITRATES = (10_000, 1_000_000)
"""[bit/s]; the least and the greatest of CiA 301, table 1."""
NODES = (1, 127)
MAXIMUM_RATE = 100_000.0
"""[Hz]; far above what any bus here carries, so that a period is never shorter than the clock resolves."""

BUS_FORMS = "sim[@BITRATE] or INTERFACE:CHANNEL[@BITRATE], for example sim, socketcan:can0, pcan:PCAN_USBBUS1@1000000"

SIMULATION_INTERFACE = "haptic_sim"

# python-can's own interfaces; importing `can` only to name them would cost every command 0.1 s. A test compares.
CAN_INTERFACES = (
    "canalystii", "cantact", "etas", "gs_usb", "iscan", "ixxat", "kvaser", "neousys", "neovi", "nican", "nixnet",
    "pcan", "robotell", "seeedstudio", "serial", "slcan", "socketcan", "socketcand", "systec", "udp_multicast",
    "usb2can", "vector", "virtual",
)  # fmt: skip
SIMULATED = ("sim", "sim-modbus-tcp", "sim-modbus-rtu")
MODBUS = ("modbus-tcp", "modbus-rtu")
LINUX_CHANNEL = re.compile(r"(v|sl)?can\d+(@.*)?")

PLOT_SUFFIXES = (".png", ".svg", ".pdf")
RECORD_SUFFIXES = (".log", ".blf", ".csv")


class BusKind(Enum):
    """What stands behind a bus name."""

    SIMULATED = "simulated"
    CAN = "can"


@dataclass(frozen=True)
class BusName:
    """A bus as written by the user, taken apart; the bit rate is in bit/s."""

    text: str
    kind: BusKind
    interface: str
    channel: str
    bitrate: int = DEFAULT_BITRATE
    bitrate_known: bool = True
    """False: it was not given, and a CAN interface cannot be asked; 1 Mbit/s is assumed."""

    @property
    def simulated(self) -> bool:
        return self.kind is BusKind.SIMULATED


def parse_bus(text: str) -> BusName:
    """Take a bus name apart; raises UsageError with the nearest names and the known forms."""
    interface, colon, channel = text.partition(":")
    if not colon:
        return _parse_bare(text)
    if interface in MODBUS:
        raise _not_yet(text)
    if interface in SIMULATED:
        raise UsageError(f'bus "{text}": the simulated bus has no channel, it is written sim[@BITRATE]')
    if interface == SIMULATION_INTERFACE:
        return _parse_simulation(text, channel)
    return _parse_can(text, interface, channel)


def _parse_bare(text: str) -> BusName:
    name, at, bitrate = text.partition("@")
    if name == "sim":
        speed = _bitrate(text, bitrate) if at else DEFAULT_BITRATE
        return BusName(text, BusKind.SIMULATED, SIMULATION_INTERFACE, "sim", speed)
    if name in SIMULATED or name in MODBUS:
        raise _not_yet(text)
    if name in can_interfaces():
        raise UsageError(f'bus "{text}" lacks its channel: {name}:CHANNEL[@BITRATE]')
    if LINUX_CHANNEL.fullmatch(name):
        raise UsageError(f'bus "{text}" lacks its interface; nearest: socketcan:{text}. Buses are {BUS_FORMS}')
    raise UsageError(f'no bus "{text}"{suggestion(name, (SIMULATED[0], *can_interfaces()))}. Buses are {BUS_FORMS}')


def _parse_simulation(text: str, rest: str) -> BusName:
    """The interface as a rig names it; its channel may itself hold @, for drives and their nodes."""
    channel, _, digits = rest.rpartition("@")
    if channel and digits.isdecimal() and int(digits) >= BITRATES[0]:
        return BusName(text, BusKind.SIMULATED, SIMULATION_INTERFACE, channel, _bitrate(text, digits))
    return BusName(text, BusKind.SIMULATED, SIMULATION_INTERFACE, rest)


def _parse_can(text: str, interface: str, rest: str) -> BusName:
    if interface not in can_interfaces():
        near = suggestion(interface, can_interfaces())
        raise UsageError(f'no bus interface "{interface}" in "{text}"{near}. Buses are {BUS_FORMS}')
    channel, at, digits = rest.rpartition("@") if "@" in rest else (rest, "", "")
    if not channel:
        raise UsageError(f'bus "{text}" lacks its channel: {interface}:CHANNEL[@BITRATE]')
    speed = _bitrate(text, digits) if at else DEFAULT_BITRATE
    return BusName(text, BusKind.CAN, interface, channel, speed, bitrate_known=bool(at))


def can_interfaces() -> tuple[str, ...]:
    """The names of python-can's interfaces, those that other packages add included."""
    added = {entry.name for entry in entry_points(group="can.interface")} - {SIMULATION_INTERFACE}
    return tuple(sorted(added | set(CAN_INTERFACES)))


def _bitrate(text: str, digits: str) -> int:
    if not digits.isdecimal():
        raise UsageError(f'bus "{text}": after @ stands the bit rate in bit/s, for example @500000')
    if not BITRATES[0] <= int(digits) <= BITRATES[1]:
        raise UsageError(f'bus "{text}": {digits} bit/s is outside of what CAN can do, {BITRATES[0]} to {BITRATES[1]}')
    return int(digits)


def _not_yet(text: str) -> UsageError:
    return UsageError(f'bus "{text}": Modbus is not available yet in this version; buses are {BUS_FORMS}')


def parse_settings(texts: Iterable[str]) -> dict[str, str]:
    """`element.parameter=value` texts as a mapping; raises one UsageError that lists all malformed ones."""
    settings: dict[str, str] = {}
    faults = []
    for text in texts:
        key, equals, value = (part.strip() for part in text.partition("="))
        element, _, parameter = key.partition(".")
        if not (equals and element and parameter and value):
            faults.append(f'--set "{text}": expected element.parameter=value, for example wall.stiffness=400')
        elif key in settings:
            faults.append(f"--set {key}: given twice, as {settings[key]} and {value}")
        settings[key] = value
    _raise(faults)
    return settings


def parse_changes(texts: Iterable[str]) -> list[tuple[float, dict[str, str]]]:
    """`SECONDS:element.parameter=value` texts in the order of their times, those of one time together.

    Raises one UsageError that lists all malformed ones.
    """
    changes: dict[float, dict[str, str]] = {}
    faults = []
    for text in texts:
        when, _, setting = text.partition(":")
        try:
            time = float(when)
            ((key, value),) = parse_settings([setting]).items()
        except ValueError:
            faults.append(
                f'--change "{text}": expected SECONDS:element.parameter=value, for example 2.5:wall.stiffness=400'
            )
            continue
        same = changes.setdefault(time, {})
        if key in same:
            faults.append(f"--change {time:g}:{key}: given twice, as {same[key]} and {value}")
        same[key] = value
    _raise(faults)
    return sorted(changes.items())


@dataclass(frozen=True)
class Choice:
    """A name out of a table: what it is called, what was given, what there is."""

    what: str
    given: str | None
    names: Collection[str]

    def faults(self) -> list[str]:
        if self.given is None or self.given in self.names:
            return []
        return [f'no {self.what} "{self.given}"{suggestion(self.given, self.names)}']


def check_request(
    *,
    bus: str = "sim",
    node: int = 1,
    rate: float = 1000.0,
    duration: float = 10.0,
    seed: int = 0,
    choices: Sequence[Choice] = (),
    record: Path | None = None,
    plot: Path | None = None,
) -> BusName:
    """Check all that was asked for (rate in Hz, duration in s); raises one UsageError that lists every fault."""
    faults = _number_faults(node, rate, duration, seed)
    faults += [fault for choice in choices for fault in choice.faults()]
    faults += file_faults("record", record, RECORD_SUFFIXES)
    faults += file_faults("plot", plot, PLOT_SUFFIXES)
    try:
        name = parse_bus(bus)
    except UsageError as error:
        raise UsageError("\n".join([str(error), *faults])) from None
    _raise(faults)
    return name


def _number_faults(node: int, rate: float, duration: float, seed: int) -> list[str]:
    good_rate = 0.0 < rate <= MAXIMUM_RATE
    good_duration = math.isfinite(duration) and duration > 0.0
    checks = [
        (NODES[0] <= node <= NODES[1], f"node {node}: a node-ID is a whole number from {NODES[0]} to {NODES[1]}"),
        (good_rate, f"rate {rate:g}: expected a rate above 0 and up to {MAXIMUM_RATE:g} Hz"),
        (good_duration, f"duration {duration:g}: expected a time above 0 s"),
        (
            not (good_rate and good_duration) or rate * duration >= 1.0,
            f"duration {duration:g} s: less than one period at {rate:g} Hz",
        ),
        (seed >= 0, f"seed {seed}: expected a whole number from 0"),
    ]
    return [sentence for good, sentence in checks if not good]


def file_faults(option: str, path: Path | None, suffixes: Sequence[str]) -> list[str]:
    """Why a file could not be written, known before the run rather than after it."""
    if path is None:
        return []
    if path.suffix not in suffixes:
        return [f'{option} "{path}": the suffix must be one of {", ".join(suffixes)}']
    if not path.parent.is_dir():
        return [f'{option} "{path}": there is no folder {path.parent}']
    existed = path.exists()
    try:
        path.open("ab").close()
    except OSError as error:
        return [f'{option} "{path}": cannot be written: {error.strerror}']
    if not existed:
        path.unlink()
    return []


def _raise(faults: list[str]) -> None:
    if faults:
        raise UsageError("\n".join(faults))
