"""A session beside the run that it cuts open: the wall in virtual time, interleaved, the shortest of each."""

from time import perf_counter

from rows import Row, show

from haptic_fieldbus import run, session

SHORT, LONG, REPEATS = 0.2, 2.2, 12
"""Durations [s]; their difference leaves out what happens once a run."""


def by_run(duration: float) -> float:
    """Time of a run [s]."""
    began = perf_counter()
    run("wall", duration=duration)
    return perf_counter() - began


def by_session(duration: float) -> float:
    """Time of a session whose caller looks at each period [s]."""
    began = perf_counter()
    with session("wall", duration=duration) as live:
        for state in live:
            if state.position > 1.0:
                break
    return perf_counter() - began


def main() -> None:
    by_run(SHORT)
    found = [(by_session(SHORT), by_run(SHORT), by_session(LONG), by_run(LONG)) for _ in range(REPEATS)]
    short, brief, ours, reference = (min(times) for times in zip(*found, strict=True))
    periods = 1000.0 * (LONG - SHORT)
    show(
        [
            Row(
                "a period of a session, beside that of a run",
                (ours - short) / periods,
                (reference - brief) / periods,
                1.1,
            )
        ]
    )


if __name__ == "__main__":
    main()
