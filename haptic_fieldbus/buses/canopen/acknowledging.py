"""Clearing of the fault into which a drive goes when it has lost its master, after its guard was proved.

Nothing else clears a fault, and this one only by its error code: a fault that came for another reason in the same time
stays, and is told.

Reference: CiA 301 7.2.7.1 (8130h, life guard or heartbeat error); IEC 61800-7-201 (CiA 402-2), 603Fh, 6040h bit 7.
"""

from haptic_fieldbus.buses.canopen.node import NmtState, Node
from haptic_fieldbus.buses.canopen.setup import CONTROLWORD, ERROR_CODE, POLL_NS, STATUSWORD
from haptic_fieldbus.drive.power import PowerState
from haptic_fieldbus.errors import BusConfigurationError, BusTimeoutError, DriveFaultError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.emergency import emergency_meaning
from haptic_fieldbus.protocols.cia402 import CIA402, DISABLE_VOLTAGE

LOST_MASTER = 0x8130
NO_CODE = 0
"""603Fh of a drive that has no code for it, or lacks the object."""
FAULT_RESET = 0x80
"""Controlword; its bit 7 acts when it rises."""
CLEARED_WITHIN = 0.5
"""Time that a drive has to leave *fault* [s]."""
ANSWER_TIMEOUT = 0.01
"""[s]; so long an answer is waited for in the middle of an exchange."""


def asked_statusword(node: Node) -> int | None:
    """Upload 6041h; None without an answer in `ANSWER_TIMEOUT`. Raises BusError only when the bus itself is dead.

    A node without an answer is told to go pre-operational: a stopped one, as a lost master may make it (1029h), serves
    no SDO requests.
    """
    try:
        return node.read(STATUSWORD, ANSWER_TIMEOUT)
    except BusTimeoutError:
        node.command(NmtState.PRE_OPERATIONAL)
    except BusConfigurationError:
        pass  # refused, or garbled: no answer either
    return None


def acknowledge(node: Node) -> None:
    """Clear the fault of a drive that lost its master; raises DriveFaultError for another fault, or BusError."""
    node.take_answers()
    if node.emergency == LOST_MASTER:
        node.emergency = 0
    if not _faulted(node):
        return
    code = _error_code(node)
    if code not in (LOST_MASTER, NO_CODE):
        raise DriveFaultError(
            f"{node.label} went to fault while it was left alone, and not because it lost its master: error code "
            f"{code:04X}h ({emergency_meaning(code)}). Nothing was cleared"
        )
    for controlword in (DISABLE_VOLTAGE, FAULT_RESET, DISABLE_VOLTAGE):
        node.send(CONTROLWORD, controlword)
    deadline_ns = node.now_ns() + round(CLEARED_WITHIN * 1e9)
    while _faulted(node):
        if node.now_ns() >= deadline_ns:
            raise DriveFaultError(
                f"{node.label} stays in fault {exactly(CLEARED_WITHIN)} s after its lost master was acknowledged "
                "(6040h = 80h): switch it off and on, and check its link"
            )
        node.wait(POLL_NS)


def _faulted(node: Node) -> bool:
    return CIA402.state(node.read(STATUSWORD)) in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE)


def _error_code(node: Node) -> int:
    """Read 603Fh; without it, the code of the last emergency."""
    try:
        return node.read(ERROR_CODE)
    except BusConfigurationError:
        return node.emergency or NO_CODE
