"""Parts that several services of a simulated node share: COB-IDs and timers."""

from collections.abc import Callable

from haptic_fieldbus.sim import NEVER_NS
from haptic_fieldbus.sim.drive.dictionary import AbortCode, AccessRefused, Entry

# The timers of a simulated node.
#
# Each service has an alarm of its own. The earliest time is kept as a number, because it is read after every frame
# while alarms are set and rung seldom.

Handler = Callable[[bytes, int], None]
"""Function that receives the octets of a frame and the time [ns]."""


class Alarm:
    """One time [ns], and the function to call then."""

    __slots__ = ("_alarms", "due_ns", "ring")

    def __init__(self, alarms: "Alarms", ring: Callable[[int], None]) -> None:
        self.due_ns = NEVER_NS
        self.ring = ring
        self._alarms = alarms

    def at(self, due_ns: int) -> None:
        """Ring at this time instead of any earlier setting."""
        before, self.due_ns = self.due_ns, due_ns
        alarms = self._alarms
        # A search through all alarms is needed only when the earliest one is postponed.
        if due_ns <= alarms.due_ns:
            alarms.due_ns = due_ns
        elif before == alarms.due_ns:
            alarms.find_due()

    def off(self) -> None:
        """Do not ring."""
        self.at(NEVER_NS)


class Alarms:
    """All alarms of a node; those due at one instant ring in the order of their creation."""

    def __init__(self) -> None:
        self.due_ns = NEVER_NS
        self._all: list[Alarm] = []

    def new(self, ring: Callable[[int], None]) -> Alarm:
        """Return a new alarm, which is off."""
        alarm = Alarm(self, ring)
        self._all.append(alarm)
        return alarm

    def ring(self, t_ns: int) -> None:
        """Ring every alarm that is due, once."""
        for alarm in self._all:
            if alarm.due_ns <= t_ns:
                # First: the function that is called may set the alarm again.
                alarm.off()
                alarm.ring(t_ns)

    def find_due(self) -> None:
        """Find the earliest alarm again, after it was postponed."""
        self.due_ns = min(alarm.due_ns for alarm in self._all)


# COB-IDs: the bits above the identifier, and the identifiers of restricted use.
#
# Reference: CiA 301 4.2, 7.3.5 (CAN-IDs of restricted use), 7.5.2.35 and 7.5.2.37 (bits 29 to 31).

INVALID = 1 << 31
"""Set: the communication object does not exist. In the COB-ID of TIME the bit set means that TIME is consumed."""
NO_RTR = 1 << 30
"""TPDO: no remote frame may request it. SYNC and TIME: the node produces it."""
EXTENDED = 1 << 29
"""Set: the identifier has 29 bits, which no object here accepts."""
ID = 0x7FF
"""Mask of the 11-bit identifier."""

# CiA 301, table 41.
_RESTRICTED = (
    range(0x080), range(0x101, 0x181), range(0x581, 0x600), range(0x601, 0x680), range(0x6E0, 0x700),
    range(0x701, 0x800),
)  # fmt: skip


def is_restricted(can_id: int) -> bool:
    """Return whether the standard reserves an 11-bit identifier for other purposes."""
    return any(can_id in identifiers for identifiers in _RESTRICTED)


def move_refused(
    entry: Entry, exists: Callable[[int], bool] = lambda value: not value & INVALID
) -> Callable[[int], None]:
    """Return an `accept` of a COB-ID; `exists` tells from a value whether the communication object exists.

    It raises Refused for an extended identifier, for a restricted one, and for another one while the object exists.
    """

    def accept(value: int) -> None:
        moves = exists(entry.value) and (value ^ entry.value) & ID
        if value & EXTENDED or (exists(value) and (moves or is_restricted(value & ID))):
            raise AccessRefused(AbortCode.INVALID_VALUE)

    return accept
