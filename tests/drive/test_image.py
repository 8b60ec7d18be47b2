"""The process image, field by field and octet by octet."""

import struct

from haptic_fieldbus.drive.image import AXIS_HEADER, HEADER, lay_out_image
from haptic_fieldbus.drive.pdo import Direction, lay_out
from haptic_fieldbus.signals import Signal
from tests.builders import PROFILE


def pdos(direction: Direction, *signals: Signal, node: int = 1):  # type: ignore[no-untyped-def]
    kind = 1 if direction is Direction.TPDO else 255
    return lay_out(direction, PROFILE.offers(), signals, node=node, transmission_type=kind, pdos=4, entries=8)


TPDOS = pdos(Direction.TPDO, Signal.STATUSWORD, Signal.POSITION)
RPDOS = pdos(Direction.RPDO, Signal.CONTROLWORD, Signal.TARGET_TORQUE)


def test_one_axis_lies_in_the_order_header_axis_header_payload() -> None:
    layout = lay_out_image([(TPDOS, RPDOS)])
    image = HEADER.pack(123) + AXIS_HEADER.pack(456, 1, 0x8130) + struct.pack("<Hi", 0x0637, -2)
    assert layout.input_size == len(image) == 8 + 8 + 6
    assert layout.input.unpack(image) == (123, 456, 1, 0x8130, 0x0637, -2)
    assert layout.axes[0].header == 8
    assert layout.axes[0].inputs == ((16, 6),)
    assert layout.output.pack(0x0F, -3) == bytes.fromhex("0f00fdff")


def test_two_axes_keep_their_payloads_apart() -> None:
    layout = lay_out_image([(TPDOS, RPDOS), (TPDOS, RPDOS)])
    assert [axis.header for axis in layout.axes] == [8, 16]
    assert [axis.inputs for axis in layout.axes] == [((24, 6),), ((30, 6),)]
    assert [axis.outputs for axis in layout.axes] == [((0, 4),), ((4, 4),)]
    assert (layout.input_size, layout.output_size) == (36, 8)


def test_several_pdos_of_an_axis_follow_each_other() -> None:
    four = pdos(Direction.TPDO, Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_ACTUAL, Signal.STATUSWORD)
    layout = lay_out_image([(four, RPDOS)])
    assert layout.axes[0].inputs == ((16, 8), (24, 2))
