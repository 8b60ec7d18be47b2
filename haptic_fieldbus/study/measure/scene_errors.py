"""The force error of the shipped scenes on the simulated bench, split by source."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.study.measure.bench import Tools


@dataclass(frozen=True)
class Misfit:
    """One scene with its own hand; errors in N or N·m, None with the reason where it could not run."""

    scene: str
    rms: float | None = None
    max: float | None = None
    unit: str = "N"
    by_source: Mapping[str, float] = field(default_factory=dict)
    """Shares that sum to 1; negative where a source undoes another."""
    contact: float | None = None
    """rms error over rms force in contact."""
    energy: float | None = None
    """[J] that sampling put into the hand."""
    reason: str = ""


def scene_error(tools: Tools, scene: str, duration: float) -> Misfit:
    """Run it for `duration` [s] of virtual time."""
    try:
        result = tools.run(scene, duration=duration)
    except HapticFieldbusError as error:
        return Misfit(scene, reason=str(error).splitlines()[0])
    found = result.torque_error
    if found is None:
        return Misfit(scene, reason="too short to be judged")
    return Misfit(scene, found.rms, found.max, found.unit, found.by_source, found.contact, result.energy_generated)
