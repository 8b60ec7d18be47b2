"""How each kind of fault reaches the simulated drive or the master's controller."""

from typing import Protocol, assert_never

from haptic_fieldbus.sim.drive import Drive
from haptic_fieldbus.sim.faults import (
    BusOff,
    DriveFault,
    Emergency,
    EncoderJump,
    ErrorFrame,
    HeartbeatLost,
    LastingFault,
    MissingNode,
    MissingTpdos,
    NodeReset,
    PositionStuck,
    SdoRefusal,
    Silence,
    TimedFault,
    WrongIdentity,
)
from haptic_fieldbus.sim.link.wire import NEVER_NS


class Line(Protocol):
    """The master's side of the bus."""

    def bus_off(self, t_ns: int, until_ns: int) -> None: ...

    def error_frame(self, t_ns: int) -> None: ...


def install(fault: LastingFault, drive: Drive) -> None:
    """A fault that is there from power-on; before the drive is powered."""
    match fault:
        case MissingNode():
            drive.silent_until_ns = NEVER_NS
        case WrongIdentity(vendor_id=vendor_id, product_code=product_code):
            for subindex, value in ((1, vendor_id), (2, product_code)):
                if value is not None:
                    entry = drive.dictionary.find(0x1018, subindex)
                    entry.value = entry.default = value
        case SdoRefusal(object=index, subindex=subindex, code=code):
            drive.node.sdo.refuse[index, subindex] = code
        case _:
            assert_never(fault)


def inject(fault: TimedFault, drive: Drive, line: Line, t_ns: int) -> None:
    """A fault that happens now."""
    match fault:
        case Emergency(code=code):
            drive.node.now_ns = t_ns
            drive.node.emergencies.raise_error(code)
        case DriveFault(code=code):
            drive.fault(code, t_ns)
        case NodeReset(duration=duration):
            drive.node.reset(t_ns, round(duration * 1e9))
        case Silence(duration=duration):
            drive.silent_until_ns = _until(t_ns, duration)
        case MissingTpdos(count=count):
            drive.node.process.skip_tpdos += count
        case HeartbeatLost():
            drive.node.heartbeat_enabled = False
        case EncoderJump(counts=counts):
            drive.servo.jump(counts)
        case PositionStuck(duration=duration):
            drive.measure(t_ns)
            drive.servo.stuck_until_ns = _until(t_ns, duration)
        case BusOff(duration=duration):
            line.bus_off(t_ns, _until(t_ns, duration))
        case ErrorFrame():
            line.error_frame(t_ns)
        case _:
            assert_never(fault)


def _until(t_ns: int, duration: float | None) -> int:
    return NEVER_NS if duration is None else t_ns + round(duration * 1e9)
