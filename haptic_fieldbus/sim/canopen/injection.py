"""Application of each kind of fault to the simulated slave, to its bus, or to the hand."""

import math
from collections.abc import Callable, Iterable
from typing import Protocol, assert_never

from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.hand import Hand

Plan = Callable[[int, Callable[[int], None]], None]
"""Plan to call an action at an instant [ns], with that instant."""


class Line(Protocol):
    """The bus and the master's side of it, where faults take effect that are none of a drive."""

    def bus_off(self, t_ns: int, until_ns: int) -> None: ...

    def interface_down(self, t_ns: int, until_ns: int) -> None: ...

    def error_frame(self, t_ns: int) -> None: ...

    def disturb(self, fault: faults.Disturbance) -> None: ...

    def foreign_frame(self, can_id: int, data: bytes) -> None: ...

    def host_fault(self, fault: faults.HostFault) -> None: ...


def install_fault(fault: faults.LastingFault, slave: Slave) -> None:
    """Apply a fault that exists from power-on; call it before the slave is powered on."""
    match fault:
        case faults.MissingNode():
            slave.silent_until_ns = NEVER_NS
        case faults.WrongIdentity(vendor_id=vendor_id, product_code=product_code):
            for subindex, value in ((1, vendor_id), (2, product_code)):
                if value is not None:
                    entry = slave.drive.dictionary.find(0x1018, subindex)
                    # The default changes too, so that a reset of the node does not bring back the right identity.
                    entry.value = entry.default = value
        case faults.SdoRefusal(object=index, subindex=subindex, code=code):
            slave.node.sdo.refuse[index, subindex] = code
        case faults.DeadGuard(factor=factor):
            slave.node.slow_guards(factor)
        case _:
            assert_never(fault)


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


def inject(fault: faults.DriveFaultKind, slave: Slave, plan: Plan, t_ns: int) -> None:
    """Apply a fault of a drive that happens at `t_ns`."""
    match fault:
        case faults.Emergency(code=code):
            slave.error(code, t_ns)
        case faults.DriveFault():
            _inject_fault(fault, slave, plan, t_ns)
        case faults.SafeTorqueOff(duration=duration):
            slave.drive.sto(True, t_ns)
            if duration is not None:
                plan(until(t_ns, duration), lambda closed_ns: slave.drive.sto(False, closed_ns))
        case faults.NodeReset(duration=duration):
            slave.node.reset(t_ns, round(duration * 1e9))
        case faults.Silence(duration=duration):
            slave.silent_until_ns = max(slave.silent_until_ns, until(t_ns, duration))
        case faults.MissingTpdos(count=count):
            slave.node.process.skip_tpdos += count
        case faults.MissingRpdos(count=count):
            slave.node.lose_rpdos(count)
        case faults.SyncIgnored(count=count):
            slave.node.lose_syncs(count)
        case faults.HeartbeatLost():
            slave.node.heartbeat_enabled = False
        case faults.DuplicateNode():
            slave.duplicate()
        case _:
            _inject_motor(fault, slave, t_ns)


def _inject_fault(fault: faults.DriveFault, slave: Slave, plan: Plan, t_ns: int) -> None:
    """Apply a fault that the drive detects, whose cause may last."""
    errors = slave.node.emergencies
    slave.drive.fault(fault.code, t_ns)
    if fault.duration == 0.0:
        return
    errors.raise_error(fault.code, fault)
    if fault.duration is not None:
        plan(until(t_ns, fault.duration), lambda _t_ns: errors.clear(fault.code, fault))


def _inject_motor(fault: faults.DriveFaultKind, slave: Slave, t_ns: int) -> None:
    """Apply a fault of encoder or current loop."""
    # Bring the shaft up to date first: the encoder goes on from the counts of this instant.
    slave.drive.measure(t_ns)
    servo = slave.drive.servo
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
            servo.impair(share * slave.drive.objects.rated_torque)
        case faults.TorqueReversed():
            servo.impair(math.inf, -servo.torque_sign)
        case _:
            raise ValueError(f"{fault.kind} is no fault of encoder or current loop")


def inject_line(fault: faults.LineFault | faults.HostFault, line: Line, plan: Plan, t_ns: int) -> None:
    """Apply a fault of the bus or of the host that happens at `t_ns`."""
    match fault:
        case faults.BusOff(duration=duration):
            line.bus_off(t_ns, until(t_ns, duration))
        case faults.InterfaceDown(duration=duration):
            line.interface_down(t_ns, until(t_ns, duration))
        case faults.ErrorFrame():
            line.error_frame(t_ns)
        case faults.ForeignFrame(can_id=can_id, data=data, count=count, interval=interval):
            line.foreign_frame(can_id, bytes(data))
            if count > 1:
                rest = faults.ForeignFrame(fault.kind, fault.at, can_id, data, count - 1, interval)
                plan(until(t_ns, interval), lambda next_ns: inject_line(rest, line, plan, next_ns))
        case faults.HostLate() | faults.HostPaused() | faults.ClockStep() | faults.SlowCompute():
            line.host_fault(fault)
        case (
            faults.FrameDropped()
            | faults.FrameDelayed()
            | faults.FrameDuplicated()
            | faults.FrameWrongLength()
            | faults.FrameWrongNode()
        ):
            line.disturb(fault)
        case _:
            assert_never(fault)


def until(t_ns: int, duration: float | None) -> int:
    """Return the end [ns] of a fault that begins at `t_ns`."""
    return NEVER_NS if duration is None else t_ns + round(duration * 1e9)
