"""What one axis of a running plan remembers between periods, and what others may ask of it."""

from dataclasses import dataclass

from haptic_fieldbus.drive.power import PowerState


@dataclass(slots=True)
class AxisState:
    """What one axis remembers between periods, and others may ask."""

    power: PowerState = PowerState.UNKNOWN
    controlword: int = 0
    stale_periods: int = 0
    periods_apart: int = 1
    """Between this feedback and the one before."""
    settled: bool = True
    """Whether both this feedback and the one before are fresh."""
    gain: float = 1.0
    zero_counts: int | None = None
    """Encoder counts where the position is 0; None before the first rendered period, and where there is no encoder."""
    begun: bool = False
    """Whether the first rendered period has been."""
    began_ns: int = 0
    position: float = 0.0
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
