"""Looks at drives on any bus: a protocol tells what it lacks, and values tell how old they are."""

import pytest

from haptic_fieldbus.buses.access import look_at
from haptic_fieldbus.errors import BusTimeoutError, UsageError
from haptic_fieldbus.protocols.cia402 import CIA402
from haptic_fieldbus.signals import Signal
from tests.protocols.plugin.toy_fieldbus import ToyAccess, ToySection

SECTION = ToySection("toy", "wire")


def test_what_a_protocol_lacks_is_told() -> None:
    with pytest.raises(UsageError, match="toy buses cannot be scanned"):
        ToyAccess().scan(SECTION, {}, None)
    with pytest.raises(UsageError, match="drives on toy buses cannot be watched"):
        ToyAccess().onlooker(SECTION, {})
    assert ToyAccess().checks(SECTION, {}, 1000.0) == ()


ENTRIES = {Signal.STATUSWORD: "6041h", Signal.POSITION: "6064h", Signal.TORQUE_ACTUAL: "6077h"}


@pytest.mark.parametrize("answered", [1, 2, 3])
def test_the_age_of_values_is_the_time_since_the_first_was_asked_for(answered: int) -> None:
    """Each request takes 4 ms, and the one without an answer too; the position stands for its own instant."""
    now_ns, asked = 7_000_000_000, list[str]()

    def read(entry: str) -> int:
        nonlocal now_ns
        now_ns += 4_000_000
        asked.append(entry)
        if len(asked) > answered:
            raise BusTimeoutError("no answer")
        return len(asked)

    found = look_at(
        ENTRIES, read, lambda: now_ns, arrived_ns=lambda: now_ns, power=CIA402, error=None, silent="is it on?"
    )
    assert found.age == pytest.approx(4e-3 * len(asked))
    assert len(found.values) == answered
    if Signal.POSITION in found.values:
        assert found.t_ns == 7_000_000_000 + 4_000_000 * found.values[Signal.POSITION]
