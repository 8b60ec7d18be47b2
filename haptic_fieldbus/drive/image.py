"""The process image: one row of octets in, one out, each packed and unpacked by one precompiled `struct`.

Input:  HEADER (t_ns, the instant at which the drives latched this period's data, of several buses the last), then for
        each axis AXIS_HEADER (age_ns of the data, link flags, emergency code), then for each axis the octets of its
        TPDOs as they came.
Output: for each axis the octets of its RPDOs.

The bus writes the header and copies payloads; it decodes nothing. Faults therefore reach the cycle as data.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_fieldbus.drive.pdo import Pdo

HEADER = struct.Struct("<q")
AXIS_HEADER = struct.Struct("<IHH")
AXIS_HEADER_FIELDS = ("age_ns", "flags", "emergency")
LARGEST_AGE_NS = 0xFFFF_FFFF


@dataclass(frozen=True)
class AxisImage:
    """Where one axis lies: offset of its header, (offset, size) of each of its PDOs; and how to read and write it."""

    header: int
    inputs: tuple[tuple[int, int], ...]
    outputs: tuple[tuple[int, int], ...]
    input: struct.Struct
    """Unpacks t_ns, this axis' header and its signals from the whole input image."""
    output: struct.Struct
    """Packs its signals at the first of `outputs`."""


@dataclass(frozen=True)
class ImageLayout:
    """Sizes, places and codecs of a plan's process image."""

    axes: tuple[AxisImage, ...]
    input: struct.Struct
    output: struct.Struct

    @property
    def input_size(self) -> int:
        return self.input.size

    @property
    def output_size(self) -> int:
        return self.output.size


def lay_out_image(pdos: Sequence[tuple[Sequence[Pdo], Sequence[Pdo]]]) -> ImageLayout:
    """Place the (TPDOs, RPDOs) of each axis one after another."""
    header = HEADER.size
    inputs_at = HEADER.size + len(pdos) * AXIS_HEADER.size
    outputs_at = 0
    axes = []
    for tpdos, rpdos in pdos:
        inputs, inputs_at = _place(tpdos, inputs_at)
        outputs, outputs_at = _place(rpdos, outputs_at)
        axes.append(
            AxisImage(header, inputs, outputs, _reader(header, inputs, tpdos), struct.Struct("<" + _codes(rpdos)))
        )
        header += AXIS_HEADER.size
    headers = HEADER.format[1:] + AXIS_HEADER.format[1:] * len(pdos)
    return ImageLayout(
        tuple(axes),
        input=struct.Struct("<" + headers + "".join(_codes(tpdos) for tpdos, _ in pdos)),
        output=struct.Struct("<" + "".join(_codes(rpdos) for _, rpdos in pdos)),
    )


def _place(pdos: Sequence[Pdo], offset: int) -> tuple[tuple[tuple[int, int], ...], int]:
    places = []
    for pdo in pdos:
        places.append((offset, pdo.size))
        offset += pdo.size
    return tuple(places), offset


def _reader(header: int, inputs: tuple[tuple[int, int], ...], tpdos: Sequence[Pdo]) -> struct.Struct:
    before = header - HEADER.size
    between = inputs[0][0] - header - AXIS_HEADER.size if inputs else 0
    return struct.Struct(f"{HEADER.format}{before}x{AXIS_HEADER.format[1:]}{between}x{_codes(tpdos)}")


def _codes(pdos: Sequence[Pdo]) -> str:
    return "".join(entry.type.code for pdo in pdos for entry in pdo.entries)
