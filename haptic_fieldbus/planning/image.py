"""The process image: one row of octets in, one out, each packed and unpacked by one precompiled codec.

Input:  HEADER (t_ns, the instant at which the drives latched this period's data, of several buses the last), then for
        each axis AXIS_HEADER (age_ns of the data, link flags, emergency code), then for each axis the octets of its
        incoming signals as they came.
Output: for each axis the octets of its outgoing signals.

The bus writes the header and copies payloads; it decodes nothing. Faults therefore reach the cycle as data. The header
is little-endian; where all signals are so too, as on CANopen, a codec is a plain `struct.Struct`.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from haptic_fieldbus.drive.objects import Order
from haptic_fieldbus.drive.profile import MappedSignal
from haptic_fieldbus.protocols.traffic import AxisTraffic
from haptic_fieldbus.signals import Signal

HEADER = struct.Struct("<q")
AXIS_HEADER = struct.Struct("<IHH")
AXIS_HEADER_FIELDS = ("age_ns", "flags", "emergency")
LARGEST_AGE_NS = 0xFFFF_FFFF
_RANKS = {signal: rank for rank, signal in enumerate(Signal)}


class Codec(Protocol):
    """What is used of a `struct.Struct`."""

    @property
    def size(self) -> int: ...

    def pack(self, *values: int) -> bytes: ...

    def pack_into(self, buffer: Any, offset: int, *values: int) -> None: ...

    def unpack(self, buffer: Any, /) -> tuple[int, ...]: ...

    def unpack_from(self, buffer: Any, offset: int = 0) -> tuple[int, ...]: ...


@dataclass(frozen=True)
class AxisImage:
    """Where one axis lies: offset of its header, (offset, size) of its signals; and how to read and write them."""

    header: int
    inputs: tuple[int, int]
    outputs: tuple[int, int]
    input: Codec
    """Unpacks t_ns, this axis' header and its signals (`canonical`) from the whole input image."""
    output: Codec
    """Packs controlword and target torque at the offset of `outputs`."""


@dataclass(frozen=True)
class ImageLayout:
    """Sizes, places and codecs of a plan's process image."""

    axes: tuple[AxisImage, ...]
    input: Codec
    """Of the whole image, in the order of its octets; the cycle reads each axis by its own codec."""
    output: Codec

    @property
    def input_size(self) -> int:
        return self.input.size

    @property
    def output_size(self) -> int:
        return self.output.size


def lay_out_image(axes: Sequence[AxisTraffic]) -> ImageLayout:
    """Place the signals of each axis one after another."""
    header = HEADER.size
    inputs_at = HEADER.size + len(axes) * AXIS_HEADER.size
    outputs_at = 0
    images = []
    for axis in axes:
        inputs, outputs = (inputs_at, size_of(axis.incoming)), (outputs_at, size_of(axis.outgoing))
        before, between = header - HEADER.size, inputs_at - header - AXIS_HEADER.size
        start = f"{HEADER.format}{before}x{AXIS_HEADER.format[1:]}{between}x"
        images.append(
            AxisImage(
                header,
                inputs,
                outputs,
                _codec(start, axis.incoming, canonical(axis.incoming)),
                _codec("<", axis.outgoing, canonical(axis.outgoing)),
            )
        )
        header, inputs_at, outputs_at = header + AXIS_HEADER.size, sum(inputs), sum(outputs)
    headers = HEADER.format + AXIS_HEADER.format[1:] * len(axes)
    incoming = [mapped for axis in axes for mapped in axis.incoming]
    outgoing = [mapped for axis in axes for mapped in axis.outgoing]
    return ImageLayout(tuple(images), _codec(headers, incoming, incoming), _codec("<", outgoing, outgoing))


def size_of(signals: Sequence[MappedSignal]) -> int:
    """Octets on the wire."""
    return sum(mapped.type.size for mapped in signals)


def canonical(signals: Sequence[MappedSignal]) -> tuple[MappedSignal, ...]:
    """In the order in which the cycle has them, whatever their order on the wire."""
    return tuple(sorted(signals, key=lambda mapped: _RANKS[mapped.signal]))


def _codec(start: str, signals: Sequence[MappedSignal], values: Sequence[MappedSignal]) -> Codec:
    """Of the little-endian fields of `start` and then these signals; their values are in the order of `values`."""
    straight = tuple(signals) == tuple(values)
    if straight and all(mapped.order is Order.LITTLE for mapped in signals):
        return struct.Struct(start + "".join(mapped.type.code for mapped in signals))
    return WireCodec(start, signals, range(len(signals)) if straight else [signals.index(each) for each in values])


class WireCodec:
    """A codec for octets in any order: each signal is turned by itself."""

    def __init__(self, start: str, signals: Sequence[MappedSignal], places: Sequence[int]) -> None:
        self._struct = struct.Struct(start + "".join(f"{mapped.type.size}s" for mapped in signals))
        self._signals, self._places = tuple(signals), tuple(places)
        self._first = struct.Struct(start)
        self.size = self._struct.size
        self._fields = len(self._first.unpack(bytes(self._first.size)))

    def pack(self, *values: int) -> bytes:
        fields, own = values[: self._fields], values[self._fields :]
        octets = [b""] * len(own)
        for place, value in zip(self._places, own, strict=True):
            octets[place] = _to_wire(self._signals[place], value)
        return self._struct.pack(*fields, *octets)

    def pack_into(self, buffer: bytearray, offset: int, *values: int) -> None:
        buffer[offset : offset + self.size] = self.pack(*values)

    def unpack(self, buffer: bytes | bytearray) -> tuple[int, ...]:
        return self.unpack_from(buffer)

    def unpack_from(self, buffer: bytes | bytearray, offset: int = 0) -> tuple[int, ...]:
        found = self._struct.unpack_from(buffer, offset)
        octets = found[self._fields :]
        return (*found[: self._fields], *[_from_wire(self._signals[place], octets[place]) for place in self._places])


def _to_wire(mapped: MappedSignal, value: int) -> bytes:
    return _turned(mapped, mapped.type.pack(value))


def _from_wire(mapped: MappedSignal, octets: bytes) -> int:
    return mapped.type.unpack(_turned(mapped, octets))


def _turned(mapped: MappedSignal, octets: bytes) -> bytes:
    """Little-endian octets in the order of the wire, or back: both are the same turn."""
    if mapped.order is Order.LITTLE:
        return octets
    if mapped.order is Order.BIG:
        return octets[::-1]
    return b"".join(octets[at : at + 2][::-1] for at in range(0, len(octets), 2))
