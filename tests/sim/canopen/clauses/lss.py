"""CiA 305: LSS services. The drive's address is vendor FBh, product 0, revision 1 0000h, serial 1234h."""

from tests.sim.canopen.clauses.script import Clause

CONFIGURATION, WAITING = "> 7e5 04 01 00 00 00 00 00 00\n", "> 7e5 04 00 00 00 00 00 00 00\n"
INQUIRE, IS_5 = "> 7e5 5e 00 00 00 00 00 00 00\n", "< 7e4 5e 05 00 00 00 00 00 00\n"
ADDRESS = (0xFB, 0, 0x1_0000, 0x1234)
BOOTED = "wait 19\nwait 1\n"
UNCONFIGURED = (
    f"{CONFIGURATION}> 7e5 11 ff 00 00 00 00 00 00\n< 7e4 11 00 00 00 00 00 00 00\n{WAITING}> 000 82 05\n{BOOTED}"
)
IDENTIFY = "> 7e5 46 fb 00 00 00 00 00 00\n> 7e5 47 00 00 00 00 00 00 00\n> 7e5 48 00 00 01 00 00 00 00\n"


def select(*address: int) -> str:
    """Switch state selective: one request for each part."""
    parts = enumerate(address, start=0x40)
    return "".join(
        f"> 7e5 {specifier:02x} {part.to_bytes(4, 'little').hex(' ')} 00 00 00\n" for specifier, part in parts
    )


def fastscan(number: int, bit: int, part: int, following: int) -> str:
    return f"> 7e5 51 {number.to_bytes(4, 'little').hex(' ')} {bit:02x} {part:02x} {following:02x}\n"


FOUND = "< 7e4 4f 00 00 00 00 00 00 00\n"

