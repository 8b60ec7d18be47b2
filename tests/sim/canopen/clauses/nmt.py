"""CiA 301, 7.2.6 to 7.2.8 and 7.3.2: NMT, error control, EMCY, TIME; 7.5.2.13 and 7.5.2.14: storage."""

from itertools import product

from tests.sim.canopen.clauses.script import Clause

START, STOP, PRE_OPERATIONAL, RESET_NODE, RESET_COMMUNICATION = 1, 2, 128, 129, 130
STATES = {127: "", 5: "> 000 01 05\n", 4: "> 000 02 05\n"}
"""State octet, and how it is reached from *pre-operational*."""
NAMES = {127: "pre-operational", 5: "operational", 4: "stopped"}
COMMANDS = {START: 5, STOP: 4, PRE_OPERATIONAL: 127}
QUIET = "w 1800:01 u32 0x80000185 = ok\nw 1017:00 u16 10 = ok\n"
RESET_MS = 20
BOOTED = "wait 19\nwait 1\n< 705 00\n"
LOST, GONE = "085 30 81 11 00 00 00 00 00", "085 00 00 00 00 00 00 00 00"


def _services() -> list[Clause]:
    """Table 38, NMT states and communication objects."""
    sdo = "> 605 40 00 10 00 00 00 00 00\n", "< 585 43 00 10 00 92 01 02 00\n"
    emergency = "error 3210\n", "< 085 10 32 05 00 00 00 00 00\n"
    sync = "> 080\n", "< 185 00 00\n"
    guard = "? 705\n", "< 705 ??\n"
    lss = "> 7e5 04 01 00 00 00 00 00 00\n> 7e5 5e 00 00 00 00 00 00 00\n", "< 7e4 5e 05 00 00 00 00 00 00\n"
    table = {
        "PDO and SYNC": (sync, {5}),
        "SDO": (sdo, {127, 5}),
        "EMCY": (emergency, {127, 5}),
        "NMT error control": (guard, {127, 5, 4}),
        "LSS (CiA 305)": (lss, {127, 4}),
    }
    setting = """
        w 1800:01 u32 0x80000185 = ok
        w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x60600008 = ok
        w 1A00:02 u32 0x10010008 = ok
        w 1A00:00 u8 2 = ok
        w 1800:02 u8 1 = ok
        w 1800:01 u32 0x185 = ok
    """
    return [
        Clause(
            "CiA 301, table 38",
            f"{name} {'works' if state in states else 'does not work'} in {NAMES[state]}",
            setting + STATES[state] + request + (response if state in states else ""),
        )
        for (name, ((request, response), states)), state in product(table.items(), STATES)
    ]


