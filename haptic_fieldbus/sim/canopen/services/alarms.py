"""The timers of a simulated node.

Each service has an alarm of its own. The earliest time is kept as a number, because it is read after every frame while
alarms are set and rung seldom.
"""

from collections.abc import Callable

from haptic_fieldbus.sim import NEVER_NS

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
