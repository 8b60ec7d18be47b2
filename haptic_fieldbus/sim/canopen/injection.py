"""Application of each kind of fault to the simulated slave or to its bus."""

from typing import Protocol, assert_never

from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.agenda import Plan
from haptic_fieldbus.sim.canopen.slave import Slave
from haptic_fieldbus.sim.drive.broken import inject_drive, until


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


def inject(fault: faults.DriveFaultKind, slave: Slave, plan: Plan, t_ns: int) -> None:
    """Apply a fault of a drive that happens at `t_ns`."""
    match fault:
        case faults.Emergency(code=code):
            slave.error(code, t_ns)
        case faults.DriveFault():
            _inject_fault(fault, slave, plan, t_ns)
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
            inject_drive(fault, slave.drive, plan, t_ns)


def _inject_fault(fault: faults.DriveFault, slave: Slave, plan: Plan, t_ns: int) -> None:
    """Apply a fault that the drive detects, whose cause may last."""
    errors = slave.node.emergencies
    slave.drive.fault(fault.code, t_ns)
    if fault.duration == 0.0:
        return
    errors.raise_error(fault.code, fault)
    if fault.duration is not None:
        plan(until(t_ns, fault.duration), lambda _t_ns: errors.clear(fault.code, fault))


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
