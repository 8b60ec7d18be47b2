"""Application of each kind of fault to the simulated slave or to the master's controller."""

from typing import Protocol, assert_never

from haptic_fieldbus.sim import NEVER_NS, faults
from haptic_fieldbus.sim.canopen.slave import Slave


class Line(Protocol):
    """The master's side of the bus, where faults of its controller take effect."""

    def bus_off(self, t_ns: int, until_ns: int) -> None: ...

    def error_frame(self, t_ns: int) -> None: ...


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


def inject(fault: faults.TimedFault, slave: Slave, line: Line, t_ns: int) -> None:
    """Apply a fault that happens at `t_ns`."""
    match fault:
        case faults.Emergency(code=code):
            slave.error(code, t_ns)
        case faults.DriveFault(code=code):
            slave.drive.fault(code, t_ns)
        case faults.NodeReset(duration=duration):
            slave.node.reset(t_ns, round(duration * 1e9))
        case faults.Silence(duration=duration):
            slave.silent_until_ns = _until(t_ns, duration)
        case faults.MissingTpdos(count=count):
            slave.node.process.skip_tpdos += count
        case faults.MissingRpdos(count=count):
            slave.node.lose_rpdos(count)
        case faults.HeartbeatLost():
            slave.node.heartbeat_enabled = False
        case faults.EncoderJump(counts=counts):
            slave.drive.servo.jump(counts)
        case faults.PositionStuck(duration=duration):
            # Bring the counts up to date first: the encoder keeps showing those of this instant.
            slave.drive.measure(t_ns)
            slave.drive.servo.stuck_until_ns = _until(t_ns, duration)
        case faults.BusOff(duration=duration):
            line.bus_off(t_ns, _until(t_ns, duration))
        case faults.ErrorFrame():
            line.error_frame(t_ns)
        case _:
            assert_never(fault)


def _until(t_ns: int, duration: float | None) -> int:
    return NEVER_NS if duration is None else t_ns + round(duration * 1e9)
