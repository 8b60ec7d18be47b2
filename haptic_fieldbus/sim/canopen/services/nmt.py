"""The NMT states of a CANopen slave, what leads to them, and which services work in which; tables without behaviour.

Reference: CiA 301 4.2, 7.2.8.3.1 (commands), 7.3.2 with table 38 (states and communication objects), 7.5.2.32 (1029h).
"""

from enum import Enum, auto


class NmtState(Enum):
    """The value is the state octet of the heartbeat; that of *initialising* is the boot-up message's."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class Service(Enum):
    """Kinds of communication objects."""

    NMT = auto()
    """Commands and error control."""
    SDO = auto()
    """Emergencies and TIME work in the same states."""
    PDO = auto()
    """SYNC likewise: it governs nothing else."""
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
"""In *initialising*, when there is no node-ID to go on with (CiA 305)."""

# 1029h:01 by the state before; codes and states that are not here change nothing.
AFTER_ERROR = {
    (0, NmtState.OPERATIONAL): NmtState.PRE_OPERATIONAL,
    (2, NmtState.OPERATIONAL): NmtState.STOPPED,
    (2, NmtState.PRE_OPERATIONAL): NmtState.STOPPED,
}
