"""A drive profile: how one drive model offers torque and position, or velocity alone, on a fieldbus.

A profile is a TOML file in `profiles/`, read by `protocols.catalogue.load_profile`. This module has the tables that all
protocols share. Each protocol (`protocols`) adds tables of its own, which tell the object or register of each signal.
Units are SI, unless a name or the `unit` of an entry says otherwise.
"""

import hashlib
import json
import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cached_property, reduce
from operator import or_
from typing import Annotated, Literal

from annotated_types import Len

from haptic_fieldbus.drive.fields import Frequency, NonNegativeTime, Table, Time, UInt32
from haptic_fieldbus.signals import Signal

# Entries of a CANopen object dictionary: data types, names, encoding, notation.
#
# References: CiA 301 4.2 (data types), CiA 402-2 (object names).


_STRUCT_CODES = {"int8": "b", "int16": "h", "int32": "i", "uint8": "B", "uint16": "H", "uint32": "I"}


class DataType(Enum):
    """Basic data types; the value is the name in profile files."""

    INT8 = "int8"
    INT16 = "int16"
    INT32 = "int32"
    UINT8 = "uint8"
    UINT16 = "uint16"
    UINT32 = "uint32"

    def __init__(self, name: str) -> None:
        self.code = _STRUCT_CODES[name]
        """Character of the type in a `struct` format."""
        self._struct = struct.Struct("<" + self.code)
        self.size = self._struct.size
        """Size on the wire [octets]."""
        bits = 8 * self.size
        # In a `struct` format signed integers have small letters.
        self.limits = (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)
        """Smallest and largest value."""

    def pack(self, value: int) -> bytes:
        """Return the little-endian octets of a value; raises struct.error when it is out of range."""
        return self._struct.pack(value)

    def unpack(self, data: bytes) -> int:
        """Return the value of little-endian octets; raises struct.error when their number is wrong."""
        value: int = self._struct.unpack(data)[0]
        return value


class Order(Enum):
    """Order of the octets of a value on the wire; the value is the name in profile files."""

    LITTLE = "little"
    BIG = "big"
    BIG_LOW_WORD_FIRST = "big, low word first"


NAMES = {
    0x1000: "device type",
    0x1001: "error register",
    0x1005: "COB-ID SYNC message",
    0x100C: "guard time",
    0x100D: "life time factor",
    0x1016: "consumer heartbeat time",
    0x1017: "producer heartbeat time",
    0x1018: "identity object",
    0x1029: "error behaviour",
    0x6007: "abort connection option code",
    0x603F: "error code",
    0x6040: "controlword",
    0x6041: "statusword",
    0x605A: "quick stop option code",
    0x605E: "fault reaction option code",
    0x6060: "modes of operation",
    0x6061: "modes of operation display",
    0x6064: "position actual value",
    0x606C: "velocity actual value",
    0x6071: "target torque",
    0x6072: "max torque",
    0x6074: "torque demand",
    0x6076: "motor rated torque",
    0x6077: "torque actual value",
    0x60B2: "torque offset",
    0x60C2: "interpolation time period",
    0x60E0: "positive torque limit value",
    0x60E1: "negative torque limit value",
    0x6502: "supported drive modes",
}
"""Names of the objects that the package uses, by index."""

PDO_NAMES = {
    0x1400: "RPDO communication parameter",
    0x1600: "RPDO mapping parameter",
    0x1800: "TPDO communication parameter",
    0x1A00: "TPDO mapping parameter",
}
"""Names of the PDO objects, by the first index of each range of 512."""


@dataclass(frozen=True)
class ObjectEntry:
    """One entry of the object dictionary, with the unit of its value; empty when there is none."""

    object: int
    type: DataType
    subindex: int = 0
    unit: str = ""

    @property
    def name(self) -> str:
        """Name of the object in the standard, `object` when it is not listed here."""
        # The lower 9 bits number the 512 PDOs of a range.
        return NAMES.get(self.object) or PDO_NAMES.get(self.object & ~0x1FF, "object")

    @property
    def mapping(self) -> int:
        """Value of a PDO mapping entry: index, sub-index, length in bits (CiA 301, 7.5.2.36)."""
        return self.object << 16 | self.subindex << 8 | 8 * self.type.size

    @property
    def place(self) -> str:
        """Index and sub-index, as manuals write them."""
        return f"{self.object:04X}h:{self.subindex:02X}"

    def __str__(self) -> str:
        return f"{self.place} {self.name}"


