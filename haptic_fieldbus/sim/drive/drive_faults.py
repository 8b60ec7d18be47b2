"""Application of the faults that a drive has on any bus: encoder, current loop, safe torque off; and of the hand."""

import math
from collections.abc import Iterable

from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.schedule import Plan


def faulty_hand(hand: Hand | None, these: Iterable[faults.Fault]) -> Hand | None:
    """Return the hand that lets go and hits as these faults say; a hand that is not there does neither."""
    if hand is None:
        return None
    for fault in these:
        match fault:
            case faults.HandRelease(at=at):
                hand = hand.letting_go(at)
            case faults.HandHit(at=at, force=force, duration=duration):
                hand = hand.hitting(at, force, duration)
    return hand


def inject_drive(fault: faults.DriveFaultKind, drive: Drive, plan: Plan, t_ns: int) -> None:
    """Apply a fault that happens at `t_ns`; raises ValueError for one that is a fault of the link."""
    if isinstance(fault, faults.SafeTorqueOff):
        drive.sto(True, t_ns)
        if fault.duration is not None:
            plan(until(t_ns, fault.duration), lambda closed_ns: drive.sto(False, closed_ns))
        return
    # Bring the shaft up to date first: the encoder goes on from the counts of this instant.
    drive.measure(t_ns)
    servo = drive.servo
    match fault:
        case faults.EncoderJump(counts=counts):
            servo.jump(counts)
        case faults.PositionStuck(duration=duration):
            servo.stuck_until_ns = max(servo.stuck_until_ns, until(t_ns, duration))
        case faults.EncoderScaling(factor=factor):
            servo.rescale(factor)
        case faults.EncoderReversed():
            servo.rescale(-1.0)
        case faults.TorqueDead():
            servo.impair(0.0)
        case faults.TorqueSaturated(share=share):
            servo.impair(share * drive.objects.rated_torque)
        case faults.TorqueReversed():
            servo.impair(math.inf, -servo.torque_sign)
        case _:
            raise ValueError(f"{fault.kind} is no fault of encoder or current loop")


def until(t_ns: int, duration: float | None) -> int:
    """Return the end [ns] of a fault that begins at `t_ns`."""
    return NEVER_NS if duration is None else t_ns + round(duration * 1e9)
