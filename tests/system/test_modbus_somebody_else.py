"""Somebody else who writes to a drive while force is rendered is noticed by what no longer acts, in a stated time.

On a serial line the requests of somebody else are heard, too: `tests/buses/modbus`.
"""

import pytest

from haptic_fieldbus import api
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import DriveFaultError
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.running.loop import run_loop
from haptic_fieldbus.sim.drive.power import State
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.modbus.line import SimulatedLine
from haptic_fieldbus.sim.modbus.site import SIMULATION
from haptic_fieldbus.sim.slot import Slot
from tests.sim.modbus.units import MODE, TARGET

TCP, RTU = "sim-modbus-tcp", "sim-modbus-rtu@115200"
AFTER_NS = 1_000_000_000
"""[ns] from enabling, when the hand taps the wall."""


class Meddler:
    """Somebody who writes a register of unit 1, once or again and again."""

    def __init__(self, line: SimulatedLine, register: int, value: int, *, again: bool) -> None:
        self._unit, self._register, self._value, self._again = line.unit(1), register, value, again
        self._enabled_ns: int | None = None
        self.wrote_ns: int | None = None
        line.tap(self._frame)

    def _frame(self, t_ns: int, ours: bool, octets: bytes) -> None:
        if self._enabled_ns is None and self._unit.drive.power.state is State.OPERATION_ENABLED:
            self._enabled_ns = t_ns
        if self._enabled_ns is None or t_ns < self._enabled_ns + AFTER_NS or (self.wrote_ns and not self._again):
            return
        assert self._unit.write(self._register, (self._value,), t_ns) is None
        self.wrote_ns = self.wrote_ns or t_ns


@pytest.mark.thorough("a run for each", quick=1)
@pytest.mark.parametrize(
    ("bus", "register", "value", "again"),
    [
        *((bus, MODE, mode, False) for bus in (TCP, RTU) for mode in (1, 3, 8, 9)),
        (TCP, TARGET, 100, True),
    ],
)
def test_it_ends_the_run_in_the_stated_time(bus: str, register: int, value: int, again: bool) -> None:
    """Modes of position and of velocity, and set-points between ours."""
    plan = api.plan("wall", bus=bus, settings={"wall.stiffness": "max/2", "wall.position": 0.001})
    (axis,), clock, hand = plan.axes, VirtualClock(), hand_named("tap")
    assert hand is not None
    slot = Slot(axis.node, axis.profile, axis.rig, hand.after(axis.limits.fade_in))
    master, line = SIMULATION.simulate(plan.rig.bus[plan.buses[0].name], "", [slot], clock, 0, None)
    assert line is not None
    meddler = Meddler(line, register, value, again=again)
    try:
        master.open(plan)
        with pytest.raises(DriveFaultError, match="set-points do not act"):
            run_loop(plan, Cycle(plan), master, clock, cycles=round(3.0 * plan.rate))
    finally:
        master.close()
    stated = next(each.seconds for each in plan.deadlines if each.cause is EndCause.NO_EFFECT)
    assert meddler.wrote_ns is not None
    assert clock.now_ns() - meddler.wrote_ns <= 1e9 * stated
