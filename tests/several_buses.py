"""Rigs whose axes are on several buses."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.protocols.canopen.bus import SIMULATION_INTERFACE, CanSection
from haptic_fieldbus.scenes.scene import Scene
from tests.builders import rig_of


def rig_on(
    scene: Scene,
    buses: Mapping[str, str],
    bitrates: Mapping[str, int] | None = None,
    interface: str = SIMULATION_INTERFACE,
    **changes: Any,
) -> Rig:
    """The shipped bench of a scene, each axis on the bus that `buses` says; bit rates by bus [bit/s]."""
    rates = dict.fromkeys(buses.values(), 1_000_000) | dict(bitrates or {})
    axes = {name: replace(axis, bus=buses[name]) for name, axis in rig_of(scene, **changes).axis.items()}
    return Rig({name: CanSection(interface, name, rate) for name, rate in rates.items()}, axes)