# The identity of a drive, and digests: what decides whether a proof or a note belongs to the drive that is there.
#
# A proof of a guard and a note about a torque limit are read again on another day, when another drive may be at the
# same node. Only a serial number tells two drives of one model apart. A drive that was never given one tells 0, or all
# ones as memory that was never programmed does; both are no number here. Of a drive without a serial number nothing is
# kept that could permit more.

_DIGITS = 16
"""Hexadecimal digits of a digest: enough to find a change, not to keep out a forger, who could change the program."""


@dataclass(frozen=True)
class Identity:
    """Numbers that a drive tells of itself (1018h, or registers); None: it tells none."""

    vendor: int | None = None
    product: int | None = None
    revision: int | None = None
    """Of the hardware or the firmware; after an update it is another one."""
    serial: int | None = None

    def file_name(self, place: str) -> str | None:
        """Return a name that no other drive has; None without a serial number.

        The revision is no part of it, because a drive stays the same after an update. Where vendor or product is not
        known, another one may give the same serial number, so that the place of the drive is a part of the name.
        """
        if self.serial is None:
            return None
        name = "-".join(f"{each or 0:08x}" for each in (self.vendor, self.product, self.serial))
        return name if self.vendor and self.product else f"{name}-{digest_of((place,))}"

    def difference(self, other: "Identity") -> str:
        """Return the name of the first number in which two drives differ, the serial number first; empty when none."""
        names = [each.name for each in fields(self)][::-1]
        return next((name for name in names if getattr(self, name) != getattr(other, name)), "")


def known_number(number: int | None, type: DataType = DataType.UINT32) -> int | None:
    """Return a number that a drive tells of itself; None for 0 and for all ones, which say that it was never given."""
    ones = (1 << 8 * type.size) - 1
    return None if number is None or number & ones in (0, ones) else number


def digest_of(texts: Iterable[str]) -> str:
    """Return a digest of texts in this order."""
    return hashlib.sha256(json.dumps(list(texts)).encode()).hexdigest()[:_DIGITS]


ASSUMED = "ASSUMED"
"""Word in the source of a value for which none was found."""
STANDARD = "standard"
"""Evidence of a profile of no particular drive; a run asks the drive which of its objects there are."""


@dataclass(frozen=True)
class MappedSignal:
    """A signal as a drive carries it: address, type, unit and order of octets."""

    signal: Signal
    address: str
    """Address in the notation of the protocol: `6064h:00 position actual value`, `register 0x0102`."""
    type: DataType
    unit: str = ""
    order: Order = Order.LITTLE


@dataclass(frozen=True)
class DriveSection(Table):
    """Drive model, its protocol, and the evidence for the profile."""

    vendor: Annotated[str, Len(1)]
    model: Annotated[str, Len(1)]
    protocol: Annotated[str, Len(1)]
    evidence: Literal["hardware", "vendor-data", "third-party-code", "standard"]
    """Best evidence for the values; "standard": CiA 301 and CiA 402 alone, without any particular device."""
    usable: bool = True
    """False: the profile only documents why the drive cannot render force."""
    commutation_search: bool = False
    """True: the first enabling after power-on may turn the shaft, because the drive looks for its commutation."""


@dataclass(frozen=True)
class TimingSection(Table):
    """Times of a drive: torque loop, controller, change of mode."""

    torque_bandwidth: Frequency
    """Bandwidth of the torque loop, which is taken as first order [Hz]."""
    control_period: NonNegativeTime
    """Period of the drive's controller [s].

    A new target acts at the next multiple of it, counted from the latch of the feedback; with 0 it acts at once.
    """
    mode_change_timeout: Time = 1.0
    """Longest time that the drive may take to change its mode of operation [s]."""
    control_tick: Literal["sync", "free", "unknown"] = "unknown"
    """Whether the controller's ticks are counted from SYNC or run free; unknown: counted as "sync" in the plan, and as
    "free" in its limit."""
    encoder_latency: NonNegativeTime | None = None
    """Age of a position at the SYNC that latches it [s]; None: 0 in the plan, up to a control period in its
    limit."""
    enabling_timeout: Time = 2.0
    """Longest time that the drive may take to *operation enabled* [s]; a commutation search takes part of it."""


