"""The process image, field by field and octet by octet."""

import pickle
import struct
from copy import deepcopy
from dataclasses import dataclass

import pytest

from haptic_fieldbus.drive.profile import DataType, MappedSignal, Order
from haptic_fieldbus.planning.image import AXIS_HEADER, HEADER, lay_out_image
from haptic_fieldbus.protocols.canopen.pdo import Direction, Pdo, lay_out
from haptic_fieldbus.protocols.canopen.traffic import PdoTraffic
from haptic_fieldbus.signals import Signal
from tests.builders import PROFILE


def pdos(direction: Direction, *signals: Signal, entries: int = 8) -> tuple[Pdo, ...]:
    kind = 1 if direction is Direction.TPDO else 255
    room = dict.fromkeys(range(1, 5), entries)
    return lay_out(direction, PROFILE.entries(), signals, node=1, transmission_type=kind, room=room)


RPDOS = pdos(Direction.RPDO, Signal.CONTROLWORD, Signal.TARGET_TORQUE)
AXIS = PdoTraffic(1, pdos(Direction.TPDO, Signal.STATUSWORD, Signal.POSITION), RPDOS)


def test_one_axis_lies_in_the_order_header_axis_header_payload() -> None:
    layout = lay_out_image([AXIS])
    image = HEADER.pack(123) + AXIS_HEADER.pack(456, 1, 0x8130) + struct.pack("<Hi", 0x0637, -2)
    assert layout.input_size == len(image) == 8 + 8 + 6
    assert layout.input.unpack(image) == layout.axes[0].input.unpack_from(image) == (123, 456, 1, 0x8130, 0x0637, -2)
    assert (layout.axes[0].header, layout.axes[0].inputs) == (8, (16, 6))
    assert layout.output.pack(0x0F, -3) == bytes.fromhex("0f00fdff")


def test_two_axes_keep_their_payloads_apart() -> None:
    layout = lay_out_image([AXIS, AXIS])
    assert [axis.header for axis in layout.axes] == [8, 16]
    assert [axis.inputs for axis in layout.axes] == [(24, 6), (30, 6)]
    assert [axis.outputs for axis in layout.axes] == [(0, 4), (4, 4)]
    assert (layout.input_size, layout.output_size) == (36, 8)


def test_several_pdos_of_an_axis_follow_each_other() -> None:
    two = pdos(Direction.TPDO, Signal.STATUSWORD, Signal.POSITION, Signal.TORQUE_ACTUAL, entries=2)
    assert [pdo.size for pdo in two] == [6, 2]
    assert lay_out_image([PdoTraffic(1, two, RPDOS)]).axes[0].inputs == (16, 8)


@dataclass(frozen=True)
class Plain(PdoTraffic):
    """An axis whose signals lie on the wire as they are given."""

    received: tuple[MappedSignal, ...] = ()
    sent: tuple[MappedSignal, ...] = ()

    @property
    def incoming(self) -> tuple[MappedSignal, ...]:
        return self.received

    @property
    def outgoing(self) -> tuple[MappedSignal, ...]:
        return self.sent


def mapped(signal: Signal, kind: DataType, order: Order) -> MappedSignal:
    return MappedSignal(signal, "somewhere", kind, order=order)


@pytest.mark.parametrize(
    ("order", "position", "torque"),
    [
        (Order.LITTLE, "fe ff ff 7f", "fd ff"),
        (Order.BIG, "7f ff ff fe", "ff fd"),
        (Order.BIG_LOW_WORD_FIRST, "ff fe 7f ff", "ff fd"),
    ],
)
def test_signals_may_lie_in_any_order_and_their_octets_too(order: Order, position: str, torque: str) -> None:
    """The cycle has statusword before position and controlword before torque, whatever the wire has."""
    received = (mapped(Signal.POSITION, DataType.INT32, order), mapped(Signal.STATUSWORD, DataType.UINT16, order))
    sent = (mapped(Signal.TARGET_TORQUE, DataType.INT16, order), mapped(Signal.CONTROLWORD, DataType.UINT16, order))
    layout = lay_out_image([Plain(1, (), (), received, sent)])
    status = (0x0637).to_bytes(2, "little" if order is Order.LITTLE else "big")
    image = HEADER.pack(123) + AXIS_HEADER.pack(456, 0, 0) + bytes.fromhex(position) + status
    assert layout.axes[0].input.unpack_from(image) == (123, 456, 0, 0, 0x0637, 0x7FFF_FFFE)
    assert layout.input.unpack(image) == (123, 456, 0, 0, 0x7FFF_FFFE, 0x0637)
    assert layout.input.pack(*layout.input.unpack(image)) == image
    buffer = bytearray(b"\xaa") * (layout.input.size + 2)
    layout.input.pack_into(buffer, 1, *layout.input.unpack(image))
    assert bytes(buffer) == b"\xaa" + image + b"\xaa", "with the fields of a header too"
    word = (0x0F).to_bytes(2, "little" if order is Order.LITTLE else "big")
    output = bytearray(layout.output_size)
    layout.axes[0].output.pack_into(output, 0, 0x0F, -3)
    assert bytes(output) == bytes.fromhex(torque) + word
    assert layout.axes[0].output.unpack(output) == (0x0F, -3)


def test_signals_of_an_axis_may_differ_in_the_order_of_their_octets() -> None:
    orders = (Order.BIG_LOW_WORD_FIRST, Order.BIG, Order.LITTLE)
    signals = (Signal.POSITION, Signal.STATUSWORD, Signal.TORQUE_ACTUAL)
    kinds = (DataType.INT32, DataType.UINT16, DataType.INT16)
    received = tuple(map(mapped, signals, kinds, orders))
    sent = (mapped(Signal.CONTROLWORD, DataType.UINT16, Order.BIG),)
    layout = lay_out_image([Plain(1, (), (), received, sent)])
    image = HEADER.pack(1) + AXIS_HEADER.pack(2, 0, 0) + bytes.fromhex("fffe7fff 0637 fdff")
    assert layout.input.unpack(image) == (1, 2, 0, 0, 0x7FFF_FFFE, 0x0637, -3)
    assert layout.input.pack(*layout.input.unpack(image)) == image


@pytest.mark.parametrize("order", Order)
def test_a_layout_is_copied_and_sent_to_another_process(order: Order) -> None:
    received = (mapped(Signal.POSITION, DataType.INT32, order), mapped(Signal.STATUSWORD, DataType.UINT16, order))
    layout = lay_out_image([Plain(1, (), (), received, ())])
    image = bytes(range(layout.input_size))
    for copy in (pickle.loads(pickle.dumps(layout)), deepcopy(layout)):
        assert copy.axes[0].input.unpack_from(image) == layout.axes[0].input.unpack_from(image)
        assert copy.input.pack(*copy.input.unpack(image)) == image
