"""The force error of the shipped scenes on the simulated bench, split by source."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.report.measure.bench import Tools


@dataclass(frozen=True)
class SceneError:
    """One scene with its own hand; errors in N or N·m, None with the reason where it could not run."""

    scene: str
    rms: float | None
    max: float | None
    unit: str
    by_source: Mapping[str, float]
    """Shares that sum to 1; negative where a source undoes another."""
    contact: float | None
    """rms error over rms force in contact."""
    energy: float | None
    """[J] that sampling put into the hand."""
    reason: str = ""


def scene_errors(tools: Tools, scenes: Sequence[str], duration: float) -> Iterator[SceneError]:
    """Run each for `duration` [s] of virtual time."""
    for scene in scenes:
        try:
            result = tools.run(scene, duration=duration)
        except HapticFieldbusError as error:
            yield SceneError(scene, None, None, "N", {}, None, None, str(error).splitlines()[0])
            continue
        found = result.torque_error
        if found is None:
            yield SceneError(scene, None, None, "N", {}, None, None, "too short to be judged")
        else:
            yield SceneError(
                scene, found.rms, found.max, found.unit, found.by_source, found.contact, result.energy_generated
            )
