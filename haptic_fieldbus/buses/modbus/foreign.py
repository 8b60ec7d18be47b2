"""Signs of somebody else who commands our drives.

A Modbus drive cannot be listened to: on TCP nobody hears the connection of another master, and on RTU its frames are
heard only between ours. So two things are looked at:

- The registers. A drive that nobody commands has a target torque of 0, a command that does not enable, and a power
  stage that is off. Anything else is somebody's, be it a master that runs or one that died.
- Octets on a serial line that nobody was asked for. A request among them that writes to one of our units is a command
  of somebody else.

Reference: Modbus over serial line 1.02, 2.1: there is one master on a line.
"""

from collections.abc import Collection

from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU
from pymodbus.pdu.register_message import (
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

from haptic_fieldbus.buses.modbus.framing import REFUSED
from haptic_fieldbus.buses.modbus.requester import Requester
from haptic_fieldbus.buses.modbus.unit import UnitClient
from haptic_fieldbus.drive.power import ENERGISED, PowerState, PowerTable
from haptic_fieldbus.errors import ForeignMasterError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile

LISTENING = 0.5
"""Time for which a serial line is listened to before anything is sent [s]."""
EVERYBODY = 0
"""Unit id of a request that all units obey and none answers."""
ONE_MASTER = "A line has one master: end the other, and put axes that share a line into one rig"


def listen(requester: Requester, seconds: float = LISTENING) -> str:
    """Listen before anything is sent, and return a sentence about it; raises ForeignMasterError, BusError."""
    if not requester.transport.serial:
        return f"{requester.name}: another master cannot be heard on TCP, only the registers of a drive tell of one"
    heard = requester.listen(requester.clock.now_ns() + round(seconds * 1e9))
    if heard:
        raise ForeignMasterError(
            f"somebody else is on {requester.name}: within {exactly(seconds)} s came {len(heard)} octets although "
            f"nothing was asked. {ONE_MASTER}. If there is none, the line picks up noise: check terminators and bias. "
            "Nothing was sent"
        )
    return f"{requester.name}: listened for {exactly(seconds)} s, nothing sent; heard nothing"


def refuse_unrest(unit: UnitClient, profile: ModbusProfile, power: PowerTable, done: str) -> PowerState:
    """Return the power state of a drive that nobody commands; `done` tells how far we got.

    Raises ForeignMasterError when its registers say that somebody does, or BusError.
    """
    target = unit.optional(profile.torque.target) or 0
    if target:
        raise _commanded(unit, f"{profile.torque.target} (target torque) says {target}", done)
    command = unit.optional(profile.power.command) or power.off
    enabling = {power.answer(PowerState.SWITCHED_ON), power.answer(PowerState.OPERATION_ENABLED)} - {power.off}
    if command in enabling:
        raise _commanded(unit, f"{profile.power.command} (command) says {command:04X}h, which enables it", done)
    state = power.state(unit.read(profile.power.status))
    if state in ENERGISED:
        raise _commanded(unit, f"{profile.power.status} (status) says that it is in the state {state.value}", done)
    return state


def _commanded(unit: UnitClient, what: str, done: str) -> ForeignMasterError:
    return ForeignMasterError(
        f"{unit.label} is commanded by somebody else, or was left so by a master that died: {what}. {ONE_MASTER}. If "
        f"there is none any more, switch the power of the drive off and on. {done}"
    )


def foreign_write(octets: bytes, units: Collection[int]) -> int | None:
    """Return the address to which a request among these octets writes in one of our units; None without one."""
    decoder = DecodePDU(True)
    framer = FramerRTU(decoder)
    # Noise before a request may look like the begin of another one, so each octet is tried as the first.
    for at in range(len(octets) - framer.MIN_SIZE + 1):
        try:
            _, unit, _, body = framer.decode(octets[at:])
            pdu = decoder.decode(body) if body else None
        except REFUSED:
            continue
        if unit == EVERYBODY or unit in units:
            if isinstance(pdu, ReadWriteMultipleRegistersRequest):
                return pdu.write_address
            # FC6 comes back as it was sent, so a late answer of a drive would look like a request.
            if isinstance(pdu, WriteMultipleRegistersRequest):
                return pdu.address
    return None
