"""The NMT states of a CANopen slave, their commands and their services, as tables without behaviour.

Reference: CiA 301 4.2, 7.2.8.3.1 (commands), 7.3.2 with table 38 (states and communication objects), 7.5.2.32 (1029h).
"""

from enum import Enum, auto


class NmtState(Enum):
    """NMT states; the value is the state octet of the heartbeat, for *initialising* that of the boot-up message."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class Service(Enum):
    """Kinds of communication objects that work in the same states."""

    NMT = auto()
    """Module control and error control."""
    SDO = auto()
    """SDO, EMCY and TIME."""
    PDO = auto()
    """PDO and SYNC, which acts only on PDOs."""
    LSS = auto()


COMMANDED = {1: NmtState.OPERATIONAL, 2: NmtState.STOPPED, 128: NmtState.PRE_OPERATIONAL}
RESET_NODE, RESET_COMMUNICATION = 129, 130

WORKING = {
    NmtState.INITIALISING: frozenset[Service](),
    NmtState.PRE_OPERATIONAL: frozenset({Service.NMT, Service.SDO, Service.LSS}),
    NmtState.OPERATIONAL: frozenset({Service.NMT, Service.SDO, Service.PDO}),
    NmtState.STOPPED: frozenset({Service.NMT, Service.LSS}),
}
WITHOUT_NODE_ID = frozenset({Service.LSS})
"""Services in *initialising* while the node has no node-ID (CiA 305)."""

# New state by 1029h:01 and the state before the error; other combinations change nothing.
AFTER_ERROR = {
    (0, NmtState.OPERATIONAL): NmtState.PRE_OPERATIONAL,
    (2, NmtState.OPERATIONAL): NmtState.STOPPED,
    (2, NmtState.PRE_OPERATIONAL): NmtState.STOPPED,
}
