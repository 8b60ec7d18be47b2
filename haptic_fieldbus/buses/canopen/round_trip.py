"""The way to a node and back, measured by SDO uploads of its device type.

A round trip holds the adapter twice, the bus and the SDO server of the drive, which a drive runs beside its control
loop. So the least one bounds what the adapter takes, and the spread is that of both.
"""

from haptic_fieldbus.buses.canopen.expedited import request
from haptic_fieldbus.buses.canopen.setup import DEVICE_TYPE, NO_ANSWER_ADVICE
from haptic_fieldbus.buses.canopen.wire import Wire
from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.buses.timing import timing_checks
from haptic_fieldbus.protocols.canopen.cob_ids import SDO_REQUEST_COB_ID, SDO_RESPONSE_COB_ID

QUESTIONS = 200
ANSWER_NS = 100_000_000
SLOW = (
    "the adapter holds frames back, or the drive answers late: use a SocketCAN adapter in the place of a serial one, "
    "and see usb_latency_timer"
)


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
    silent = f"{NO_ANSWER_ADVICE}; `haptic-fieldbus scan` lists the nodes that are there"
    return timing_checks(f"node {node}", times, asked, rate, silent=silent, slow=SLOW)
