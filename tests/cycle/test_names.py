"""Names that the room of the cycle offers to the rooms above it."""

import pytest

from haptic_fieldbus import assessing, cycle
from haptic_fieldbus.cycle.safety import TripKind


def test_each_name_is_there_and_no_other() -> None:
    for room in (cycle, assessing):
        assert all(getattr(room, name).__name__ == name for name in room.__all__)
        with pytest.raises(AttributeError, match=r"has no attribute 'Cicle'"):
            room.Cicle  # noqa: B018 a name is asked for
    assert cycle.TripKind is TripKind
