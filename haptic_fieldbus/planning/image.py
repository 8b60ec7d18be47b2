"""The process image: a buffer of octets in and one out, each with precompiled codecs.

Input:  HEADER with t_ns, the instant at which the drives latched the data of this period (with several buses the last
of them); then for each axis an AXIS_HEADER with age_ns of the data, link flags and a code; then for each axis the
octets of its incoming signals, as they were received. The code is an emergency error code, or the identifier of a
foreign frame. Output: for each axis the octets of its outgoing signals.

The bus writes the headers and copies payloads; it decodes nothing. Faults of the link therefore reach the cycle as
data. The headers are little-endian. When all signals are little-endian too, as on CANopen, a codec is a plain
`struct.Struct`.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Protocol

from haptic_fieldbus.drive.profile import MappedSignal, Order
from haptic_fieldbus.protocols.traffic import AxisTraffic
from haptic_fieldbus.signals import Signal

HEADER = struct.Struct("<q")
AXIS_HEADER = struct.Struct("<IHH")
AXIS_HEADER_FIELDS = ("age_ns", "flags", "emergency")
T_NS, AGE_NS, FLAGS, EMERGENCY, STATUSWORD = range(5)
"""Indices in the decoded values of an axis; the mapped signals follow, the statusword first."""
LARGEST_AGE_NS = 0xFFFF_FFFF
"""Largest age in the 32-bit field; also the age of an axis that never had feedback."""
_RANKS = {signal: rank for rank, signal in enumerate(Signal)}
"""Index of each signal in the order of the cycle, which is the order of the enum."""


class Codec(Protocol):
    """The part of the interface of `struct.Struct` that the image uses."""

    @property
    def size(self) -> int: ...

    def pack(self, *values: int) -> bytes: ...

    def pack_into(self, buffer: Any, offset: int, *values: int) -> None: ...

    def unpack(self, buffer: Any, /) -> tuple[int, ...]: ...

    def unpack_from(self, buffer: Any, offset: int = 0) -> tuple[int, ...]: ...


@dataclass(frozen=True)
class AxisImage:
    """Places and codecs of one axis: offset of its header, (offset, size) of its incoming and outgoing signals."""

    header: int
    inputs: tuple[int, int]
    outputs: tuple[int, int]
    input: Codec
    """Codec of t_ns, the header of this axis and its signals in `canonical` order; it reads the whole input image."""
    output: Codec
    """Codec of controlword and target torque, to be used at the offset in `outputs`."""


@dataclass(frozen=True)
class ImageLayout:
    """Places and codecs of the process image of a plan."""

    axes: tuple[AxisImage, ...]
    input: Codec
    """Codec of the whole image, in the order of its octets; the cycle uses the codecs of the axes instead."""
    output: Codec

    @property
    def input_size(self) -> int:
        return self.input.size

    @property
    def output_size(self) -> int:
        return self.output.size


def lay_out_image(axes: Sequence[AxisTraffic]) -> ImageLayout:
    """Return the layout: the axes in sequence, and the signals of each axis in sequence."""
    header, inputs_at, outputs_at = HEADER.size, HEADER.size + len(axes) * AXIS_HEADER.size, 0
    images = []
    for axis in axes:
        inputs, outputs = (inputs_at, size_of(axis.incoming)), (outputs_at, size_of(axis.outgoing))
        # Pad octets in place of the other axes let one call decode t_ns, this header and these signals together.
        before, between = header - HEADER.size, inputs_at - header - AXIS_HEADER.size
        start = f"{HEADER.format}{before}x{AXIS_HEADER.format[1:]}{between}x"
        decoding = _codec(start, axis.incoming, canonical(axis.incoming))
        encoding = _codec("<", axis.outgoing, canonical(axis.outgoing))
        images.append(AxisImage(header, inputs, outputs, decoding, encoding))
        header, inputs_at, outputs_at = header + AXIS_HEADER.size, sum(inputs), sum(outputs)
    headers = HEADER.format + AXIS_HEADER.format[1:] * len(axes)
    incoming = [mapped for axis in axes for mapped in axis.incoming]
    outgoing = [mapped for axis in axes for mapped in axis.outgoing]
    return ImageLayout(tuple(images), _codec(headers, incoming, incoming), _codec("<", outgoing, outgoing))


def size_of(signals: Sequence[MappedSignal]) -> int:
    """Return the size of the signals on the wire [octets]."""
    return sum(mapped.type.size for mapped in signals)


def canonical(signals: Sequence[MappedSignal]) -> tuple[MappedSignal, ...]:
    """Return the signals in the order of the cycle, whatever their order on the wire."""
    return tuple(sorted(signals, key=lambda mapped: _RANKS[mapped.signal]))


def _codec(start: str, signals: Sequence[MappedSignal], values: Sequence[MappedSignal]) -> Codec:
    """Return a codec for the little-endian fields `start`, followed on the wire by `signals`.

    It decodes the values of `start`, then the signals in the order of `values`.
    """
    # On CANopen both orders are the same and all octets little-endian: a plain struct is the fastest codec.
    straight = tuple(signals) == tuple(values)
    if straight and all(mapped.order is Order.LITTLE for mapped in signals):
        return PlainCodec(start + "".join(mapped.type.code for mapped in signals))
    places = range(len(signals)) if straight else [signals.index(each) for each in values]
    all_big = all(mapped.order is Order.BIG for mapped in signals)
    return (BigCodec if all_big else WireCodec)(start, signals, places)


class PlainCodec(struct.Struct):
    """A struct that can be copied and sent to another process, as a part of the plan of a result."""

    def __reduce__(self) -> tuple[type["PlainCodec"], tuple[str]]:
        return PlainCodec, (self.format,)


class WireCodec:
    """A codec for any order of octets and signals; it costs a Python call for each signal."""

    def __init__(self, start: str, signals: Sequence[MappedSignal], places: Sequence[int]) -> None:
        self._struct = PlainCodec(start + "".join(f"{mapped.type.size}s" for mapped in signals))
        self._signals, self._places = tuple(signals), tuple(places)
        self._first = PlainCodec(start)
        self.size = self._struct.size
        # The number of fields in `start`; its length would count pad octets too.
        self._fields = len(self._first.unpack(bytes(self._first.size)))

    def pack(self, *values: int) -> bytes:
        fields, own = values[: self._fields], values[self._fields :]
        octets = [b""] * len(own)
        for place, value in zip(self._places, own, strict=True):
            octets[place] = _turned(self._signals[place], self._signals[place].type.pack(value))
        return self._struct.pack(*fields, *octets)

    def pack_into(self, buffer: bytearray, offset: int, *values: int) -> None:
        buffer[offset : offset + self.size] = self.pack(*values)

    def unpack(self, buffer: bytes | bytearray) -> tuple[int, ...]:
        return self.unpack_from(buffer)

    def unpack_from(self, buffer: bytes | bytearray, offset: int = 0) -> tuple[int, ...]:
        found = self._struct.unpack_from(buffer, offset)
        own = [(self._signals[place], found[self._fields + place]) for place in self._places]
        return (*found[: self._fields], *[mapped.type.unpack(_turned(mapped, octets)) for mapped, octets in own])


class BigCodec(WireCodec):
    """A codec for big-endian signals in any order, as on Modbus: one struct for all of them."""

    def __init__(self, start: str, signals: Sequence[MappedSignal], places: Sequence[int]) -> None:
        super().__init__(start, signals, places)
        self._rest, self._rest_at = PlainCodec(">" + "".join(mapped.type.code for mapped in signals)), self._first.size
        straight = self._places == tuple(range(len(places)))
        # A getter of one place would return no tuple, but one signal is always in order.
        self._in_order = tuple if straight else itemgetter(*self._places)
        """Puts the values of the wire into the order of the cycle."""
        self._on_wire = tuple if straight else itemgetter(*(self._places.index(each) for each in range(len(places))))

    def pack(self, *values: int) -> bytes:
        own = self._on_wire(values[self._fields :])
        return self._first.pack(*values[: self._fields]) + self._rest.pack(*own)

    def pack_into(self, buffer: bytearray, offset: int, *values: int) -> None:
        self._first.pack_into(buffer, offset, *values[: self._fields])
        self._rest.pack_into(buffer, offset + self._rest_at, *self._on_wire(values[self._fields :]))

    def unpack_from(self, buffer: bytes | bytearray, offset: int = 0) -> tuple[int, ...]:
        found = self._rest.unpack_from(buffer, offset + self._rest_at)
        return self._first.unpack_from(buffer, offset) + self._in_order(found)


def _turned(mapped: MappedSignal, octets: bytes) -> bytes:
    """Return little-endian octets in the order of the wire, or the reverse: either conversion is its own inverse."""
    if mapped.order is Order.LITTLE:
        return octets
    if mapped.order is Order.BIG:
        return octets[::-1]
    # The low word first, and in each word the high octet first.
    return b"".join(octets[at : at + 2][::-1] for at in range(0, len(octets), 2))
