"""Which fault must end a run, by which cause, and how long it may take; by the names of the kinds alone.

A fault that is not listed may end the run or not; how it ends is judged as well.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from tests.invariants.stated import Stated

TRIP, FEEDBACK, FAULT, RESET = "own limit or trip", "feedback lost", "drive fault or emergency", "node reset"
HEARTBEAT, DISCONNECTED = "heartbeat of the drive lost", "bus-off or cable off"
STOPPED, NO_EFFECT, END = "master stopped", "set-points without effect", "Ctrl-C or ordinary end"
OTHER_MASTER = "set-points of another master"

FADES = frozenset({FEEDBACK, FAULT, RESET, DISCONNECTED, STOPPED})
"""Causes after which torque cannot grow: it is held, fades or ends."""


ANSWERS = 4
"""Most answers of a drive on Modbus in a period."""


def _lasts(fault: Any, stated: Stated) -> bool:
    """Whether a loss lasts until the age of the feedback is a trip, wherever in a period it begins."""
    oldest = max(axis.age for axis in stated.axes) + 3.0 * stated.period
    if hasattr(fault, "duration"):
        return fault.duration is None or float(fault.duration) > oldest
    # On Modbus set-points and several blocks may have answers of their own.
    share = 1.0 / ANSWERS if fault.kind.startswith("answer_") else 1.0
    return fault.count is None or int(fault.count) * stated.period * share > oldest


def _stands_still(seconds: float, stated: Stated) -> bool:
    return seconds > stated.deadline(STOPPED) + 2.0 * stated.period


def _jumps(fault: Any, stated: Stated) -> bool:
    return abs(int(fault.counts)) > 3.0 * max(axis.jump for axis in stated.axes) + 100.0


def _unheard(faults: Sequence[Any]) -> bool:
    """Whether an emergency message may not be heard."""
    return any(getattr(fault, "frames", None) == "emergency" for fault in faults)


def _commands(fault: Any, stated: Stated) -> bool:
    """Whether a foreign frame is what only a master sends: its heartbeat, SYNC, or a set-point of our drives."""
    return fault.can_id in (0x080, 0x77F) or any(
        fault.can_id == axis.target.can_id and len(fault.data) == axis.target.length for axis in stated.axes
    )


ENDS: Mapping[str, Callable[[Any, Stated], str | None]] = {
    "emergency": lambda fault, stated: FAULT,
    "drive_fault": lambda fault, stated: FAULT,
    "safe_torque_off": lambda fault, stated: FAULT,
    "node_reset": lambda fault, stated: RESET,
    "silence": lambda fault, stated: DISCONNECTED if _lasts(fault, stated) else None,
    "missing_tpdos": lambda fault, stated: FEEDBACK if _lasts(fault, stated) else None,
    "sync_ignored": lambda fault, stated: FEEDBACK if _lasts(fault, stated) else None,
    "heartbeat_lost": lambda fault, stated: HEARTBEAT,
    "duplicate_node": lambda fault, stated: TRIP,
    "encoder_jump": lambda fault, stated: TRIP if _jumps(fault, stated) else None,
    "bus_off": lambda fault, stated: DISCONNECTED,
    "interface_down": lambda fault, stated: DISCONNECTED if _lasts(fault, stated) else None,
    "foreign_frame": lambda fault, stated: TRIP if _commands(fault, stated) else None,
    "answer_lost": lambda fault, stated: FEEDBACK if _lasts(fault, stated) else None,
    "answer_truncated": lambda fault, stated: FEEDBACK if _lasts(fault, stated) and fault.length <= 8 else None,
    "answer_corrupted": lambda fault, stated: FEEDBACK if _lasts(fault, stated) else None,
    "connection_reset": lambda fault, stated: DISCONNECTED,
    "host_paused": lambda fault, stated: STOPPED if _stands_still(fault.duration, stated) else None,
    "host_late": lambda fault, stated: STOPPED if _stands_still(fault.delay, stated) else None,
}
"""Causes of the end, by the kind of fault; None where it is not sure that the run ends."""

CUTS = frozenset({"silence", "bus_off", "interface_down", "connection_reset"})
"""Kinds that take a drive or the master off the wire."""

HARMLESS: Mapping[str, Callable[[Any, Stated], bool]] = {
    "error_frame": lambda fault, stated: True,
    "missing_tpdos": lambda fault, stated: fault.count == 1,
    "frame_dropped": lambda fault, stated: (
        fault.frames in ("emergency", "nmt") or (fault.frames in ("tpdo", "rpdo") and fault.count == 1)
    ),
    "answer_lost": lambda fault, stated: fault.count == 1,
    "host_late": lambda fault, stated: fault.delay < 0.2 * stated.period and fault.count == 1,
}
"""Faults that must not end a run, when they are alone."""

STATUS: Mapping[str, frozenset[int]] = {
    "emergency": frozenset({1}),
    "drive_fault": frozenset({1}),
    "safe_torque_off": frozenset({1}),
    "node_reset": frozenset({1}),
    "silence": frozenset({1}),
    "missing_tpdos": frozenset({1}),
    "sync_ignored": frozenset({1}),
    "heartbeat_lost": frozenset({1}),
    "bus_off": frozenset({1}),
    "interface_down": frozenset({1}),
    "answer_lost": frozenset({1}),
    "answer_truncated": frozenset({1}),
    "answer_corrupted": frozenset({1}),
    "connection_reset": frozenset({1}),
    "torque_dead": frozenset({1}),
    "missing_rpdos": frozenset({1}),
    "duplicate_node": frozenset({3}),
    "encoder_jump": frozenset({3}),
    "foreign_frame": frozenset({1, 3}),  # it may set the node to another state, or be an emergency in its name
}
"""Exit status of a run that a single fault has ended: 1 the bus or the drive, 3 a limit of ours."""


def cause_of(fault: Any, stated: Stated, faults: Sequence[Any] = ()) -> str | None:
    """The cause by which this fault must end the run, among others of `faults`; None where it need not."""
    if fault.kind == "emergency" and _unheard(faults):
        return None
    return ENDS[fault.kind](fault, stated) if fault.kind in ENDS else None


def is_harmless(fault: Any, stated: Stated) -> bool:
    """Whether a run with nothing but this fault must go on to its end."""
    return fault.kind in HARMLESS and HARMLESS[fault.kind](fault, stated)


def host_delay(faults: Sequence[Any]) -> float:
    """How much later the computer may do anything [s]."""
    late: float = sum(fault.delay * fault.count for fault in faults if fault.kind == "host_late")
    slow: float = sum(fault.extra * fault.count for fault in faults if fault.kind == "slow_compute")
    paused: float = sum(fault.duration for fault in faults if fault.kind == "host_paused")
    return late + slow + paused


LATER: Mapping[str, float] = {"duplicate_node": 1.0, "host_late": 1.0, "host_paused": 1.0}
"""Periods by which a fault comes, or is seen, later than its cause says.

A second node answers after the first, when the exchange has ended, and is heard in the next period. A computer stands
still when the loop waits the next time, before which it still gives a proof of life.
"""


def allowed(cause: str, faults: Sequence[Any], stated: Stated) -> float:
    """How long the way to zero may take [s]; other faults at the same time may bar the way that was stated."""
    later = max((LATER.get(fault.kind, 0.0) for fault in faults if fault is not None), default=0.0)
    seconds = stated.deadline(cause) + later * stated.period
    if len(faults) < 2:
        return seconds
    faults = [fault for fault in faults if fault is not None]
    others = [cause_of(fault, stated, faults) for fault in faults]
    slowest = max((stated.deadline(other) for other in others if other is not None), default=0.0)
    return seconds + max(slowest, stated.deadline(STOPPED), stated.deadlines.get(NO_EFFECT, 0.0)) + host_delay(faults)
