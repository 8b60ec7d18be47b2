"""What an encoder step asks of friction: the limit of Abbott & Okamura and the plane of Diolaiti et al.

With a step D every force is a multiple of K·D; a handle pushed by a force between two multiples rests only if friction
bridges K·D/2, K ≤ 2·fc/D (Abbott & Okamura, IEEE Trans. Robotics 21(5), 2005, 952). The bound has no T.
"""

from enum import Enum

from haptic_fieldbus.margins.plant import Plant


def quantisation_limit(plant: Plant) -> float | None:
    """2·fc/D: the stiffness up to which friction holds the handle between two counts; None without quantisation."""
    return 2.0 * plant.coulomb / plant.resolution if plant.resolution else None


class Region(Enum):
    """Where a wall without delay and virtual damping lies in the plane β = b/(K·T), σ = fc/(K·D).

    Diolaiti, Niemeyer, Barbagli, Salisbury, IEEE Trans. Robotics 22(2), 2006, 256, doi:10.1109/TRO.2005.862487.
    """

    PASSIVE = "passive"
    LOCALLY_STABLE = "locally stable"
    """Small motions stick, large ones may grow: friction takes less of them than the sampled spring gives."""
    LIMIT_CYCLE = "limit cycle"
    UNSTABLE = "unstable"


REGIONS = {
    (True, True): Region.PASSIVE,
    (False, True): Region.LOCALLY_STABLE,
    (True, False): Region.LIMIT_CYCLE,
    (False, False): Region.UNSTABLE,
}
"""(viscous damping takes what the hold gives, friction bridges a count) → region."""


def region(plant: Plant, period: float, stiffness: float) -> Region:
    """β ≥ ½ and σ ≥ ½ are the borders."""
    return REGIONS[
        plant.damping >= 0.5 * stiffness * period,
        plant.coulomb >= 0.5 * stiffness * plant.resolution,
    ]
