"""The mechanics of a motor shaft, followed exactly between events: a rigid shaft, and the load that a rig may add."""
