"""Registers that are exchanged with one drive in each period, laid out in as few requests as pay.

Signals in adjacent registers share a block. A gap is read through where that is cheaper than a request of its own and
the profile says that the registers in it exist; nothing that was not asked for is ever written.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.errors import ImageTooLargeError
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class Block:
    """Registers in a row, which one request reads or writes."""

    address: int
    count: int
    signals: tuple[MappedSignal, ...]
    """In the order of their addresses."""
    offsets: tuple[int, ...]
    """Place of each signal in the octets of the block."""

    @property
    def places(self) -> Iterator[tuple[int, int]]:
        """Yield the first octet of each signal in the octets of the block, and the one behind its last."""
        for offset, mapped in zip(self.offsets, self.signals, strict=True):
            yield offset, offset + mapped.type.size

    @property
    def gaps(self) -> int:
        """Registers that are read although nobody asked for them."""
        return self.count - sum(mapped.type.size for mapped in self.signals) // 2

    def has(self, signal: Signal) -> bool:
        return any(mapped.signal is signal for mapped in self.signals)


@dataclass(frozen=True)
class RegisterRequest:
    """One request to a drive: its function, and what it reads and writes."""

    function: int
    read: Block | None = None
    write: Block | None = None


def blocks(profile: ModbusProfile, signals: Sequence[Signal], longest: int, largest_gap: int) -> tuple[Block, ...]:
    """Return blocks with these signals, by address; gaps of at most `largest_gap` registers are read through.

    Raises ImageTooLargeError when one signal is longer than a request may be.
    """
    registers = profile.registers()
    groups: list[list[Signal]] = []
    for signal in sorted(signals, key=lambda each: registers[each].address):
        own = registers[signal]
        if own.count > longest:
            raise ImageTooLargeError(f"{signal.value} needs {own.count} registers; a request may have {longest}")
        if groups and _joins(profile, groups[-1], signal, longest, largest_gap):
            groups[-1].append(signal)
        else:
            groups.append([signal])
    return tuple(_block(profile, group) for group in groups)


def _joins(profile: ModbusProfile, group: Sequence[Signal], signal: Signal, longest: int, largest_gap: int) -> bool:
    """Return True when a signal that follows a group stands in one block with it."""
    registers = profile.registers()
    first, end, own = registers[group[0]].address, _end(profile, group), registers[signal]
    gap = own.address - end
    if gap < 0 or own.address + own.count - first > longest:
        return False
    return gap == 0 or (gap <= largest_gap and profile.line.has_all(end, own.address))


def _end(profile: ModbusProfile, signals: Sequence[Signal]) -> int:
    """Return the address behind the last register of these signals."""
    return max(profile.registers()[signal].address + profile.registers()[signal].count for signal in signals)


def _block(profile: ModbusProfile, signals: Sequence[Signal]) -> Block:
    registers = profile.registers()
    first = registers[signals[0]].address
    return Block(
        first,
        _end(profile, signals) - first,
        tuple(profile.mapped(signal, registers[signal]) for signal in signals),
        tuple(2 * (registers[signal].address - first) for signal in signals),
    )
