"""CiA 301, 7.2.2 and 7.5.2.35 to 7.5.2.38: PDOs; 7.2.5: SYNC."""

from tests.sim.canopen.clauses.script import Clause

_TPDO = """
        w 1800:01 u32 {id} = ok
        w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x60600008 = ok
        w 1A00:02 u32 0x10010008 = ok
        w 1A00:00 u8 2 = ok
        w 1800:02 u8 {type} = ok
"""
_RPDO = """
        w 1400:01 u32 0x80000205 = ok
        w 1600:00 u8 0 = ok
        w 1600:01 u32 0x60C20108 = ok
        w 1600:00 u8 1 = ok
        w 1400:02 u8 {type} = ok
        w 1400:01 u32 0x205 = ok
"""
_NO_TPDO = "w 1800:01 u32 0x80000185 = ok\n"


def tpdo(type_: int, script: str, *, rtr: bool = False, before: str = "") -> str:
    """TPDO1 of modes of operation and error register, then *operational*."""
    bits = 0 if rtr else 1 << 30
    setting = _TPDO.format(id=hex(1 << 31 | 0x185), type=type_) + before
    return f"{setting}\nw 1800:01 u32 {hex(bits | 0x185)} = ok\n> 000 01 05\n{script}"


def rpdo(type_: int, script: str, *, before: str = "") -> str:
    """RPDO1 of the interpolation time, then *operational*; no TPDO."""
    return f"{_NO_TPDO}{_RPDO.format(type=type_)}{before}\n> 000 01 05\n{script}"


