"""The medium: time, arbitration, queues, statistics."""

import pytest

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.canopen.link import Frame, Port, Wire, wire_bits

MBIT = 1_000_000
A, B = Frame(0x100, b"\x55\x55"), Frame(0x200, b"\x55")


def _play(wire: Wire, now_ns: int = 0) -> list[tuple[int, Frame]]:
    """Everything that is queued, with the end of each frame."""
    sent = []
    while (start_ns := wire.start_ns(now_ns)) != NEVER_NS:
        wire.start(start_ns)
        now_ns = wire.end_ns
        sent.append((now_ns, wire.finish()))
    return sent


def test_a_frame_is_received_after_its_bits_and_the_next_starts_three_bits_later() -> None:
    wire = Wire(MBIT)
    port = wire.attach(in_order=True)
    port.send(A)
    port.send(B)
    first = 1000 * wire_bits(A)
    assert _play(wire) == [(first, A), (first + 3000 + 1000 * wire_bits(B), B)]


@pytest.mark.parametrize("bitrate", [10_000, 125_000, 500_000, 1_000_000])
def test_time_on_the_wire_scales_with_the_bit_rate(bitrate: int) -> None:
    wire = Wire(bitrate)
    wire.attach(in_order=True).send(A)
    assert _play(wire)[0][0] == pytest.approx(wire_bits(A) / bitrate * 1e9, abs=1)


def test_the_lowest_identifier_of_all_nodes_goes_first() -> None:
    wire = Wire(MBIT)
    for frame in (B, A, Frame(0x300, b"")):
        wire.attach(in_order=True).send(frame)
    assert [frame.can_id for _, frame in _play(wire)] == [0x100, 0x200, 0x300]


def test_a_first_in_first_out_queue_holds_an_urgent_frame_back_and_a_priority_queue_does_not() -> None:
    for in_order, expected in ((True, [0x200, 0x100]), (False, [0x100, 0x200])):
        wire = Wire(MBIT)
        port = wire.attach(in_order=in_order)
        port.send(B)
        port.send(A)
        assert [frame.can_id for _, frame in _play(wire)] == expected


def test_frames_of_equal_identifier_keep_their_order_in_a_priority_queue() -> None:
    wire = Wire(MBIT)
    port = wire.attach(in_order=False)
    frames = [Frame(0x300, b""), *(Frame(0x200, bytes([number])) for number in range(3))]
    for frame in frames:
        port.send(frame)
    assert [frame for _, frame in _play(wire)] == [*frames[1:], frames[0]]


def test_a_frame_queued_while_another_is_on_the_wire_waits_for_it() -> None:
    wire = Wire(MBIT)
    slow, urgent = wire.attach(in_order=True), wire.attach(in_order=True)
    slow.send(B)
    wire.start(0)
    urgent.send(A)
    assert wire.start_ns(10) == NEVER_NS
    end_ns = wire.end_ns
    assert wire.finish() == B
    assert wire.sender is slow
    assert wire.start_ns(end_ns) == end_ns + 3000


def test_a_node_that_leaves_takes_what_it_had_queued_along() -> None:
    wire = Wire(MBIT)
    port = wire.attach(in_order=True)
    port.send(A)
    wire.detach(port)
    assert wire.start_ns(0) == NEVER_NS


def test_nothing_can_be_taken_from_an_empty_wire() -> None:
    with pytest.raises(RuntimeError, match="nothing is on the wire"):
        Wire(MBIT).finish()


def test_statistics_count_frames_that_ended_in_the_window_with_their_intermission() -> None:
    wire = Wire(MBIT)
    port = wire.attach(in_order=True)
    port.send(A)
    port.send(B)
    ends = [end_ns for end_ns, _ in _play(wire)]
    everything = wire.statistics(0, 1_000_000)
    assert everything.frames == 2
    assert everything.bits == wire_bits(A) + wire_bits(B) + 6
    assert everything.load == pytest.approx(everything.bits / 1000)
    assert wire.statistics(ends[0], ends[1]).frames == 1
    assert wire.statistics(ends[1], ends[1] + 5).bits == 0
    assert Wire(MBIT).statistics(0, 0).load == 0


def test_a_port_offers_the_only_frame_it_has() -> None:
    port = Port(in_order=False)
    port.send(A)
    assert port.candidate() == A
