"""The sign from torque to motion, watched while the scene runs: a change of torque must show in the acceleration.

In a scene torque answers motion, so that torque and position go together whatever the sign is. What differs is how fast
hands are. Within blocks of 5 ms a hand changes its force little, while contact changes the torque much. With the mean
torque u and the mean acceleration a of two blocks, and their changes δu and δa from one pair of blocks to the next,

    S = Σ m·δa·δu,   N = Σ δu²     (m: mass of the bench; the sums forget within 0.1 s)

S/N is the share of a change of torque that shows in the motion: 1 for a free handle, less where a hand adds its mass,
−1 when the sign has turned. The run ends when S/N is below −½ and N is that of strong contact. A hand can do this by
force: it must change its force against the torque, by one and a half times as much, all the time; the shipped hand that
knocks does so for small torques only (`tests/system/test_sign.py` has the smallest S/N of each scene).

This is no proof that the sign is right. It is there for what happens later, such as a drive that is turned round by
another tool. There is none where a count is too coarse for an acceleration within a block, or a period too long, nor
where the scene itself answers acceleration: a virtual mass gives torque against every knock of a hand.
"""

import math
from collections import deque

from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.cycle.sensing import PeriodStep
from haptic_fieldbus.cycle.state import AxisState
from haptic_fieldbus.cycle.watch import TripOff
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.virtual_mass import virtual_mass
from haptic_fieldbus.signals import Workspace

SHORTEST_BLOCK, LONGEST_BLOCK = 0.005, 0.01
"""[s]"""
COARSENESS = 0.05
"""Share of rated torque that the encoder may be off by within a block."""
MEMORY = 0.1
"""[s] after which the sums have forgotten all but 1/e."""
STRONG = 0.1
KNOCK = {Workspace.LINEAR: 5.0, Workspace.ROTARY: 0.25}
"""Share of rated torque, and half the knock of a hand [N or N·m]: √N counts above both."""
AGAINST = -0.5
"""S/N below which the motion goes against the torque."""
HEAVIEST = 0.05
"""Mass that the scene may add, as a share of that of the bench."""
WORST_ERROR = 3.0
"""Counts by which the change of a second difference may be off: readings with the weights 1, −2, 2 and −1."""
OWN_MOTION = "motion"
"""Detail of a trip that comes from here, and not from the proof at the start."""


def bind_sign_watch(axis: AxisPlan, state: AxisState, period: float, trip: TripOff, render: PeriodStep) -> PeriodStep:
    """Return a step that renders and then watches the sign; `render` alone where it cannot be seen."""
    periods = _block(axis, period)
    return render if periods is None else SignWatch(axis, state, period, periods, trip).bind(render)


def _block(axis: AxisPlan, period: float) -> int | None:
    """Return the shortest block in which accelerations are seen [periods]; None where none is."""
    if axis.plant is None or not axis.plant.mass or virtual_mass(axis.elements) > HEAVIEST * axis.plant.mass:
        return None
    least = (WORST_ERROR * axis.plant.mass * axis.plant.resolution / (COARSENESS * axis.rated_effort)) ** 0.5
    periods = max(1, round(max(least, SHORTEST_BLOCK) / period + 0.49))
    return periods if periods * period <= LONGEST_BLOCK * (1.0 + 1e-9) else None


class SignWatch:
    """The sums of one axis."""

    def __init__(self, axis: AxisPlan, state: AxisState, period: float, periods: int, trip: TripOff) -> None:
        self.agreement = self.excitation = 0.0
        """S and N, in steps of target torque squared."""
        self._state, self._trip, self._periods = state, trip, periods
        length = periods * period
        mass = 0.0 if axis.plant is None else axis.plant.mass
        self._inertial = mass / length**2 / axis.effort_unit
        self._kept = math.exp(-length / MEMORY)
        strong = max(STRONG * axis.rated_effort, KNOCK[axis.workspace])
        self._strong = (strong / axis.effort_unit) ** 2
        self._places: deque[float] = deque(maxlen=5)
        """Of the handle at the begin of the last blocks."""
        self._torques: deque[float] = deque(maxlen=4)
        """Mean target torques of the last blocks."""

    def bind(self, render: PeriodStep) -> PeriodStep:
        """Return a step that renders, and adds up the torque of a block."""
        state, periods, block = self._state, self._periods, self._block
        total, left = 0, periods

        def look() -> None:
            nonlocal total, left
            render()
            if state.steps != 1:
                self._places.clear()
                total, left = 0, periods
            elif not left:
                block(total / periods)
                total, left = 0, periods
            total += state.target
            left -= 1

        return look

    def _block(self, torque: float) -> None:
        """Take the mean torque of the block that ends here, in steps, and compare."""
        self._torques.append(torque)
        self._places.append(self._state.position)
        if len(self._places) < 5 or self._state.permitted_ns is None:
            return
        oldest, old, _, late, last = self._places
        inertial = self._inertial * (last - 2.0 * late + 2.0 * old - oldest)
        first, second, third, fourth = self._torques
        change = 0.5 * (fourth + third - second - first)
        self.agreement = self._kept * self.agreement + inertial * change
        self.excitation = self._kept * self.excitation + change * change
        if self.excitation > self._strong and self.agreement < AGAINST * self.excitation:
            self._trip(TripKind.SIGN, self.agreement / self.excitation, AGAINST, OWN_MOTION)
