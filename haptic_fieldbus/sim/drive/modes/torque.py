"""The torque modes: cyclic synchronous torque (10, and the manufacturer's own) and profile torque (4).

Theory (CiA 402-2). Cyclic: the demand is target torque 6071h plus torque offset 60B2h, at once. Profile: the demand
goes to the target by the torque slope 6087h [‰/s], one step at each control tick; bit 10 is set when it has reached the
target. A mode of the manufacturer may need bits of the controlword to follow its target, as the iPOS needs bit 4.
"""

from haptic_fieldbus.sim.drive.modes.mode import FOLLOWS_COMMAND, INTERNAL_LIMIT, TARGET_REACHED, Mode
from haptic_fieldbus.sim.drive.objects import Objects
from haptic_fieldbus.sim.drive.stage import Stage


class CyclicTorque(Mode):
    """Cyclic synchronous torque mode."""

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage)
        self._target, self._offset = objects.target_torque, objects.row(0x60B2)
        self._unit = objects.torque_unit

    def act(self, t_ns: int) -> None:
        stage = self.stage
        stage.torque(self._target.value * self._unit + self._offset.value * stage.permille, t_ns)
        self.status = FOLLOWS_COMMAND | INTERNAL_LIMIT if stage.limited else FOLLOWS_COMMAND


class OwnTorque(CyclicTorque):
    """A torque mode of the manufacturer, which follows its target while bits of the controlword are set."""

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage, objects)
        self._controlword, self._bits = objects.controlword, objects.mode_bits

    def act(self, t_ns: int) -> None:
        if self._controlword.value & self._bits == self._bits:
            super().act(t_ns)
        else:
            self.stage.torque(0.0, t_ns)
            self.status = 0


class ProfileTorque(Mode):
    """Profile torque mode."""

    halts = True

    def __init__(self, stage: Stage, objects: Objects) -> None:
        super().__init__(stage)
        self._target, self._slope = objects.target_torque, objects.row(0x6087)
        self._unit = objects.torque_unit
        self._demand = self._goal = 0.0
        self._t_ns = 0

    def start(self, t_ns: int) -> None:
        self._demand, self._t_ns = self.stage.commanded, t_ns
        self.ticking = False
        self.act(t_ns)

    def act(self, t_ns: int) -> None:
        # The slope ends at the permitted torque: a demand beyond it would never be reached.
        wanted = self._target.value * self._unit
        self._goal = self.stage.limit(wanted)
        if not self.ticking and self._goal != self._demand:
            self.ticking, self._t_ns = True, t_ns
        self._tell(self._goal != wanted)

    def tick(self, t_ns: int) -> None:
        step = self._slope.value * self.stage.permille * (t_ns - self._t_ns) * 1e-9
        left = self._goal - self._demand
        self._demand = (
            self._goal if abs(left) <= step or not self._slope.value else self._demand + (step if left > 0.0 else -step)
        )
        self._t_ns = t_ns
        self.stage.torque(self._demand, t_ns)
        self.ticking = self._demand != self._goal
        self._tell(bool(self.status & INTERNAL_LIMIT))

    def _tell(self, limited: bool) -> None:
        self.status = (0 if self.ticking else TARGET_REACHED) | (INTERNAL_LIMIT if limited else 0)
