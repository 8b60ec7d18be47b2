"""Requests of a caller as they were given: nothing is loaded or checked yet.

Requests with further arguments extend these classes, so that each argument and its default stand in one place.
"""

from collections.abc import Mapping
from dataclasses import KW_ONLY, dataclass
from pathlib import Path

from haptic_fieldbus.defaults import DEFAULT_NODE
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.scenes.catalogue import Setting
from haptic_fieldbus.scenes.scene import Scene


@dataclass(frozen=True)
class Rendering:
    """A scene and how it is rendered, on any bench."""

    scene: str | Path | Scene
    """A name of the library, a file, or a scene made in Python."""
    _: KW_ONLY
    rate: float | None = None
    """Periods a second [Hz]; None: 1000 Hz, and on a bus that is slower the highest rate that it sustains."""
    settings: Mapping[str, Setting] | None = None
    """Parameters of the scene, such as {"wall.stiffness": 800.0}, "0.8 N/mm" or "max/2"."""
    method: str | None = None
    """Integrator of virtual states, by name."""
    estimator: str | None = None
    """Velocity estimator, by name."""


@dataclass(frozen=True)
class Task(Rendering):
    """A scene to render on a bench: the shipped one, or that of a rig.

    A rig replaces `drive` and `node`. A `bus` that is given replaces the buses of the rig.
    """

    rig: str | Path | Rig | None = None
    """A file or a Rig; None is the shipped bench, with one drive for each axis of the scene."""
    _: KW_ONLY
    drive: str | None = None
    """Profile of the shipped bench, by name or path; None: that which the protocol of the bus names."""
    bus: str | None = None
    """sim[@BITRATE] or INTERFACE:CHANNEL[@BITRATE]; None is the simulation, or the buses of the rig."""
    node: int = DEFAULT_NODE
    """Node-ID of the first axis of the shipped bench; the others count from it."""
    axes: Mapping[str, str] | None = None
    """Names of the rig for axes of the scene, {"knob": "handle"}; an axis that is not named here has its own."""
    zero: str | None = None
    """"here": positions count from where the handle is when the drive is enabled, whatever the rig says; or None."""
    profiles: str | Path | None = None
    """Folder of one's own profiles, beside the shipped ones; None is HAPTIC_FIELDBUS_PROFILES of the environment."""
