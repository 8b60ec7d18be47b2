"""Servo drives as haptic interfaces: virtual walls, springs and masses, rendered over CANopen.

>>> import haptic_fieldbus
>>> result = haptic_fieldbus.run("wall", duration=1.0)
>>> result.missed_cycles
0

Names are imported when they are first used, so that `import haptic_fieldbus` costs nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from haptic_fieldbus.api import plan, repeat, response, run, stability
    from haptic_fieldbus.api.open_loop import Response
    from haptic_fieldbus.api.replaying import FirstDifference, compare_recording
    from haptic_fieldbus.api.session import LiveSession, session
    from haptic_fieldbus.api.sweep_folder import Sweep
    from haptic_fieldbus.api.sweeping import sweep
    from haptic_fieldbus.assessing.result import Result
    from haptic_fieldbus.drive.rig import Limits, LinearMechanism, Rig, RigAxis, RotaryMechanism
    from haptic_fieldbus.errors import (
        BusConfigurationError,
        BusError,
        BusOverloadError,
        BusTimeoutError,
        DocumentError,
        DriveFaultError,
        EdsError,
        FaultFileError,
        ForeignMasterError,
        HapticFieldbusError,
        ImageTooLargeError,
        PlanError,
        ProfileError,
        RigError,
        SafetyTripError,
        SceneError,
        SignalUnavailableError,
        UnprovedGuardError,
        UnstableSceneError,
        UsageError,
        VcanError,
    )
    from haptic_fieldbus.margins.verdict import Stability, Verdict
    from haptic_fieldbus.planning.plan import Plan
    from haptic_fieldbus.protocols.canopen.bus import CanSection
    from haptic_fieldbus.protocols.catalogue import load_profile, load_rig
    from haptic_fieldbus.recordings.provenance import Provenance
    from haptic_fieldbus.recordings.reading import RecordedRun, read_provenance, read_recording
    from haptic_fieldbus.running.changes import Changes
    from haptic_fieldbus.scenes.catalogue import load_scene
    from haptic_fieldbus.scenes.scene import Scene, SceneAxis
    from haptic_fieldbus.signals import Signal, Workspace

_HOMES = {
    "haptic_fieldbus.api": "plan repeat response run stability",
    "haptic_fieldbus.api.open_loop": "Response",
    "haptic_fieldbus.api.session": "LiveSession session",
    "haptic_fieldbus.api.sweep_folder": "Sweep",
    "haptic_fieldbus.api.sweeping": "sweep",
    "haptic_fieldbus.assessing.result": "Result",
    "haptic_fieldbus.drive.rig": "Limits LinearMechanism Rig RigAxis RotaryMechanism",
    "haptic_fieldbus.margins.verdict": "Stability Verdict",
    "haptic_fieldbus.planning.plan": "Plan",
    "haptic_fieldbus.protocols.canopen.bus": "CanSection",
    "haptic_fieldbus.protocols.catalogue": "load_profile load_rig",
    "haptic_fieldbus.api.replaying": "FirstDifference compare_recording",
    "haptic_fieldbus.recordings.provenance": "Provenance",
    "haptic_fieldbus.recordings.reading": "RecordedRun read_provenance read_recording",
    "haptic_fieldbus.running.changes": "Changes",
    "haptic_fieldbus.scenes.catalogue": "load_scene",
    "haptic_fieldbus.scenes.scene": "Scene SceneAxis",
    "haptic_fieldbus.signals": "Signal Workspace",
}
"""The public names by their module; names that are missing here are in `errors`."""

__all__ = [
    "BusConfigurationError", "BusError", "BusOverloadError", "BusTimeoutError", "CanSection", "Changes",
    "DocumentError", "DriveFaultError", "EdsError", "FaultFileError", "FirstDifference", "ForeignMasterError",
    "HapticFieldbusError", "ImageTooLargeError", "Limits", "LinearMechanism", "LiveSession", "Plan", "PlanError",
    "ProfileError", "Provenance", "RecordedRun", "Response", "Result", "Rig", "RigAxis", "RigError",
    "RotaryMechanism", "SafetyTripError", "Scene", "SceneAxis", "SceneError", "Signal", "SignalUnavailableError",
    "Stability", "Sweep", "UnprovedGuardError", "UnstableSceneError", "UsageError", "VcanError", "Verdict",
    "Workspace", "compare_recording", "load_profile", "load_rig", "load_scene", "plan", "read_provenance",
    "read_recording", "repeat", "response", "run", "session", "stability", "sweep",
]  # fmt: skip


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = next((module for module, names in _HOMES.items() if name in names.split()), "haptic_fieldbus.errors")
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return __all__