CLAUSES = (
    # How a PDO is changed, and what is refused.
    Clause(
        "CiA 301, 7.5.2.38",
        "the mapping is not changed while the PDO exists",
        "w 1A00:00 u8 0 = 06010000\nw 1A00:01 u32 0x10010008 = 06010000",
    ),
    Clause(
        "CiA 301, 7.5.2.38",
        "entries are not changed while sub-index 0 is not 0",
        f"""
        {_NO_TPDO}w 1A00:01 u32 0x10010008 = 06010000
        w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x10010008 = ok
        w 1A00:00 u8 1 = ok
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.38",
        "an object that does not exist",
        f"{_NO_TPDO}w 1A00:00 u8 0 = ok\nw 1A00:01 u32 0x5F000008 = 06020000",
    ),
    Clause(
        "CiA 301, 7.5.2.38",
        "a sub-index that does not exist",
        f"{_NO_TPDO}w 1A00:00 u8 0 = ok\nw 1A00:01 u32 0x10180908 = 06090011",
    ),
    Clause(
        "CiA 301, 7.5.2.38",
        "a length that is not the object's",
        f"{_NO_TPDO}w 1A00:00 u8 0 = ok\nw 1A00:01 u32 0x10010010 = 06040041",
    ),
    Clause(
        "CiA 301, 7.5.2.38",
        "what is read only is not received",
        "w 1400:01 u32 0x80000205 = ok\nw 1600:00 u8 0 = ok\nw 1600:01 u32 0x10010008 = 06040041",
    ),
    Clause("CiA 301, 7.5.2.38", "more objects than the PDO has entries", f"{_NO_TPDO}w 1A00:00 u8 65 = 06040042"),
    Clause(
        "CiA 301, 7.5.2.37",
        "the identifier is not changed while the PDO exists",
        "w 1800:01 u32 0x1c5 = 06090030\nw 1800:01 u32 0x800001c5 = ok\nw 1800:01 u32 0x1c5 = ok",
    ),
    Clause("CiA 301, 7.5.2.37", "bit 29: 29-bit identifiers are not supported", "w 1800:01 u32 0xa0000185 = 06090030"),
    *(
        Clause(
            "CiA 301, 7.3.5", f"CAN-ID {can_id:03X}h of restricted use", f"{_NO_TPDO}w 1800:01 u32 {can_id} = 06090030"
        )
        for can_id in (0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601, 0x67F, 0x6E0, 0x6FF, 0x701, 0x7FF)
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "the inhibit time is not changed while the PDO exists",
        f"w 1800:03 u16 1 = 06010000\n{_NO_TPDO}w 1800:03 u16 1 = ok",
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "the SYNC start value is not changed while the PDO exists",
        f"w 1800:06 u8 1 = 06010000\n{_NO_TPDO}w 1800:06 u8 1 = ok",
    ),
    Clause("CiA 301, 7.5.2.37", "sub-index 4 is reserved, the highest is 6", "r 1800:04 = 06090011\nr 1800:00 = u8 6"),
    *(
        Clause("CiA 301, 7.5.2.37", f"transmission type {type_} is reserved", f"w 1800:02 u8 {type_} = 06090030")
        for type_ in (241, 246, 251)
    ),
    *(
        Clause(
            "CiA 301, 7.5.2.35", f"transmission type {type_} is reserved for RPDOs", f"w 1400:02 u8 {type_} = 06090030"
        )
        for type_ in (241, 251, 252, 253)
    ),
    *(
        Clause(
            "CiA 301, 7.5.2.37",
            f"transmission type {type_} exists",
            f"w 1800:02 u8 {type_} = ok\nr 1800:02 = u8 {type_}",
        )
        for type_ in (0, 1, 240, 252, 253, 254, 255)
    ),
    # Transmission types.
    Clause(
        "CiA 301, 7.5.2.37",
        "type 0, acyclic synchronous: sent at the SYNC after an event",
        tpdo(
            0,
            """
        > 080
        < 185 00 00
        > 080
        w 6060:00 i8 10 = ok
        > 080
        < 185 0a 00
        > 080
        """,
        ),
    ),
    Clause("CiA 301, 7.5.2.37", "type 1: sent with every SYNC", tpdo(1, "> 080\n< 185 00 00\n> 080\n< 185 00 00")),
    Clause(
        "CiA 301, 7.5.2.37",
        "type n: sent with every n-th SYNC",
        tpdo(3, "> 080\n> 080\n> 080\n< 185 00 00\n> 080\n> 080\n> 080\n< 185 00 00"),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "type 240: sent with every 240th SYNC",
        tpdo(240, "> 080\n" * 240 + "< 185 00 00\n" + "> 080\n" * 239),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "type 252, RTR-only synchronous: sampled with SYNC, sent on request",
        tpdo(
            252,
            """
        ? 185
        > 080
        w 6060:00 i8 10 = ok
        ? 185
        < 185 00 00
        > 080
        ? 185 2
        < 185 0a 00
        """,
            rtr=True,
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "type 253, RTR-only event-driven: sampled and sent on request",
        tpdo(253, "> 080\nwait 20\n? 185\n< 185 00 00\nw 6060:00 i8 10 = ok\nwait 20\n? 185\n< 185 0a 00", rtr=True),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "type 254 and 255: sent on an event, and on request",
        tpdo(
            254, "wait 5\n< 185 00 00\nwait 50\n? 185\n< 185 00 00\nw 6060:00 i8 10 = ok\nwait 5\n< 185 0a 00", rtr=True
        ),
    ),
    Clause("CiA 301, 7.5.2.37", "bit 30 set: no RTR allowed", tpdo(1, "? 185\n> 080\n< 185 00 00\n? 185")),
    Clause(
        "CiA 301, 7.5.2.37",
        "a synchronous TPDO may be asked for, bit 30 clear",
        tpdo(1, "? 185\n< 185 00 00", rtr=True),
    ),
    Clause(
        "CiA 301, 7.3.2.2.3",
        "outside *operational* no TPDO is sent on request",
        tpdo(253, "> 000 80 05\n? 185", rtr=True),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "inhibit time: the least time between two, in 100 µs",
        tpdo(
            255,
            """
        wait 5
        < 185 00 00
        w 6060:00 i8 10 = ok
        wait 94
        wait 2
        < 185 0a 00
        """,
            before="w 1800:03 u16 1000 = ok",
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "event timer: sent when it has elapsed, in ms",
        tpdo(
            255,
            "wait 1\n< 185 00 00\nwait 48\nwait 3\n< 185 00 00\nwait 47\nwait 4\n< 185 00 00",
            before="w 1800:05 u16 50 = ok",
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "SYNC start value: the SYNC with this counter is the first one received",
        tpdo(
            2,
            """
        > 080 02
        > 080 03
        > 080 04
        < 185 00 00
        > 080 01
        > 080 02
        < 185 00 00
        """,
            before="w 1800:06 u8 3 = ok\nw 1019:00 u8 4 = ok",
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.37",
        "SYNC start value: without a SYNC counter it is ignored",
        tpdo(1, "> 080\n< 185 00 00", before="w 1800:06 u8 3 = ok"),
    ),
    # RPDOs.
    Clause(
        "CiA 301, 7.5.2.35",
        "type 0 to 240: acts with the next SYNC",
        rpdo(1, "> 205 07\nr 60C2:01 = u8 1\n> 080\nr 60C2:01 = u8 7"),
    ),
    Clause(
        "CiA 301, 7.5.2.35",
        "type 240 acts with the next SYNC too",
        rpdo(240, "> 205 07\nr 60C2:01 = u8 1\n> 080\nr 60C2:01 = u8 7"),
    ),
    Clause("CiA 301, 7.5.2.35", "type 254, 255: acts at once", rpdo(255, "> 205 07\nr 60C2:01 = u8 7")),
    Clause(
        "CiA 301, 7.4.7.1",
        "dummy entries leave space",
        f"""
        {_NO_TPDO}
        w 1400:01 u32 0x80000205 = ok
        w 1600:00 u8 0 = ok
        w 1600:01 u32 0x00050008 = ok
        w 1600:02 u32 0x00060010 = ok
        w 1600:03 u32 0x00070020 = ok
        w 1600:04 u32 0x60C20108 = ok
        w 1600:00 u8 4 = ok
        w 1400:01 u32 0x205 = ok
        > 000 01 05
        > 205 ff ff ff ff ff ff ff 09
        r 60C2:01 = u8 9
        """,
    ),
    Clause(
        "CiA 301, 7.4.7.1",
        "dummy entries are for RPDOs, of their own length",
        f"""
        {_NO_TPDO}w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x00050008 = 06020000
        w 1400:01 u32 0x80000205 = ok
        w 1600:00 u8 0 = ok
        w 1600:01 u32 0x00050010 = 06040041
        """,
    ),
    Clause(
        "CiA 301, 7.2.2.5 and table 26",
        "8210h: a PDO that is too short is not processed",
        rpdo(
            255,
            """
        > 205
        < 085 10 82 11 00 00 00 00 00
        > 205                            # the error is told once
        r 1001:00 = u8 0x11
        > 205 07
        < 085 00 00 00 00 00 00 00 00
        """,
        ),
    ),
    Clause(
        "CiA 301, 7.2.2.5 and table 26",
        "8220h: of a PDO that is too long the first octets are processed",
        rpdo(
            255,
            """
        > 205 07 08
        < 085 20 82 11 00 00 00 00 00
        r 60C2:01 = u8 7
        > 205 05
        < 085 00 00 00 00 00 00 00 00
        """,
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.35, event timer",
        "8250h: the deadline is armed by the first reception; over with the next one",
        rpdo(
            255,
            """
        wait 500
        > 205 07
        wait 19
        > 205 07
        wait 19
        wait 1
        < 085 50 82 11 00 00 00 00 00
        wait 500
        > 205 07
        < 085 00 00 00 00 00 00 00 00
        wait 20
        < 085 50 82 11 00 00 00 00 00
        """,
            before="w 1400:05 u16 20 = ok\n",
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.35, event timer",
        "a deadline is not watched outside *operational*, and armed anew in it",
        rpdo(255, "> 205 07\n> 000 80 05\nwait 100\n> 000 01 05\nwait 100", before="w 1400:05 u16 20 = ok\n"),
    ),
    Clause(
        "CiA 301, 7.5.2.35, event timer",
        "0 disables it, also while it runs or has passed",
        rpdo(
            255,
            """
        > 205 07
        wait 10
        w 1400:05 u16 0 = ok
        wait 100
        w 1400:05 u16 20 = ok
        > 205 07
        wait 20
        < 085 50 82 11 00 00 00 00 00
        > 605 2b 00 14 05 00 00 00 00
        < 085 00 00 00 00 00 00 00 00
        < 585 60 00 14 05 00 00 00 00
        """,
            before="w 1400:05 u16 20 = ok\n",
        ),
    ),
    # SYNC.
    Clause("CiA 301, 7.5.2.5", "bit 30: this node does not produce SYNC", "w 1005:00 u32 0x40000080 = 06090030"),
    Clause("CiA 301, 7.5.2.5", "another identifier", tpdo(1, "w 1005:00 u32 0x81 = ok\n> 080\n> 081\n< 185 00 00")),
    *(
        Clause("CiA 301, 7.5.2.22", f"counter overflow value {value} is reserved", f"w 1019:00 u8 {value} = 06090030")
        for value in (1, 241, 255)
    ),
    *(
        Clause("CiA 301, 7.5.2.22", f"counter overflow value {value}", f"w 1019:00 u8 {value} = ok")
        for value in (0, 2, 240)
    ),
    Clause(
        "CiA 301, 7.5.2.22",
        "not changed while 1006h is not 0",
        "w 1006:00 u32 1000 = ok\nw 1019:00 u8 4 = 08000022\nw 1006:00 u32 0 = ok\nw 1019:00 u8 4 = ok",
    ),
    Clause(
        "CiA 301, table 26",
        "8240h unexpected SYNC data length",
        tpdo(
            1,
            """
        > 080 01
        < 085 40 82 11 00 00 00 00 00
        > 080 02
        > 080
        < 085 00 00 00 00 00 00 00 00
        < 185 00 00
        w 1019:00 u8 4 = ok
        > 080
        < 085 40 82 11 00 00 00 00 00
        """,
        ),
    ),
    Clause(
        "CiA 301, 7.5.2.7",
        "synchronous window length: synchronous RPDOs are taken until it has elapsed, and after the next SYNC again",
        rpdo(
            1,
            """
        > 080
        wait 0.5
        > 205 07
        > 080
        r 60C2:01 = u8 7
        wait 0.6
        > 205 09
        > 080
        r 60C2:01 = u8 7
        > 205 09
        > 080
        r 60C2:01 = u8 9
        """,
            before="w 1007:00 u32 500 = ok\n",
        ),
    ),
)
