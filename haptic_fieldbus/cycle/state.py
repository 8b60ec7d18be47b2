"""Memory of one axis of a running plan, which the cycle and its couplings read too."""

from dataclasses import dataclass

from haptic_fieldbus.drive.power import PowerState


@dataclass(slots=True)
class AxisState:
    """Values that an axis keeps from one period to the next."""

    power: PowerState = PowerState.UNKNOWN
    controlword: int = 0
    missing: int = 0
    """Periods in a row without new feedback, this one included."""
    holding: int = 0
    """The same of the axis that has missed most, among those that couplings tie to this one."""
    steps: int = 1
    """Periods that lie between this feedback and the one before; 0 where this period has none."""
    gain: float = 1.0
    """Share of the held force in a period without feedback."""
    zero_counts: int | None = None
    """Encoder count at which the position is 0; None before the first rendered period, and without an encoder."""
    begun: bool = False
    """Whether the first rendered period has passed."""
    began_ns: int = 0
    permitted_ns: int | None = None
    """When force began to rise to its limit; None while the sign from torque to motion has not been seen."""
    moved_ns: int = 0
    """When the position changed last."""
    position: float = 0.0
    way: float = 0.0
    """Of the last period [m or rad]."""
    drift: float = 0.0
    """Bound on the error of the position [m or rad]; 0 unless the position is integrated from a velocity."""
    force: float = 0.0
    """Force of the scene, before any limit [N or N·m]."""
    remembered: float = 0.0
    """Of it the force of elements with a memory, where there are others beside them [N or N·m]."""
    led_work: float = 0.0
    led_force: float = 0.0
    """Work and last force of the scene's law on the straight line on which it was led through periods without a
    sample [J; N or N·m]."""
    target: int = 0
    """Target torque in steps of the drive, without the sign of the mechanism."""


@dataclass(slots=True)
class Sensed:
    """Signals of one axis beside its position, and the force that couplings add to it."""

    velocity: float = 0.0
    """[m/s or rad/s]"""
    torque_actual: float = 0.0
    """[N or N·m], in the workspace."""
    elapsed_ns: int = 0
    """Time since the first rendered period."""
    coupled: float = 0.0
    """Force of all couplings on this axis [N or N·m]."""
    damped: float = 0.0
    """Force of the passivity controller [N or N·m]."""
