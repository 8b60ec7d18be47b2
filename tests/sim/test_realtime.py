"""Objects kept out of garbage collection while drives are hosted in real time."""

import gc

from haptic_fieldbus.sim.bench import frozen


def test_what_the_program_around_it_had_frozen_stays_frozen() -> None:
    gc.freeze()
    before = gc.get_freeze_count()
    with frozen():
        pass
    assert gc.get_freeze_count() >= 0.9 * before > 0
