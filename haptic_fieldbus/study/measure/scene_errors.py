"""Force error of the shipped scenes on the simulated bench, split by source."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.study.measure.bench import Tools


@dataclass(frozen=True)
class Misfit:
    """Force error of one scene with a hand [N or N·m]; None, and the reason, when it was not measured."""

    scene: str
    rms: float | None = None
    max: float | None = None
    unit: str = "N"
    by_source: Mapping[str, float] = field(default_factory=dict)
    """Shares that sum to 1; negative where a source compensates another one."""
    contact: float | None = None
    """Rms error over rms force in moving contact; None without any."""
    contact_s: float = 0.0
    """Time of moving contact [s]."""
    energy: float | None = None
    """Energy that the error put into the hand [J]."""
    reason: str = ""


def scene_error(tools: Tools, scene: str, duration: float, hand: str | None = None) -> Misfit:
    """Run a scene for `duration` [s] of virtual time, and return its error; a run that fails becomes a reason.

    The hand is that of the scene unless another is named.
    """
    try:
        result = tools.run(scene, duration=duration, hand=hand)
    except HapticFieldbusError as error:
        return Misfit(scene, reason=str(error).splitlines()[0])
    found = result.torque_error
    if found is None:
        return Misfit(scene, reason="too short to be judged")
    return Misfit(
        scene, found.rms, found.max, found.unit, found.by_source, found.contact, found.contact_s,
        result.energy_generated,
    )  # fmt: skip
