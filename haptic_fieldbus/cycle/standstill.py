"""Test of an encoder whose counts stand still: pairs of pulses are added to the force of the scene.

Theory and sizes stand in `planning.encoder_probe`. A pair has four parts: a lead, in which a force near its limit is
lowered; a pulse against the force; a pulse along it; and a wait until the last motion is visible. A count that changes
during the lead ends the test. A count that changes in the first pulse ends this pulse, and the second pulse gets the
same length. The mean of the pair is then zero, and the handle moves no faster than necessary. A gap in the samples
restarts the pair. If the counts changed, the next test begins after they have stood still for a while. Otherwise the
next pair follows.
"""

import math

from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import Permission, TripKind, TripOff
from haptic_fieldbus.planning.encoder_probe import PAIRS, EncoderProbe
from haptic_fieldbus.planning.image import T_NS

LEAST_LEFT = 0.5
"""Share of the smallest force for the start of a pair; below it a running pair is given up."""


class Standstill:
    """Encoder test of one axis: `look` starts it; `give` takes the permitted force and adds the pulse."""

    def __init__(
        self, probe: EncoderProbe, effort_unit: float, state: AxisState, permission: Permission, trip: TripOff
    ) -> None:
        self.vain = 0
        """Number of pairs without a motion since the last motion."""
        self._probe, self._state, self._permission = probe, state, permission
        self._trip = trip
        self._least = probe.least / effort_unit * (1.0 - 1e-9)
        self._longest_ns = round(1.5e9 * probe.period)
        self._began_ns = self._last_ns = self._place = self._length = 0
        self._here = 0.0

    def due(self) -> bool:
        """Return whether no test runs and the force is large enough for one."""
        permission = self._permission
        return permission.pulses is None and permission.proof is None and abs(self._state.target) >= self._least

    def look(self, t_ns: int) -> None:
        """Start a test if none runs and the force is large enough.

        To be called in periods in which counts have stood still for a while.
        """
        state, permission = self._state, self._permission
        if not self.due():
            return
        if state.moved_ns > self._began_ns:
            self.vain = 0
        self._began_ns, self._last_ns, self._place, self._here = t_ns, t_ns, -1, state.position
        self._length = self._probe.periods
        permission.pulses, permission.unchanged = self.give, False

    def give(self, force: float, bound: float) -> float:
        """Return the permitted force with its pulse, within `bound`, and book the largest energy of the pulse."""
        probe, permission, state = self._probe, self._permission, self._state
        t_ns = state.feedback[T_NS]
        self._place = self._place + 1 if t_ns - self._last_ns < self._longest_ns else 0
        self._last_ns, place = t_ns, self._place
        size, moved = abs(force), state.moved_ns > self._began_ns
        if size < probe.least * LEAST_LEFT or (moved and place < probe.lead):
            permission.pulses = None
            return force
        if moved and place - probe.lead < self._length:
            self._length = place - probe.lead
        lowered = max(0.0, size + probe.effort - bound)
        permission.given += (probe.effort + lowered) * abs(state.position - self._here)
        self._here = state.position
        if place >= probe.pair:
            permission.pulses = None
            self.vain += not moved
            if self.vain >= PAIRS:
                self._trip(TripKind.ENCODER_STILL, force, self._probe.effort)
        return math.copysign(size + self._pulse(place, lowered), force)

    def _pulse(self, place: int, lowered: float) -> float:
        """Return the change of the size of the force in this period of the pair [N or N·m]."""
        probe, since = self._probe, place - self._probe.lead
        if since < 0:
            return -lowered * (place + 1) / probe.lead
        if since >= 2 * self._length:
            return 0.0
        return (-probe.effort if since < self._length else probe.effort) - lowered
