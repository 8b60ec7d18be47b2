"""The device of one axis, and the ranges in which its values may lie."""

import math
from dataclasses import asdict, dataclass, replace
from enum import Enum

import numpy as np

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.numerics import sampled
from haptic_fieldbus.numerics.linear import Matrix
from haptic_fieldbus.numerics.sampled import SampledPlant

# Open values: values that are known roughly, assumed, or different from period to period.
#
# The limit of a loop is the smallest over all values in these ranges (`limit`). The shipped bench is simulated with its
# values, so they are exact. A rig states its values. A share multiplies the value of the rig.
#
# | value            | range                | reason                                                    |
# |------------------|----------------------|-----------------------------------------------------------|
# | damping          | half to twice        | grease is several times stiffer in the cold               |
# | inertia          | 0.8 to 1.25          | taken from drawings, with another handle, another grip    |
# | Coulomb friction | half to twice        | changes along the way, with load and with wear            |
# | torque loop      | 0.3 to 2 if assumed  | 300 Hz to 2 kHz is what current loops of such drives have |
# |                  | 0.7 to 1.4 otherwise | its bandwidth depends on motor and tuning                 |
# | coupling         | half to twice        | a belt's tension, wear; data sheets tell it at rest       |
#
# The range of the delay is that of the protocol's traffic (`protocols.traffic.Delay`). What `identify` has measured has
# the ranges of its intervals (`planning.known_bench`).

Range = tuple[float, float]
"""Lowest and highest value."""

DAMPING_SHARES: Range = (0.5, 2.0)
INERTIA_SHARES: Range = (0.8, 1.25)
COULOMB_SHARES: Range = (0.5, 2.0)
COUPLING_SHARES: Range = (0.5, 2.0)
"""Shares of the stiffness of a compliant coupling between motor and load."""
ASSUMED_BANDWIDTH: Range = (0.3, 2.0)
"""Shares of a bandwidth that is assumed, without a source."""
SOURCED_BANDWIDTH: Range = (0.7, 1.4)
"""Shares of a bandwidth that the vendor or a measurement gives; it still depends on the motor."""


EXACT: Range = (1.0, 1.0)


class Basis(Enum):
    """Origin of the values of a bench; the value is the name in JSON."""

    SIMULATED = "simulated"
    """The shipped bench: the simulation has exactly these values."""
    STATED = "stated"
    """A rig, or numbers on the command line."""
    IDENTIFIED = "identified"
    """Measured by `identify`, in the rig."""


@dataclass(frozen=True)
class Ranges:
    """Ranges of one axis: shares of mass, damping, Coulomb friction and coupling; torque lag and delay in s."""

    torque_lag: Range
    delay: Range
    mass: Range = INERTIA_SHARES
    damping: Range = DAMPING_SHARES
    coulomb: Range = COULOMB_SHARES
    coupling: Range = EXACT
    """Shares of the stiffness of a compliant coupling; a rigid shaft has none to vary."""
    basis: Basis = Basis.STATED
    total: Range | None = None
    """Delay and lag together [s], where they were measured together; one is then as much shorter as the other is
    longer. None: each has its own range."""


def exact_bench(torque_lag: Range, delay: Range, basis: Basis) -> Ranges:
    """Return the ranges of a bench whose values are exact, apart from lag and delay [s]."""
    return Ranges(torque_lag, delay, EXACT, EXACT, EXACT, EXACT, basis)


# The device of one axis, and its exact discretisation under the delayed hold.


@dataclass(frozen=True)
class Plant:
    """Mass, damping, friction and resolution of one axis in its workspace: kg, N·s/m, N, m, or kg·m², N·m·s/rad, N·m,
    rad.

    Raises UsageError for a value that is not a finite number from 0 up, for a device with neither mass nor damping, and
    for a tachometer on a device without mass.
    """

    mass: float
    damping: float
    coulomb: float = 0.0
    resolution: float = 0.0
    """One encoder count; with a tachometer one step of the position that is integrated from its readings."""
    torque_lag: float = 0.0
    """Time constant of the torque loop [s]."""
    tachometer: bool = False
    """True when the velocity is sampled and the position integrated from it; False when the position is sampled."""

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not 0.0 <= value < math.inf:
                raise UsageError(f"{name} {value}: expected a number from 0 up")
        if not (self.mass or self.damping):
            raise UsageError("a device without mass needs damping")
        if self.tachometer and not self.mass:
            raise UsageError("a device without mass has no velocity for a tachometer")


def check_times(period: float, delay: float) -> None:
    """Check the times [s] of a loop; raises UsageError unless the period is above 0 and the delay from 0 up."""
    if not 0.0 < period < math.inf:
        raise UsageError(f"period {exactly(period)}: expected a time above 0 s")
    if not 0.0 <= delay < math.inf:
        raise UsageError(f"delay {exactly(delay)}: expected a time from 0 s up")


def dynamics(plant: Plant) -> tuple[Matrix, Matrix]:
    """Return (A, B) of ξ̇ = A ξ + B F with ξ = (position, velocity), or (position,) for a device without mass.

    Shapes: (n, n) and (n, 1).
    """
    if plant.mass:
        a = np.array([[0.0, 1.0], [0.0, -plant.damping / plant.mass]])
        return a, np.array([[0.0], [1.0 / plant.mass]])
    return np.zeros((1, 1)), np.array([[1.0 / plant.damping]])


def through_torque_loop(a: Matrix, b: Matrix, lag: float) -> tuple[Matrix, Matrix]:
    """Put a first-order torque loop with time constant `lag` [s] before a device; the motor's force is the last state.

    Return (A, B) of shapes (n + 1, n + 1) and (n + 1, 1), or `a` and `b` unchanged without a lag.
    """
    if not lag:
        return a, b
    order, rate = len(a), 1.0 / lag
    system = np.block([[a, b], [np.zeros((1, order)), np.full((1, 1), -rate)]])
    return system, np.vstack([np.zeros((order, 1)), np.full((1, 1), rate)])


def sample(plant: Plant, period: float, delay: float) -> SampledPlant:
    """Discretise the device under the delayed hold, `period` and `delay` in s; raises UsageError for impossible times.

    The states are position, velocity (with a mass), motor force (with a lag).
    """
    check_times(period, delay)
    device = sampled.sample(*through_torque_loop(*dynamics(plant), plant.torque_lag), period, delay)
    return sampled.integrated(device, period) if plant.tachometer else device


def weakened(plant: Plant, share: float = 0.7) -> Plant:
    """Return the same device with this share of its friction, because friction is rarely known more precisely."""
    return replace(plant, damping=share * plant.damping, coulomb=share * plant.coulomb)


def quantisation_limit(plant: Plant) -> float | None:
    """Return 2·fc/D, the stiffness up to which friction holds the handle between two counts; None without quantisation.

    With a step D every force is a multiple of K·D. A handle that is pushed by a force between two multiples rests only
    if friction bridges K·D/2 (Abbott & Okamura, IEEE Trans. Robotics 21(5), 2005, 952). The limit does not depend on T.
    """
    return 2.0 * plant.coulomb / plant.resolution if plant.resolution else None
