"""A period of a session, whose caller looks at each state, beside one of the run that it cuts open; in virtual time.

Both take turns. Times are processor time, of a long one less that of a short one: that leaves out what happens once.
"""

import gc
from collections.abc import Callable
from contextlib import ExitStack
from time import process_time

from rows import Figure, Pair, Row, show

from haptic_fieldbus import run, session

SHORT, LONG = 0.2, 4.2
"""Durations [s]."""


def by_run(duration: float) -> None:
    run("wall", duration=duration)


def by_session(duration: float) -> None:
    with session("wall", duration=duration) as live:
        for state in live:
            if state.position > 1.0:
                break


def period(call: Callable[[float], None]) -> float:
    """Return the processor time of a period [s]."""
    times = []
    for duration in (SHORT, LONG):
        gc.collect()  # the garbage of what was measured before
        begun = process_time()
        call(duration)
        times.append(process_time() - begun)
    return (times[1] - times[0]) / (1000.0 * (LONG - SHORT))


def pair(_: ExitStack) -> Pair:
    return lambda: (period(by_session), period(by_run))


FIGURES = (Figure("period of a session", "one of the same run", 1.1, pair),)


if __name__ == "__main__":
    show([Row(each.name, *each.pair(ExitStack())(), each.bound) for each in FIGURES])
