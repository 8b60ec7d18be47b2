"""What a simulated node has to do at a later time.

Each service has an alarm of its own. The earliest of them is kept as a number, because it is asked for after every
frame while alarms are set and rung seldom.
"""

from collections.abc import Callable

from haptic_fieldbus.sim import NEVER_NS

Handler = Callable[[bytes, int], None]
"""What receives octets, at a time [ns]."""


class Alarm:
    """One time [ns] and what is done then."""

    __slots__ = ("_alarms", "due_ns", "ring")

    def __init__(self, alarms: "Alarms", ring: Callable[[int], None]) -> None:
        self.due_ns = NEVER_NS
        self.ring = ring
        self._alarms = alarms

    def at(self, due_ns: int) -> None:
        """Ring at this time instead of any other."""
        before, self.due_ns = self.due_ns, due_ns
        alarms = self._alarms
        if due_ns <= alarms.due_ns:
            alarms.due_ns = due_ns
        elif before == alarms.due_ns:
            alarms.find_due()

    def off(self) -> None:
        """Do not ring."""
        self.at(NEVER_NS)


class Alarms:
    """All alarms of a node; those that are due at one instant ring in the order in which they were made."""

    def __init__(self) -> None:
        self.due_ns = NEVER_NS
        self._all: list[Alarm] = []

    def new(self, ring: Callable[[int], None]) -> Alarm:
        """An alarm that is off."""
        alarm = Alarm(self, ring)
        self._all.append(alarm)
        return alarm

    def ring(self, t_ns: int) -> None:
        """Do all that is due, each once."""
        for alarm in self._all:
            if alarm.due_ns <= t_ns:
                alarm.off()
                alarm.ring(t_ns)

    def find_due(self) -> None:
        """After the earliest one was put off."""
        self.due_ns = min(alarm.due_ns for alarm in self._all)
