"""A simulated world in virtual time: drives, mechanics, hands, faults, wires.

- `canopen`: drives on a simulated or a real CAN bus;
- `drive`: the drive itself, which knows no bus;
- `mechanics`: the motion of its shaft, followed exactly;
- `hand`: who holds on to it; `faults`: what befalls it.

An import contract in pyproject.toml says which may import which.
"""

NEVER_NS = 1 << 62
"""Later than everything."""
