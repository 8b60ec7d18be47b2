"""The way to a node and back, measured by SDO uploads of its device type.

A round trip holds the adapter twice, the bus and the SDO server of the drive, which a drive runs beside its control
loop. So the least one bounds what the adapter takes, and the spread is that of both.
"""

from statistics import quantiles

from haptic_fieldbus.buses.canopen.expedited import request
from haptic_fieldbus.buses.canopen.setup import DEVICE_TYPE, NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.protocols.canopen.cob_ids import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID

QUESTIONS = 200
ANSWER_NS = 100_000_000
LONGEST_ROUND_TRIP = 5e-3
"""[s]; adapters that hold frames back, as USB serial ports do, take longer."""
JITTER_SHARE = 0.5
"""Share of a period by which a round trip may be longer than the usual one."""


def round_trips(wire: Wire, node: int, questions: int = QUESTIONS) -> list[float]:
    """Return the times of so many round trips [s]; those without an answer are missing. Raises BusError."""
    answered: list[int] = []
    wire.listen(SDO_RESPONSE_COB_ID + node, lambda data: answered.append(wire.clock.now_ns()))
    times: list[float] = []
    for _ in range(questions):
        answered.clear()
        asked_ns = wire.clock.now_ns()
        wire.send(SDO_REQUEST_COB_ID + node, request(DEVICE_TYPE, None))
        while not answered and wire.pump(asked_ns + ANSWER_NS):
            pass
        if answered:
            times.append((answered[0] - asked_ns) * 1e-9)
        elif not times:
            break  # a node that is not there
    return times


def round_trip_checks(node: int, times: list[float], asked: int, rate: float) -> tuple[Check, Check]:
    """Return the checks of the usual round trip and of its jitter, for a loop of this rate [Hz]."""
    if len(times) < 2:
        advice = f"{NO_ANSWER_ADVICE}; `haptic-fieldbus scan` lists the nodes that are there"
        return (
            Check("round_trip", False, f"node {node} does not answer", advice),
            Check("round_trip_jitter", None, "not measured"),
        )
    cuts = quantiles(times, n=100, method="inclusive")
    usual, late = cuts[49], cuts[98]
    lost = f", {asked - len(times)} of {asked} without an answer" if len(times) < asked else ""
    quick = usual <= LONGEST_ROUND_TRIP and not lost
    slow = (
        "the adapter holds frames back, or the drive answers late: use a SocketCAN adapter in the place of a serial "
        "one, and see usb_latency_timer"
    )
    jitter = late - usual
    steady = jitter <= JITTER_SHARE / rate
    unsteady = (
        f"at {rounded(rate)} Hz feedback would come too late in some periods: give this program real-time rights "
        f"(scheduling, memory), take the load from this computer, or use --rate {_fitting_rate(jitter)}"
    )
    told = f"{_ms(min(times))} ms at least, {_ms(usual)} usual, {_ms(max(times))} at most (node {node}){lost}"
    return (
        Check("round_trip", quick, told, "" if quick else slow),
        Check("round_trip_jitter", steady, f"1 of 100 takes {_ms(jitter)} ms longer", "" if steady else unsteady),
    )


def _fitting_rate(jitter: float) -> str:
    """Return the rate [Hz] at which a jitter [s] is no more than its share of a period, with two digits."""
    return rounded(JITTER_SHARE / max(jitter, 1e-9), 2)


def _ms(seconds: float) -> str:
    return rounded(1e3 * seconds)
