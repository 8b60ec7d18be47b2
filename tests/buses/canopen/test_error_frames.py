"""The words for error frames, and that bus-off stays."""

import can
import pytest

from haptic_fieldbus.buses.canopen.errors import CLASS_WORDS, STATE_WORDS, TOLD, ErrorFrames
from tests.buses.canopen.benches import Bench

ERROR = 0x2000_0000


def test_nothing_is_told_of_a_controller_that_is_well() -> None:
    assert ErrorFrames().sentence("can0") is None


@pytest.mark.parametrize("bit", CLASS_WORDS)
def test_each_class_has_its_words(bit: int) -> None:
    heard = ErrorFrames()
    heard.hear(ERROR | bit, bytes(8))
    heard.hear(ERROR | bit, bytes(8))
    assert f"{CLASS_WORDS[bit]} 2×" in (heard.sentence("can0") or "")
    assert heard.bus_off == (bit == 0x040)
    assert bit & TOLD


@pytest.mark.parametrize("bit", STATE_WORDS)
def test_each_state_has_its_words(bit: int) -> None:
    heard = ErrorFrames()
    heard.hear(ERROR | 0x004, bytes((0, bit, 0, 0, 0, 0, 0, 0)))
    assert f"{STATE_WORDS[bit]} 1×" in (heard.sentence("can0") or "")


def test_a_restart_after_bus_off_does_not_undo_it() -> None:
    heard = ErrorFrames()
    heard.hear(ERROR | 0x040, bytes(8))
    heard.hear(ERROR | 0x100, bytes(8))
    assert heard.bus_off
    assert heard.sentence("can0") == (
        "can0: CAN controller error: bus-off 1×, restarted after bus-off 1×. Check wiring, terminators and bit rate"
    )


def test_what_the_controller_reported_is_told_at_the_end() -> None:
    bench = Bench().open()
    passive = can.Message(arbitration_id=0x04, is_error_frame=True, is_extended_id=False, data=bytes((0, 0x20)))
    bench.can.later(0, passive)
    bench.bus.read(bench.clock.now_ns() + 1_000_000)
    assert bench.bus.stop()
    assert any("fake0: CAN controller error: error passive by transmit" in told for told in bench.bus.warnings)
