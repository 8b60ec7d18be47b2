"""Simulated drives, mechanics, hands, faults and buses, in virtual or real time.

- `canopen`: drives on a simulated or a real CAN bus;
- `drive`: the drive itself, independent of any bus;
- `mechanics`: the motion of its shaft, followed exactly;
- `hand`: the hand on its handle; `faults`: the faults of drives and buses.

An import contract in pyproject.toml states the permitted imports between them.
"""

NEVER_NS = 1 << 62
"""A time later than every other time: no event is due."""
