"""Deadlines of RPDOs: their event timers (1400h:05).

Theory (CiA 301, 7.5.2.35): the first reception in *operational* arms the deadline, each further one postpones it. When
it passes, an emergency 8250h is sent, whose error ends with the next reception. Writing the event timer or the
identifier disarms the deadline. The standard leaves further reactions to the application: this drive treats a missed
deadline as a lost link (6007h).

A reception only notes its time; the alarm is postponed when it rings. So a period costs one assignment.
"""

from collections.abc import Callable, Iterable

from haptic_fieldbus.sim.canopen.services.alarms import Alarm, Alarms, Handler
from haptic_fieldbus.sim.canopen.services.emergency import RPDO_TIMEOUT, Emergencies
from haptic_fieldbus.sim.canopen.services.pdo import Rpdo


class Deadline:
    """The deadline of one RPDO."""

    def __init__(self, rpdo: Rpdo, alarms: Alarms, emergencies: Emergencies, lost: Callable[[int, int], None]) -> None:
        self.alarm: Alarm = alarms.new(self._rings)
        self._rpdo = rpdo
        self._emergencies = emergencies
        self._lost = lost
        self._parameters = (rpdo.can_id, rpdo.deadline_ns)
        self._last_ns = 0
        self._armed = False

    def heard(self, t_ns: int) -> None:
        """Note a reception of the RPDO."""
        self._last_ns = t_ns
        if not self._armed:
            self._armed = True
            self.alarm.at(t_ns + self._rpdo.deadline_ns)
            self._emergencies.clear(RPDO_TIMEOUT, self._rpdo)

    def disarm(self) -> None:
        """Disarm until the next reception; an error that was raised ends."""
        self._armed = False
        self.alarm.off()
        self._emergencies.clear(RPDO_TIMEOUT, self._rpdo)

    def check(self) -> None:
        """Disarm when the parameters have changed."""
        parameters = (self._rpdo.can_id, self._rpdo.deadline_ns)
        if parameters != self._parameters:
            self._parameters = parameters
            self.disarm()

    def _rings(self, t_ns: int) -> None:
        # The alarm still has the time of an earlier reception: postpone it.
        due_ns = self._last_ns + self._rpdo.deadline_ns
        if due_ns > t_ns:
            self.alarm.at(due_ns)
            return
        self._armed = False
        self._emergencies.raise_error(RPDO_TIMEOUT, self._rpdo)
        self._lost(RPDO_TIMEOUT, t_ns)


class Deadlines:
    """The deadlines of all RPDOs that have one."""

    def __init__(self, alarms: Alarms, emergencies: Emergencies, lost: Callable[[int, int], None]) -> None:
        self._alarms = alarms
        self._emergencies = emergencies
        self._lost = lost
        self._all: dict[Rpdo, Deadline] = {}

    def watch(self, rpdos: Iterable[Rpdo]) -> None:
        """Take over the parameters of the RPDOs that are received; disarm the deadlines of all others."""
        received = set(rpdos)
        for rpdo, deadline in self._all.items():
            if rpdo in received:
                deadline.check()
            else:
                deadline.disarm()

    def heard(self, rpdo: Rpdo, receive: Handler) -> Handler:
        """Return a receiver that notes the reception and then calls `receive`."""
        deadline = self._all.get(rpdo)
        if deadline is None:
            deadline = self._all[rpdo] = Deadline(rpdo, self._alarms, self._emergencies, self._lost)
        heard = deadline.heard

        def timed(data: bytes, t_ns: int) -> None:
            heard(t_ns)
            receive(data, t_ns)

        return timed

    def stop(self) -> None:
        """Disarm all deadlines, on leaving *operational*."""
        for deadline in self._all.values():
            deadline.disarm()