CLAUSES = (
    # NMT.
    *(
        Clause(
            "CiA 301, 7.3.2.1",
            f"NMT command {command} in {NAMES[state]} leads to {NAMES[following]}",
            f"{QUIET}{STATES[state]}> 000 {command:02x} 05\nwait 10\n< 705 {following:02x}",
        )
        for state, (command, following) in product(STATES, COMMANDS.items())
    ),
    *(
        Clause(
            "CiA 301, 7.3.2.1 and 7.2.8.3.3",
            f"reset command {command} in {NAMES[state]} leads through initialising, with a boot-up message",
            f"""
            {QUIET}{STATES[state]}> 000 {command:02x} 05
            > 605 40 00 10 00 00 00 00 00
            > 000 01 05
            {BOOTED}wait 50
            ? 705
            < 705 7f
            """,
        )
        for state, command in product(STATES, (RESET_NODE, RESET_COMMUNICATION))
    ),
    *(
        Clause(
            "CiA 301, 7.2.8.2.1",
            f"NMT command {command} does not exist",
            f"{QUIET}> 000 {command:02x} 05\nwait 10\n< 705 7f",
        )
        for command in (0, 3, 127, 131, 255)
    ),
    Clause(
        "CiA 301, 7.2.8.3.1",
        "node-ID 0 means all nodes, another one another node",
        f"{QUIET}> 000 01 06\nwait 10\n< 705 7f\n> 000 01 00\nwait 10\n< 705 05",
    ),
    Clause(
        "CiA 301, 7.2.8.3.1",
        "an NMT message has two octets",
        f"{QUIET}> 000 01\n> 000 01 05 00\n> 000\nwait 10\n< 705 7f",
    ),
    Clause(
        "CiA 301, 7.3.2.2.1",
        "reset communication sets 1000h to 1FFFh to power-on values, reset node all",
        f"""
        w 1017:00 u16 500 = ok
        w 6060:00 i8 10 = ok
        > 000 82 05
        {BOOTED}
        r 1017:00 = u16 0
        r 6060:00 = i8 10
        > 000 81 05
        {BOOTED}
        r 6060:00 = i8 0
        """,
    ),
    *_services(),
    # Error control.
    Clause(
        "CiA 301, 7.2.8.3.2.2",
        "the heartbeat tells the state, once a producer time",
        f"{QUIET}wait 9.9\nwait 0.1\n< 705 7f\nwait 20\n< 705 7f\n< 705 7f",
    ),
    Clause("CiA 301, 7.5.2.20", "0 disables the producer", f"{QUIET}w 1017:00 u16 0 = ok\nwait 100"),
    Clause(
        "CiA 301, 7.2.8.3.2.2",
        "a consumer watches from the first heartbeat on, not boot-up; 8130h; over with the next",
        f"""
        w 1016:01 u32 0x7f0032 = ok
        wait 500
        > 77f 00
        wait 500
        > 77f 05
        wait 49
        > 77f 7f
        wait 49
        wait 1
        < {LOST}
        wait 500
        > 77f 05
        < {GONE}
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.19",
        "several nodes are watched, each by itself; the error is over when all are back",
        f"""
        w 1016:01 u32 0x7f0032 = ok
        w 1016:02 u32 0x7e0064 = ok
        > 77f 05
        > 77e 05
        wait 50
        < {LOST}
        wait 50
        > 77f 05
        > 77e 05
        < {GONE}
        """,
    ),
    Clause("CiA 301, 7.5.2.19", "bits 24 to 31 are reserved", "w 1016:01 u32 0x17f0032 = 06090030"),
    Clause(
        "CiA 301, 7.5.2.19",
        "an entry without time, or with node-ID 0 or above 127, is not used",
        "w 1016:01 u32 0x7f0000 = ok\nw 1016:02 u32 50 = ok\nw 1016:03 u32 0x800032 = ok\n> 77f 05\n> 700 05\nwait 500",
    ),
    Clause(
        "CiA 301, 7.5.2.19",
        "no node is watched twice",
        "w 1016:01 u32 0x7f0032 = ok\nw 1016:04 u32 0x7f0032 = 06040043\nw 1016:01 u32 0x7f0064 = ok",
    ),
    Clause(
        "CiA 301, 7.2.8.3.2.1",
        "guarding: the state with a toggle bit that alternates from 0",
        "? 705\n< 705 7f\n? 705\n< 705 ff\n? 705 1\n< 705 7f\n> 000 02 05\n? 705\n< 705 84",
    ),
    Clause(
        "CiA 301, 7.2.8.3.2.1",
        "reset communication sets the toggle bit to 0",
        f"? 705\n< 705 7f\n> 000 82 05\n{BOOTED}? 705\n< 705 7f",
    ),
    Clause(
        "CiA 301, 7.2.8.3.2",
        "heartbeats and guarding exclude each other; heartbeats come first",
        f"{QUIET}? 705\nwait 10\n< 705 7f",
    ),
    Clause(
        "CiA 301, 7.2.8.3.2.1",
        "life guarding: guard time × life time factor from the first request on; 8130h; over with the next",
        f"""
        w 100C:00 u16 20 = ok
        w 100D:00 u8 3 = ok
        wait 500
        ? 705
        < 705 7f
        wait 59
        ? 705
        < 705 ff
        wait 59
        wait 1
        < {LOST}
        ? 705
        < {GONE}
        < 705 7f
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.12",
        "a life time of 0 is none",
        """
        w 100C:00 u16 20 = ok
        ? 705
        < 705 7f
        wait 500
        w 100C:00 u16 0 = ok
        w 100D:00 u8 3 = ok
        ? 705
        < 705 ff
        wait 500
        """,
    ),
    *(
        Clause(
            "CiA 301, 7.5.2.32",
            f"1029h:01 = {behaviour}: after a communication error the state is {NAMES[state]}",
            f"""
            {QUIET}w 1029:01 u8 {behaviour} = ok
            w 1016:01 u32 0x7f0032 = ok
            w 1017:00 u16 0 = ok
            > 000 01 05
            > 77f 05
            wait 50
            < {LOST}
            ? 705
            < 705 {state:02x}
            """,
        )
        for behaviour, state in ((0, 127), (1, 5), (2, 4))
    ),
    Clause(
        "CiA 301, 7.5.2.32",
        "life guarding counts as well",
        f"""
        w 1800:01 u32 0x80000185 = ok
        w 1029:01 u8 2 = ok
        w 100C:00 u16 10 = ok
        w 100D:00 u8 1 = ok
        > 000 01 05
        ? 705
        < 705 05
        wait 10
        < {LOST}
        ? 705
        < 705 84
        """,
    ),
    # EMCY.
    *(
        Clause(
            "CiA 301, tables 26 and 46",
            f"{code}h sets {register:02x}h in 1001h",
            f"error {code}\n< 085 {code[2:]} {code[:2]} {register:02x} 00 00 00 00 00\nr 1001:00 = u8 {register}",
        )
        for code, register in (
            ("1000", 0x01),
            ("2310", 0x03),
            ("3210", 0x05),
            ("4210", 0x09),
            ("5000", 0x01),
            ("8110", 0x11),
            ("ff01", 0x81),
        )
    ),
    Clause(
        "CiA 301, 7.5.2.4",
        "1003h holds errors, the newest first; 0 clears it, nothing else can be written",
        """
        r 1003:00 = u8 0
        error 3210
        < 085 10 32 05 00 00 00 00 00
        error 4210
        < 085 10 42 0d 00 00 00 00 00
        r 1003:00 = u8 2
        r 1003:01 = u32 0x4210
        r 1003:02 = u32 0x3210
        r 1003:03 = 08000024
        w 1003:00 u8 1 = 06090030
        w 1003:01 u32 0 = 06010002
        w 1003:00 u8 0 = ok
        r 1003:00 = u8 0
        r 1003:01 = 08000024
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.17",
        "bit 31 of 1014h: no EMCY; the identifier is not changed while it exists",
        """
        w 1014:00 u32 0x86 = 06090030
        w 1014:00 u32 0x80000085 = ok
        error 3210
        w 1014:00 u32 0x91 = ok
        error 4210
        < 091 10 42 0d 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.18",
        "1015h: the least time between two EMCY, in 100 µs",
        """
        w 1015:00 u16 100 = ok
        error 3210
        < 085 10 32 05 00 00 00 00 00
        error 4210
        error 2310
        wait 9
        wait 1
        < 085 10 42 0d 00 00 00 00 00
        wait 10
        < 085 10 23 0f 00 00 00 00 00
        wait 50
        error 5000
        < 085 00 50 0f 00 00 00 00 00
        """,
    ),
    # TIME.
    Clause(
        "CiA 301, 7.2.6 and 7.5.2.15",
        "TIME is taken while bit 31 of 1012h is set",
        """
        r 1012:00 = u32 0x100
        > 100 e8 03 00 00 10 27
        r 5FF1:02 = u16 0
        w 1012:00 u32 0x80000100 = ok
        > 100 e8 03 00 00 10 27
        wait 250
        r 5FF1:01 = u32 1250
        r 5FF1:02 = u16 10000
        > 100 ff 5b 26 05 10 27           # a millisecond before midnight
        wait 1
        r 5FF1:01 = u32 0
        r 5FF1:02 = u16 10001
        > 100 e8 03 00 00 10              # five octets are no TIME
        r 5FF1:02 = u16 10001
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.15",
        "TIME is not produced; the identifier is not changed while it is consumed",
        "w 1012:00 u32 0x40000100 = 06090030\nw 1012:00 u32 0x80000100 = ok\nw 1012:00 u32 0x80000110 = 06090030",
    ),
    # Storage.
    Clause(
        "CiA 301, 7.5.2.13 and 7.5.2.14",
        "read: saved and restored on command",
        "r 1010:00 = u8 4\nr 1011:00 = u8 4\nr 1010:01 = u32 1\nr 1011:01 = u32 1",
    ),
    Clause(
        "CiA 301, 7.5.2.13",
        "what is saved outlives a reset, what is not does not",
        f"""
        w 60C2:01 u8 7 = ok
        w 1010:01 u32 0x65766173 = ok
        w 60C2:01 u8 9 = ok
        > 000 81 05
        {BOOTED}
        r 60C2:01 = u8 7
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.13",
        "sub-index 2 saves communication, sub-index 3 the application",
        f"""
        w 60C2:01 u8 7 = ok
        w 1029:01 u8 1 = ok
        w 1010:02 u32 0x65766173 = ok
        > 000 81 05
        {BOOTED}
        r 1029:01 = u8 1
        r 60C2:01 = u8 1
        w 60C2:01 u8 7 = ok
        w 1029:01 u8 2 = ok
        w 1010:03 u32 0x65766173 = ok
        > 000 81 05
        {BOOTED}
        r 1029:01 = u8 1
        r 60C2:01 = u8 7
        """,
    ),
    Clause(
        "CiA 301, 7.5.2.14",
        "restored values are those of the factory after the next reset",
        f"""
        w 60C2:01 u8 7 = ok
        w 1010:01 u32 0x65766173 = ok
        w 1011:01 u32 0x64616f6c = ok
        r 60C2:01 = u8 7
        > 000 81 05
        {BOOTED}
        r 60C2:01 = u8 1
        """,
    ),
    Clause("CiA 301, 7.5.2.14", "another signature is refused", "w 1011:01 u32 0x65766173 = 08000020"),
)