@dataclass(frozen=True, kw_only=True)
class DriveProfile(Table, ABC):
    """Profile of one drive model; `name` is the name of the file without suffix, `source` its path."""

    schema: Literal[1]
    drive: DriveSection
    timing: TimingSection
    sources: dict[str, Annotated[str, Len(1)]] = field(default_factory=dict)
    """Origin of each value, by key; the source of a table covers all values in it."""
    name: str = ""
    source: str = ""

    @property
    def title(self) -> str:
        """Vendor and model, as messages name the drive."""
        return f"{self.drive.vendor} {self.drive.model}"

    @property
    def ramp(self) -> float:
        """Time in which the torque goes from zero to rated by a slope of the drive's own [s]; 0: at once."""
        return 0.0

    @property
    def echo(self) -> Signal | None:
        """Signal in which the drive returns a target torque, which proves that set-points act; None: it has none."""
        return None

    @property
    def full_scale(self) -> float | None:
        """Torque at 32767 of a target that is told as a share of it [N·m]; None: it is told otherwise."""
        return None

    @property
    def rating_told(self) -> bool:
        """True when the drive tells the rated value that scales its torque, so that it is compared with the rig."""
        return False

    @property
    def torque_lag(self) -> float:
        """Time constant of the torque behind its target [s]: torque loop, and the slope of the drive's own."""
        return 1.0 / (2 * math.pi * self.timing.torque_bandwidth) + self.ramp

    @property
    def assumed(self) -> tuple[str, ...]:
        """Keys whose values rest on no source but an assumption, in the order of the file."""
        return tuple(key for key, source in self.sources.items() if ASSUMED in source)

    @property
    def guarded(self) -> bool:
        """True when the drive can take the torque away by itself as soon as nothing comes from its master any more."""
        return True

    @property
    def brakes(self) -> bool:
        """True when the drive can be told to brake, and not to free its shaft, when its master is gone."""
        return False

    @abstractmethod
    def offers(self) -> Mapping[Signal, MappedSignal]:
        """Return the signals that the drive offers, each as it is carried."""


# Power states of a drive as the master reads and commands them: a table with one row for each state.
#
# The automaton is in the drive. The master derives the state from the statusword, and answers with the controlword that
# requests the next transition on the way to *operation enabled*. It never resets a fault, and it never goes from *quick
# stop active* back to *operation enabled*: both are decisions of a person. The table of the standard is in
# `protocols.cia402`. A drive with a mode register or an opcode has a table of its own; its status and command are
# called statusword and controlword all the same.


class PowerState(Enum):
    """Power states, by their names in the standard."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


ENERGISED = (
    PowerState.SWITCHED_ON,
    PowerState.OPERATION_ENABLED,
    PowerState.QUICK_STOP_ACTIVE,
    PowerState.FAULT_REACTION_ACTIVE,
    PowerState.UNKNOWN,
)
"""States in which the power stage may feed the motor, for all that is known of them."""


@dataclass(frozen=True)
class PowerRow(Table):
    """A state, the statusword `bits` under `mask` that stand for it, and the controlword to be sent in it."""

    mask: UInt32
    bits: UInt32
    state: PowerState
    controlword: UInt32
    transition: int | None = None
    """Number in the standard of the transition that the controlword requests; None when it requests none."""


@dataclass(frozen=True)
class PowerTable(Table):
    """All power states of a drive; a statusword that fits no row is *unknown*, and is answered with `off`."""

    rows: Annotated[tuple[PowerRow, ...], Len(1)]
    off: UInt32 = 0
    """Controlword that disables the voltage in every state."""

    @cached_property
    def mask(self) -> int:
        """Bits of a statusword that any row depends on."""
        return reduce(or_, (row.mask for row in self.rows))

    @cached_property
    def enabling(self) -> frozenset[int]:
        """Controlwords that command *operation enabled*."""
        states = PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED
        return frozenset(map(self.answer, states)) - {self.off}

    def state(self, statusword: int) -> PowerState:
        """Return the state of a statusword, by the first row that fits; UNKNOWN when none does."""
        return next((row.state for row in self.rows if statusword & row.mask == row.bits), PowerState.UNKNOWN)

    def answer(self, state: PowerState) -> int:
        """Return the controlword for a state, on the way to *operation enabled*; `off` when no row has the state."""
        return next((row.controlword for row in self.rows if row.state is state), self.off)
