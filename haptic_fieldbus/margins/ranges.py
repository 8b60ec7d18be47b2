"""Ranges in which the values of a bench may lie: assumed, known roughly, or different from period to period.

The limits of a loop are told for the values of rig and profile. Some of these are never exact, so a cautious limit is
told as well: the smallest over all values in these ranges (`cautious`). A share multiplies the value of the rig.

| value            | range                | reason                                                    |
|------------------|----------------------|-----------------------------------------------------------|
| damping          | half to twice        | grease is several times stiffer in the cold               |
| inertia          | 0.8 to 1.25          | taken from drawings, with another handle, another grip    |
| Coulomb friction | half to twice        | changes along the way, with load and with wear            |
| torque loop      | 0.3 to 2 if assumed  | 300 Hz to 2 kHz is what current loops of such drives have |
|                  | 0.7 to 1.4 otherwise | its bandwidth depends on motor and tuning                 |
| coupling         | half to twice        | a belt's tension, wear; data sheets tell it at rest       |

The range of the delay is that of the protocol's traffic (`protocols.traffic.Delay`).
"""

from dataclasses import dataclass

Range = tuple[float, float]
"""Lowest and highest value."""

DAMPING_SHARES: Range = (0.5, 2.0)
INERTIA_SHARES: Range = (0.8, 1.25)
COULOMB_SHARES: Range = (0.5, 2.0)
COUPLING_SHARES: Range = (0.5, 2.0)
"""Shares of the stiffness of a compliant coupling between motor and load."""
ASSUMED_BANDWIDTH: Range = (0.3, 2.0)
"""Shares of a bandwidth that no source gives."""
SOURCED_BANDWIDTH: Range = (0.7, 1.4)
"""Shares of a bandwidth that the vendor or a measurement gives; it still depends on the motor."""


@dataclass(frozen=True)
class Ranges:
    """Ranges of one axis: shares of mass, damping, Coulomb friction and coupling; torque lag and delay in s."""

    torque_lag: Range
    delay: Range
    mass: Range = INERTIA_SHARES
    damping: Range = DAMPING_SHARES
    coulomb: Range = COULOMB_SHARES
    coupling: Range = (1.0, 1.0)
    """Shares of the stiffness of a compliant coupling; a rigid shaft has none to vary."""


def exactly_timed(torque_lag: float, delay: float) -> Ranges:
    """Return the ranges of a device whose lag and delay [s] are exact."""
    return Ranges((torque_lag, torque_lag), (delay, delay))
