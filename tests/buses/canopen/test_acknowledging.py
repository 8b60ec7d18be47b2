"""The fault of a lost master is cleared and no other one, and a stopped bus can be used again."""

import pytest

from haptic_fieldbus.errors import DriveFaultError
from tests.buses.canopen.benches import NODE, Bench

STATUSWORD, ERROR_CODE = (0x6041, 0), (0x603F, 0)
ENABLED, FAULT, DISABLED = 0x27, 0x08, 0x40
LOST_MASTER = 0x8130


def faulted(code: int | None) -> Bench:
    """A stopped bus, whose drive then says that it is in fault, with this error code; None: without 603Fh."""
    bench = Bench().open()
    assert bench.bus.stop() is True
    bench.drive.objects[STATUSWORD] = FAULT.to_bytes(2, "little")
    if code is None:
        bench.drive.objects.pop(ERROR_CODE, None)
    else:
        bench.drive.objects[ERROR_CODE] = code.to_bytes(2, "little")
    bench.can.sent.clear()
    return bench


def clearing(bench: Bench) -> None:
    """The drive leaves its fault when bit 7 of the controlword rises."""
    store, before = bench.drive._store, [0]

    def watched(key: tuple[int, int], data: bytes) -> None:
        store(key, data)
        if key == (0x6040, 0):
            word = int.from_bytes(data, "little")
            rises = word & 0x80 and not before[0] & 0x80
            before[0] = word
            bench.drive.objects[STATUSWORD] = (DISABLED if rises else FAULT).to_bytes(2, "little")
            if rises:
                bench.drive._store = store  # type: ignore[method-assign]

    bench.drive._store = watched  # type: ignore[method-assign]


@pytest.mark.parametrize("code", [LOST_MASTER, 0, None])
def test_the_fault_of_a_lost_master_is_cleared_by_the_rise_of_bit_7_alone(code: int | None) -> None:
    bench = faulted(code)
    clearing(bench)
    bench.bus.acknowledge()
    assert bench.written() == [("6040h:00", 0), ("6040h:00", 0x80), ("6040h:00", 0)]


@pytest.mark.parametrize("code", [0x2310, 0x8120, 0xFF01])
def test_another_fault_is_told_and_left_as_it_is(code: int) -> None:
    bench = faulted(code)
    with pytest.raises(DriveFaultError, match=rf"error code {code:04X}h .*Nothing was cleared"):
        bench.bus.acknowledge()
    assert bench.written() == []


def test_a_fault_that_stays_is_told() -> None:
    bench = faulted(LOST_MASTER)
    bench.drive.power_stays = FAULT
    with pytest.raises(DriveFaultError, match=r"still in fault 0\.5 s after"):
        bench.bus.acknowledge()


def test_a_drive_without_fault_is_only_asked() -> None:
    bench = Bench().open()
    bench.bus.stop()
    bench.can.sent.clear()
    bench.bus.acknowledge()
    assert bench.written() == []


def test_a_bus_that_was_stopped_is_configured_and_used_again_without_a_complaint() -> None:
    bench = Bench().open()
    for _ in range(2):
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            image = bench.bus.read(bench.clock.now_ns() + bench.plan.period_ns)
            bench.bus.write(bytes((controlword, 0, 0, 0)))
        flags = int.from_bytes(image[12:14], "little")
        assert (flags, bench.drive.value(0x6041)) == (0, ENABLED)
        assert bench.can.of(0x77F), "a heartbeat came with the first write"
        bench.can.sent.clear()
        assert bench.bus.stop() is True
        bench.bus.acknowledge()
        bench.bus.configure(bench.plan)
        bench.bus.start()
    assert bench.bus.warnings == []
    assert (0x1016, 1) in bench.drive.objects
    assert bench.drive.value(0x1016, 1) == 0x7F_0032, "the guard is armed again"


def test_a_drive_is_asked_for_its_statusword_and_one_that_is_silent_is_made_to_serve_requests() -> None:
    bench = Bench().open()
    bench.drive.objects[STATUSWORD] = (0x1234).to_bytes(2, "little")
    assert bench.bus.ask("handle") == 0x1234
    bench.drive.silent = True
    bench.can.sent.clear()
    before_ns = bench.clock.now_ns()
    assert bench.bus.ask("handle") is None
    assert bench.clock.now_ns() - before_ns < 25_000_000
    assert bench.can.of(0x000) == [bytes((0x80, NODE))]
    assert bench.can.of(0x77F) == [], "no proof of life"
