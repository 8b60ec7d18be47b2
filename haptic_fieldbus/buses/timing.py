"""The way to a device and back: is it short enough for a loop, and does it take equally long each time?"""

from collections.abc import Sequence
from statistics import quantiles

from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.numerals import rounded

LONGEST_ROUND_TRIP = 5e-3
"""[s]; adapters that hold octets back, as USB serial ports do, take longer."""
JITTER_SHARE = 0.5
"""Share of a period by which a round trip may be longer than the usual one."""


def timing_checks(
    subject: str, times: Sequence[float], asked: int, rate: float, *, silent: str, slow: str
) -> tuple[Check, Check]:
    """Return the checks of the usual round trip and of its jitter, for a loop of this rate [Hz].

    `times` are those of the answers [s], `silent` and `slow` what to do about none and about late ones.
    """
    if len(times) < 2:
        return (
            Check("round_trip", False, f"{subject} does not answer", silent),
            Check("round_trip_jitter", None, "not measured"),
        )
    cuts = quantiles(times, n=100, method="inclusive")
    usual, late = cuts[49], cuts[98]
    lost = f", {asked - len(times)} of {asked} without an answer" if len(times) < asked else ""
    quick = usual <= LONGEST_ROUND_TRIP and not lost
    jitter = late - usual
    steady = jitter <= JITTER_SHARE / rate
    unsteady = (
        f"at {rounded(rate)} Hz feedback would come too late in some periods: give this program real-time rights "
        f"(scheduling, memory), take the load from this computer, or use --rate {_fitting_rate(jitter)}"
    )
    told = f"{_ms(min(times))} ms at least, {_ms(usual)} usual, {_ms(max(times))} at most ({subject}){lost}"
    return (
        Check("round_trip", quick, told, "" if quick else slow),
        Check("round_trip_jitter", steady, f"1 of 100 takes {_ms(jitter)} ms longer", "" if steady else unsteady),
    )


def _fitting_rate(jitter: float) -> str:
    """Return the rate [Hz] at which a jitter [s] is no more than its share of a period, with two digits."""
    return rounded(JITTER_SHARE / max(jitter, 1e-9), 2)


def _ms(seconds: float) -> str:
    return rounded(1e3 * seconds)
