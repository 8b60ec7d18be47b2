"""Names of the COB-IDs of CANopen's predefined connection set (CiA 301 7.3.5)."""

from haptic_fieldbus.protocols.canopen.bus import NODES

NMT_COB_ID = 0x000
EMCY_COB_ID = 0x080
SDO_RESPONSE_COB_ID = 0x580
SDO_REQUEST_COB_ID = 0x600
RPDO_COB_IDS = (0x200, 0x300, 0x400, 0x500)
"""Of RPDO 1 to 4 of node 0; those of a node have its node-ID added."""
FROM_A_NODE = (EMCY_COB_ID, 0x180, 0x280, 0x380, 0x480, SDO_RESPONSE_COB_ID, 0x700)
"""What only a node itself sends, of node 0."""
REMOTE = 0x8000
"""Bit that marks a remote frame, where a COB-ID is kept in 16 bits."""

BROADCASTS = {NMT_COB_ID: "NMT command", 0x080: "SYNC", 0x100: "time stamp", 0x7E4: "LSS answer", 0x7E5: "LSS request"}
SERVICES = {
    EMCY_COB_ID: "emergency of node",
    0x180: "TPDO1 of node",
    0x200: "set-point (RPDO1) for node",
    0x280: "TPDO2 of node",
    0x300: "set-point (RPDO2) for node",
    0x380: "TPDO3 of node",
    0x400: "set-point (RPDO3) for node",
    0x480: "TPDO4 of node",
    0x500: "set-point (RPDO4) for node",
    SDO_RESPONSE_COB_ID: "SDO answer of node",
    SDO_REQUEST_COB_ID: "SDO request to node",
    0x700: "heartbeat of node",
}


def cob_id_words(cob_id: int) -> str:
    """Return a COB-ID with its meaning: `SYNC (080h)`, `heartbeat of node 127 (77Fh)`; with `REMOTE`, of a request."""
    if cob_id & REMOTE:
        return f"node guarding request to node {cob_id & 0x7F} ({cob_id & ~REMOTE:03X}h)"
    name = BROADCASTS.get(cob_id)
    base, node = cob_id & 0x780, cob_id & 0x7F
    if name is None:
        name = f"{SERVICES[base]} {node}" if base in SERVICES and node in NODES else "frame"
    return f"{name} ({cob_id:03X}h)"
