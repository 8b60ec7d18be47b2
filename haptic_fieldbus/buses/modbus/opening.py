"""Opening the line of a rig: a connection or a serial port."""

from haptic_fieldbus.buses.modbus.serial_port import SerialTransport
from haptic_fieldbus.buses.modbus.tcp import TcpTransport
from haptic_fieldbus.buses.modbus.transport import Transport
from haptic_fieldbus.clock import Clock
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.protocols.modbus.bus import ModbusSection


def open_line(section: ModbusSection, clock: Clock) -> Transport:
    """Open a real line; raises BusError when it cannot be opened, UsageError for one that is simulated."""
    name = f"{section.interface}:{section.channel}"
    if section.simulated:
        raise UsageError(f"{section.interface} exists in a simulated run alone; real are modbus-tcp and modbus-rtu")
    if not section.serial:
        return TcpTransport(name, section.address, clock)
    return SerialTransport(name, section.channel, clock)
