"""What one axis of a running plan remembers between periods, and what others may ask of it."""

from dataclasses import dataclass

from haptic_fieldbus.drive.power import PowerState


@dataclass(slots=True)
class AxisState:
    """What one axis remembers between periods, and others may ask."""

    power: PowerState = PowerState.UNKNOWN
    controlword: int = 0
    missing: int = 0
    """Periods in a row without new feedback, this one included."""
    steps: int = 1
    """Periods that lie between this feedback and the one before; 0 where this period has none."""
    gain: float = 1.0
    """Share of the held force in a period without feedback."""
    zero_counts: int | None = None
    began_ns: int = 0
    moved_ns: int = 0
    """When the position changed last."""
    position: float = 0.0
    way: float = 0.0
    """Of the last period [m or rad]."""
    drift: float = 0.0
    """How far the position may be off [m or rad]; only a position that is integrated is."""
    force: float = 0.0
    target: int = 0


@dataclass(slots=True)
class Sensed:
    """Feedback of one axis beside its position, and what couplings add to its force."""

    velocity: float = 0.0
    """[m/s or rad/s]"""
    torque_actual: float = 0.0
    """[N or N·m], in the workspace."""
    elapsed_ns: int = 0
    coupled: float = 0.0
    """Force of all couplings on this axis [N or N·m]."""
