"""A drive profile on Modbus: the registers of a drive, and the facts of its line.

The dataclasses are the schema of a profile file with `protocol = "modbus"`. An address is the one on the wire, which
counts from 0; manuals often print a number that is one higher.

Reference: Modbus application protocol 1.1b3 (function codes); Modbus over serial line 1.02 (silence, character).
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le, Len

from haptic_fieldbus.documents import Document, KeyPath
from haptic_fieldbus.drive import rig
from haptic_fieldbus.drive.cia402 import Index
from haptic_fieldbus.drive.fields import NonNegativeTime, Table, Torque, UInt32
from haptic_fieldbus.drive.profile import NAMES, DataType, DriveProfile, MappedSignal, Order, PowerRow
from haptic_fieldbus.drive.rig import FULL_SCALE, METRES, is_current
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols import protocol
from haptic_fieldbus.signals import Signal

Address = Annotated[int, Ge(0), Le(0xFFFF)]
FunctionCode = Annotated[int, Ge(1), Le(127)]
WordOrder = Literal["high first", "low first"]
"""Which register of a value of 32 bits has the lower address: that with its high 16 bits, or that with its low ones."""
Transport = Literal["rtu", "tcp"]
Parity = Literal["none", "even", "odd"]

READ_HOLDING, READ_INPUT, WRITE_SINGLE, WRITE_MULTIPLE, READ_WRITE = 3, 4, 6, 16, 23
"""Function codes."""
ECHOES = {"demand": Signal.TORQUE_DEMAND, "actual": Signal.TORQUE_ACTUAL}
"""Way of `torque.echo` → signal that comes back."""


@dataclass(frozen=True)
class Register(Table):
    """One register, or two for a value of 32 bits."""

    address: Address
    type: DataType
    """Of 16 or 32 bits."""
    unit: str = ""
    object: Index | None = None
    """CiA 402 object with the same value as the register."""

    @property
    def count(self) -> int:
        """Number of registers."""
        return self.type.size // 2

    def __str__(self) -> str:
        return f"register {self.address:04X}h {NAMES.get(self.object or 0, '')}".rstrip()


@dataclass(frozen=True)
class WrittenRegister(Register):
    """Register that is written before the drive is enabled, and read back."""

    value: Annotated[int, Ge(-0x8000_0000), Le(0xFFFF_FFFF)] = field(kw_only=True)


@dataclass(frozen=True, kw_only=True)
class LineSection(Table):
    """Line of the drive: its function codes and its timing."""

    transports: Annotated[tuple[Transport, ...], Len(1)]
    """Kinds of line that the drive supports."""
    functions: Annotated[tuple[FunctionCode, ...], Len(1)]
    """Function codes that the drive understands."""
    word_order: WordOrder = "high first"
    """Register with the lower address in a value of 32 bits."""
    longest_read: Annotated[int, Ge(1), Le(125)] = 125
    """Largest number of registers in a read request."""
    longest_write: Annotated[int, Ge(1), Le(123)] = 123
    """Largest number of registers in a write request."""
    readable: tuple[tuple[Address, Address], ...] = ()
    """Ranges [first, last] in which every address can be read; a read request may cover unused addresses there."""
    answer_time: NonNegativeTime = 0.001
    """Time from the end of a request to the start of its answer [s]; the drive writes and reads the registers at its
    end. On RTU it starts after the silence that ends a request."""
    baud: Annotated[int, Ge(1200), Le(20_000_000)] = 19200
    """Bit rate after power-on [bit/s]."""
    parity: Parity = "even"
    """After power-on."""
    stop_bits: Literal[1, 2] = 1
    """After power-on."""
    silence: NonNegativeTime | None = None
    """Silence that the drive needs between two frames [s]. None: 3.5 characters, and 1.75 ms above 19200 bit/s."""

    @property
    def reading(self) -> int | None:
        """Function that reads registers; None when the drive has none."""
        return next((each for each in (READ_HOLDING, READ_INPUT) if each in self.functions), None)

    def writing(self, count: int) -> int | None:
        """Return the function that writes so many registers with the fewest octets; None when the drive has none."""
        either = (WRITE_SINGLE, WRITE_MULTIPLE) if count == 1 else (WRITE_MULTIPLE,)
        return next((each for each in either if each in self.functions), None)

    def has_all(self, first: int, end: int) -> bool:
        """Return True when every register from `first` to the one before `end` can be read."""
        return any(low <= first and end - 1 <= high for low, high in self.readable)


@dataclass(frozen=True)
class ModbusTorque(Table):
    """Torque registers, and the register that shows whether set-points act."""

    target: Register
    """Target torque, the set-point."""
    actual: Register | None = None
    """Measured torque."""
    demand: Register | None = None
    """Target torque in effect in the drive, in the unit of `target`."""
    rated: Register | None = None
    """Rated torque, read at configuration and compared with the rig."""
    limit: Register | None = None
    """Torque limit in the drive; a run writes its limit and restores the old value."""
    full_scale: Torque | None = None
    """Torque at 32767 [N·m], for the unit full_scale/32767."""
    echo: Literal["demand", "actual", "none"] = "none"
    """Register that returns the set-point; the loop uses it to check that its set-points act."""


@dataclass(frozen=True)
class ModbusMotion(Table):
    """Register of a measured motion."""

    actual: Register


@dataclass(frozen=True)
class ModeSection(Table):
    """Register that selects the torque mode; it is written before the drive is enabled."""

    write: Register
    value: Annotated[int, Ge(-0x8000), Le(0xFFFF)]
    display: Register | None = None
    """Register in which the drive confirms the mode."""


@dataclass(frozen=True)
class WatchdogSection(Table):
    """Drive watchdog: the register of its time, and its reaction when requests stop."""

    time: Register
    """`unit` is ms or s."""
    deadline: Annotated[float, Gt(0), Ge(0.001), Le(65.535)] = 0.05
    """Longest time without a request that writes the target torque [s]."""
    reaction: Annotated[str, Len(1)] = "the shaft is free"
    writes: tuple[WrittenRegister, ...] = ()
    """Registers that choose the reaction."""
    fault: UInt32 | None = None
    """Code in `power.error` for a lost master. None: the drive has no such code."""


@dataclass(frozen=True)
class PowerSection(Table):
    """Registers that command the power stage, and the meaning of their values."""

    status: Register
    """Register of the power state, the statusword."""
    command: Register
    """Register of the power command, the controlword; may be the same register as the status."""
    table: Literal["cia402", "rows"] = "cia402"
    """"cia402": statusword and controlword of CiA 402; "rows": the table in `rows`."""
    rows: tuple[PowerRow, ...] = ()
    """Rows of the power table: a state and its command."""
    off: UInt32 = 0
    """Command that frees the shaft in every state; only with `rows`."""
    reset: UInt32 | None = None
    """Command that clears a fault; only with `rows`. It is sent only after a watchdog proof."""
    error: Register | None = None
    """Code of the fault."""


@dataclass(frozen=True)
class IdentityRegister(Register):
    """Register whose value identifies the model; it is compared before anything is written."""

    name: str = field(kw_only=True)
    values: tuple[UInt32, ...] = field(default=(), kw_only=True)
    """Accepted values; without any, the value is only shown."""


@dataclass(frozen=True, kw_only=True)
class ModbusProfile(DriveProfile):
    """Profile of a drive model on Modbus."""

    line: LineSection
    power: PowerSection
    torque: ModbusTorque
    position: ModbusMotion | None = None
    velocity: ModbusMotion | None = None
    """Velocity measured by the drive; read only when the drive offers no position."""
    mode: ModeSection | None = None
    setup: tuple[WrittenRegister, ...] = ()
    """Registers that the drive needs to hold, in the order in which they are written."""
    watchdog: WatchdogSection | None = None
    identity: tuple[IdentityRegister, ...] = ()
    serial: Register | None = None
    """Serial number."""

    @property
    def guarded(self) -> bool:
        return self.watchdog is not None

    @property
    def rating_told(self) -> bool:
        return self.torque.rated is not None and not is_current(self.torque.target.unit)

    @property
    def full_scale(self) -> float | None:
        return self.torque.full_scale

    @property
    def echo(self) -> Signal | None:
        return ECHOES.get(self.torque.echo)

    def registers(self) -> dict[Signal, Register]:
        """Return the register of each signal that the drive offers."""
        named = {
            Signal.STATUSWORD: self.power.status,
            Signal.POSITION: self.position.actual if self.position else None,
            Signal.VELOCITY: self.velocity.actual if self.velocity else None,
            Signal.TORQUE_ACTUAL: self.torque.actual,
            Signal.TORQUE_DEMAND: self.torque.demand,
            Signal.CONTROLWORD: self.power.command,
            Signal.TARGET_TORQUE: self.torque.target,
        }
        return {signal: register for signal, register in named.items() if register is not None}

    def offers(self) -> dict[Signal, MappedSignal]:
        return {signal: self.mapped(signal, register) for signal, register in self.registers().items()}

    def mapped(self, signal: Signal, register: Register) -> MappedSignal:
        """Return a register as it is carried."""
        low_first = register.count > 1 and self.line.word_order == "low first"
        order = Order.BIG_LOW_WORD_FIRST if low_first else Order.BIG
        address = f"register {register.address:04X}h {signal.value}"
        return MappedSignal(signal, address, register.type, register.unit, order)


def modbus_profile(profile: DriveProfile) -> ModbusProfile:
    """Return the profile as one of Modbus; raises UsageError when it is one of another protocol."""
    if not isinstance(profile, ModbusProfile):
        raise UsageError(f"{profile.title} uses {profile.drive.protocol}; expected a Modbus drive")
    return profile


# Checks of a Modbus profile that its dataclasses cannot state.

_SIGNED = ("int16", "int32")
_ALL = ("int16", "uint16", "int32", "uint32")
_TYPES: dict[KeyPath, tuple[str, ...]] = {
    ("power", "status"): ("uint16", "uint32"),
    ("power", "command"): ("uint16", "uint32"),
    **dict.fromkeys(protocol.TORQUES, _SIGNED),
    ("position", "actual"): ("int32",),
    ("velocity", "actual"): _SIGNED,
}
"""Register → types that the master can scale or compare; all others may have any of a register."""
_UNITS: dict[KeyPath, tuple[str, ...]] = {
    **dict.fromkeys((*protocol.TORQUES, ("torque", "limit")), rig.TORQUE_UNITS + rig.ABSOLUTE_TORQUE_UNITS),
    ("torque", "rated"): tuple(rig.RATED_TORQUE_UNITS),
    ("position", "actual"): (rig.COUNTS, rig.TENTH_DEGREE, *METRES),
    ("velocity", "actual"): rig.VELOCITY_UNITS,
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
    if not protocol.check_usable(document):
        return
    protocol.check_motion(document)
    _check_functions(document)
    protocol.check_types(document, {path: _TYPES.get(path, _ALL) for path in _registers(document)})
    protocol.check_units(document, _UNITS)
    scaled = any(document.value("torque", key, "unit") == FULL_SCALE for key in ("target", "actual", "demand", "limit"))
    if scaled and "full_scale" not in document.table("torque"):
        document.fault(("torque", "full_scale"), f'missing; the unit "{FULL_SCALE}" needs the torque at 32767 [N·m]')
    _check_values(document)
    protocol.check_echo(document, ECHOES, "register")
    _check_power(document)


def _check_line(document: Document) -> None:
    """Note ranges of addresses in the wrong order, and facts of a serial line about a drive that has none."""
    transports = document.value("line", "transports")
    for key in ("baud", "parity", "stop_bits", "silence"):
        if isinstance(transports, list) and "rtu" not in transports and key in document.table("line"):
            document.fault(("line", key), 'no effect; expected "rtu" in line.transports, or no such key')
    for path, each in document.rows("line", "readable").items():
        if isinstance(each, list) and len(each) == 2 and all(type(end) is int for end in each) and each[0] > each[1]:
            document.refuse(path, "the first address before the last one")


def _check_functions(document: Document) -> None:
    """Note functions with which no feedback can be read, or no set-point written."""
    functions = document.value("line", "functions")
    known = {each for each in functions if type(each) is int} if isinstance(functions, list) else {READ_WRITE}
    both = READ_WRITE in known
    if not both and not {READ_HOLDING, READ_INPUT} & known:
        document.refuse(("line", "functions"), "3, 4 or 23 among them: otherwise nothing can be read")
    single = _count(document.value("torque", "target", "type")) == 1
    if not both and WRITE_MULTIPLE not in known and not (single and WRITE_SINGLE in known):
        wanted = "6, 16 or 23" if single else "16 or 23"
        document.refuse(("line", "functions"), f"{wanted} among them: otherwise no target torque can be written")


def _check_values(document: Document) -> None:
    """Note values that their registers cannot hold, among them the time of the watchdog."""
    mode = document.table("mode")
    protocol.check_fits(document, ("mode", "value"), mode.get("value"), document.value("mode", "write", "type"))
    for path in _setup(document):
        protocol.check_fits(document, (*path, "value"), document.value(*path, "value"), document.value(*path, "type"))
    time, deadline = document.table("watchdog", "time"), document.value("watchdog", "deadline")
    if isinstance(deadline, int | float):
        steps = round(deadline * (1000 if time.get("unit") == "ms" else 1))
        protocol.check_fits(document, ("watchdog", "deadline"), steps, time.get("type"))


def _check_power(document: Document) -> None:
    """Note a power table that is missing or not used."""
    has_rows = document.value("power", "table") == "rows"
    if has_rows and not document.value("power", "rows"):
        document.fault(("power", "rows"), 'missing; expected a row for each state, since power.table is "rows"')
    for key in ("rows", "reset"):
        if not has_rows and document.value("power", key) not in (None, []):
            document.fault(("power", key), 'no effect; expected power.table = "rows" too')


def _check_places(document: Document, paths: tuple[KeyPath, ...]) -> None:
    """Note a register that two keys name, or that ends beyond the last address."""
    used: dict[int, str] = {}
    for path in paths:
        address = document.value(*path, "address")
        if type(address) is not int:
            continue
        name, count = ".".join(map(str, path)), _count(document.value(*path, "type"))
        if address + count - 1 > _LAST:
            document.fault((*path, "address"), f"0x{address:04X} and the next address; the last address is 0xFFFF")
        first = next((used[each] for each in range(address, address + count) if each in used), name)
        if first != name:
            document.fault((*path, "address"), f"0x{address:04X} is already used by {first}; expected another register")
        used |= dict.fromkeys(range(address, address + count), first)


def _count(data_type: object) -> int:
    """Return the number of registers of a type, 1 of an unknown one."""
    return 2 if data_type in ("int32", "uint32") else 1


def _setup(document: Document) -> tuple[KeyPath, ...]:
    """Return the places of the registers that are written before the drive is enabled."""
    return (*document.rows("setup"), *document.rows("watchdog", "writes"))


def _registers(document: Document) -> Iterator[KeyPath]:
    """Yield the places of all registers that the file gives."""
    others = (("power", "error"), ("torque", "rated"), ("mode", "display"), ("serial",))
    yield from (path for path in (*_READ, *_WRITTEN, *_setup(document), *others) if document.table(*path))
    yield from document.rows("identity")