CLAUSES = (
    Clause(
        "CiA 305, switch state global",
        "1 configuration, 0 waiting, no response",
        f"{INQUIRE}{CONFIGURATION}{INQUIRE}{IS_5}{WAITING}{INQUIRE}",
    ),
    Clause(
        "CiA 305, switch state selective",
        "the slave with this address responds",
        f"{select(*ADDRESS)}< 7e4 44 00 00 00 00 00 00 00\n{INQUIRE}{IS_5}",
    ),
    *(
        Clause(
            "CiA 305, switch state selective",
            f"another part {part} is another slave's",
            select(*(value + (position == part) for position, value in enumerate(ADDRESS))) + INQUIRE,
        )
        for part in range(4)
    ),
    Clause(
        "CiA 305, inquire identity",
        "vendor-ID, product code, revision number, serial number",
        f"""
        {CONFIGURATION}
        > 7e5 5a 00 00 00 00 00 00 00
        < 7e4 5a fb 00 00 00 00 00 00
        > 7e5 5b 00 00 00 00 00 00 00
        < 7e4 5b 00 00 00 00 00 00 00
        > 7e5 5c 00 00 00 00 00 00 00
        < 7e4 5c 00 00 01 00 00 00 00
        > 7e5 5d 00 00 00 00 00 00 00
        < 7e4 5d 34 12 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 305, configure node-ID",
        "1 to 127 and FFh; else error 1",
        f"""
        {CONFIGURATION}
        > 7e5 11 00 00 00 00 00 00 00
        < 7e4 11 01 00 00 00 00 00 00
        > 7e5 11 80 00 00 00 00 00 00
        < 7e4 11 01 00 00 00 00 00 00
        > 7e5 11 7f 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        > 7e5 11 ff 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 305, configure node-ID",
        "in the waiting state it is not obeyed",
        f"> 7e5 11 09 00 00 00 00 00 00\n> 000 82 05\n{BOOTED}< 705 00",
    ),
    Clause(
        "CiA 305, configure node-ID",
        "the new node-ID is active after reset communication, COB-IDs follow it",
        f"""
        {CONFIGURATION}
        > 7e5 11 09 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        {INQUIRE}{IS_5}
        {WAITING}
        r 1000:00 = u32 0x20192
        > 000 82 05
        {BOOTED}
        < 709 00
        > 605 40 00 10 00 00 00 00 00
        > 609 40 14 10 00 00 00 00 00
        < 589 43 14 10 00 89 00 00 00
        > 609 40 00 18 01 00 00 00 00
        < 589 43 00 18 01 89 01 00 ??
        > 609 40 00 14 01 00 00 00 00
        < 589 43 00 14 01 09 02 00 ??
        """,
    ),
    Clause(
        "CiA 305, store configuration",
        "what is stored is that of the next power-on, what is not is lost",
        f"""
        {CONFIGURATION}
        > 7e5 11 09 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        > 7e5 17 00 00 00 00 00 00 00
        < 7e4 17 00 00 00 00 00 00 00
        > 7e5 11 0a 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        > 000 82 05
        {BOOTED}
        < 70a 00
        > 000 81 0a
        {BOOTED}
        < 709 00
        """,
    ),
    *(
        Clause(
            "CiA 305, configure bit timing",
            f"table 0, entry {entry}",
            f"{CONFIGURATION}> 7e5 13 00 {entry:02x} 00 00 00 00 00\n< 7e4 13 {error:02x} 00 00 00 00 00 00",
        )
        for entry, error in ((0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 1), (6, 0), (7, 0), (8, 0), (9, 1), (10, 1))
    ),
    Clause(
        "CiA 305, configure bit timing",
        "other tables are not supported",
        f"{CONFIGURATION}> 7e5 13 01 00 00 00 00 00 00\n< 7e4 13 01 00 00 00 00 00 00",
    ),
    Clause(
        "CiA 305, activate bit timing",
        "silent for twice the switch delay",
        f"""
        w 1017:00 u16 10 = ok
        {CONFIGURATION}
        > 7e5 13 00 00 00 00 00 00 00
        < 7e4 13 00 00 00 00 00 00 00
        > 7e5 15 32 00 00 00 00 00 00
        > 605 40 00 10 00 00 00 00 00
        wait 99
        wait 2
        < 705 7f
        r 1000:00 = u32 0x20192
        """,
    ),
    Clause(
        "CiA 305, activate bit timing",
        "with another bit rate than the bus has it is not heard again",
        f"""
        {CONFIGURATION}
        > 7e5 13 00 02 00 00 00 00 00
        < 7e4 13 00 00 00 00 00 00 00
        > 7e5 15 0a 00 00 00 00 00 00
        wait 500
        > 605 40 00 10 00 00 00 00 00
        > 000 82 05
        wait 500
        """,
    ),
    Clause(
        "CiA 305, identify remote slave",
        "responds when revision and serial number lie in the ranges",
        f"""
        {IDENTIFY}
        > 7e5 49 ff ff 01 00 00 00 00
        > 7e5 4a 00 10 00 00 00 00 00
        > 7e5 4b 00 20 00 00 00 00 00
        < 7e4 4f 00 00 00 00 00 00 00
        {IDENTIFY}
        > 7e5 49 ff ff 01 00 00 00 00
        > 7e5 4a 35 12 00 00 00 00 00
        > 7e5 4b 00 20 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 305, identify non-configured slave",
        "only a slave without node-ID responds",
        f"> 7e5 4c 00 00 00 00 00 00 00\n{UNCONFIGURED}> 7e5 4c 00 00 00 00 00 00 00\n< 7e4 50 00 00 00 00 00 00 00",
    ),
    Clause(
        "CiA 305, node-ID FFh",
        "no boot-up, NMT and SDO wait for a node-ID; then it boots by itself",
        f"""
        {UNCONFIGURED}
        > 000 01 00
        > 605 40 00 10 00 00 00 00 00
        {CONFIGURATION}
        > 7e5 5e 00 00 00 00 00 00 00
        < 7e4 5e ff 00 00 00 00 00 00
        > 7e5 11 20 00 00 00 00 00 00
        < 7e4 11 00 00 00 00 00 00 00
        {WAITING}
        {BOOTED}
        < 720 00
        > 620 40 00 10 00 00 00 00 00
        < 5a0 43 00 10 00 92 01 02 00
        """,
    ),
    Clause("CiA 305, fastscan", "a slave with a node-ID does not take part", fastscan(0, 0x80, 0, 0)),
    Clause(
        "CiA 305, fastscan",
        "128 confirms that somebody is there; a match of the bits down to BitCheck is confirmed",
        UNCONFIGURED
        + fastscan(0, 0x80, 0, 0)
        + FOUND
        + fastscan(0, 31, 0, 0)
        + FOUND
        + fastscan(0x8000_0000, 31, 0, 0)
        + fastscan(0x80, 7, 0, 0)
        + FOUND
        + fastscan(0x00, 7, 0, 0)
        + fastscan(0xFB, 0, 0, 1)
        + FOUND
        + fastscan(0xFB, 0, 0, 1)
        + fastscan(0, 0, 1, 2)
        + FOUND
        + fastscan(0x10000, 0, 2, 3)
        + FOUND
        + INQUIRE
        + fastscan(0x1234, 0, 3, 0)
        + FOUND
        + INQUIRE
        + "< 7e4 5e ff 00 00 00 00 00 00",
    ),
    Clause(
        "CiA 305, fastscan",
        "reserved bits, parts and orders are not answered",
        UNCONFIGURED + fastscan(0, 32, 0, 0) + fastscan(0, 0x80, 4, 0) + fastscan(0, 31, 1, 1),
    ),
    Clause(
        "CiA 305",
        "requests have eight octets; unknown ones are not answered",
        f"{CONFIGURATION}> 7e5 5e 00\n> 7e5 99 00 00 00 00 00 00 00\n> 7e5 04 07 00 00 00 00 00 00\n{INQUIRE}{IS_5}",
    ),
)
