"""The mechanics of a motor shaft, followed exactly between events: a rigid shaft, and the load that a rig may add."""

from haptic_fieldbus.sim.mechanics.motion import Shaft as Shaft
from haptic_fieldbus.sim.mechanics.plant import Plant as Plant
