"""Faults of a drive on any bus (encoder, current loop, safe torque off), faults of the hand, and their schedule."""

import math
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from types import UnionType

from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.drive.core import Drive
from haptic_fieldbus.sim.drive.settings import DriveSettings, drawn_settings
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.schedule import Action, FaultSchedule, Plan, TimedFault, TimerQueue


def faulty_hand(hand: Hand | None, these: Iterable[faults.Fault]) -> Hand | None:
    """Return the hand with the releases and hits of these faults; None stays None."""
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
    """Apply a fault that happens at `t_ns`; raises ValueError for a fault of the link."""
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


class DriveBench:
    """Parts that the simulated drives of a bus share: seed, planned actions and the schedule of their faults.

    At least the `longest` latest segments of the true motion of each drive are kept, None: all.
    """

    def __init__(self, seed: int | str, longest: int | None) -> None:
        self.agenda = TimerQueue()
        self._seed, self._longest = seed, longest
        self._schedule = FaultSchedule(self.agenda.plan)

    def drawn(self, slot: DriveOnBus) -> tuple[DriveSettings, Hand | None]:
        """Return the settings of a drive, as drawn from the seed, and the hand on its handle with its faults."""
        settings = replace(drawn_settings(self._seed, slot.node), position=slot.position, velocity=slot.velocity)
        return settings, faulty_hand(slot.hand, faults.faults_of(slot.faults, slot.node))

    def follow(
        self,
        drive: Drive,
        slot: DriveOnBus,
        of_line: UnionType | type[object],
        install: Callable[[faults.LastingFault], None],
        action: Callable[[TimedFault], Action],
    ) -> None:
        """Install the faults of a drive that exist from power-on, and schedule the others from *operation enabled* on.

        The faults `of_line` concern every drive, regardless of their node; `action` returns the effect of a fault.
        """
        drive.plant.recorder.longest = self._longest
        timed: list[TimedFault] = []
        for fault in slot.faults:
            if not isinstance(fault, of_line) and fault.node not in (None, slot.node):
                continue
            if isinstance(fault, faults.LastingFault):
                install(fault)
            elif not isinstance(fault, faults.HandFault):
                timed.append(fault)
        drive.on_enabled = partial(self._schedule.begin, timed, slot.node, action)
        drive.on_freed = lambda _t_ns: self._schedule.freed(slot.node)

    def plan_fault(self, fault: TimedFault, action: Action, t_ns: int) -> None:
        """Plan a fault whose `at` counts from `t_ns`."""
        self.agenda.plan(t_ns + round(fault.at * 1e9), action)
