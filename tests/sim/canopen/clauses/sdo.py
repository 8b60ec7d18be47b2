"""CiA 301, 7.2.4: SDO protocols and abort codes."""

from tests.sim.canopen.clauses.script import Clause

ABORT = "CiA 301, 7.2.4.3.17"

CLAUSES = (
    # Table 22, SDO abort codes.
    Clause(
        ABORT,
        "0503 0000h toggle bit not alternated",
        """
        > 605 40 08 10 00 00 00 00 00
        < 585 41 08 10 00 ?? ?? ?? ??
        > 605 70 00 00 00 00 00 00 00
        < 585 80 08 10 00 00 00 03 05
        > 605 60 00 00 00 00 00 00 00   # the transfer is over
        < 585 80 ?? ?? ?? 01 00 04 05
        """,
    ),
    Clause(
        ABORT,
        "0504 0000h SDO protocol timed out",
        """
        > 605 21 f0 5f 01 0a 00 00 00
        < 585 60 f0 5f 01 00 00 00 00
        wait 999
        wait 1
        < 585 80 f0 5f 01 00 00 04 05
        """,
    ),
    Clause(
        ABORT,
        "0504 0001h command specifier not valid or unknown",
        "> 605 e0\n> 605 e0 00 00 00 00 00 00 00\n< 585 80 00 00 00 01 00 04 05",
    ),
    Clause(ABORT, "0504 0002h invalid block size", "> 605 a4 00 10 00 00 00 00 00\n< 585 80 00 10 00 02 00 04 05"),
    Clause(ABORT, "0504 0002h invalid block size", "> 605 a4 00 10 00 80 00 00 00\n< 585 80 00 10 00 02 00 04 05"),
    Clause(
        ABORT,
        "0504 0003h invalid sequence number",
        """
        > 605 c6 f0 5f 01 07 00 00 00
        < 585 a4 f0 5f 01 7f 00 00 00
        > 605 00 31 32 33 34 35 36 37
        < 585 80 f0 5f 01 03 00 04 05
        """,
    ),
    Clause(
        ABORT,
        "0504 0003h invalid sequence number: more segments confirmed than were sent",
        """
        > 605 a4 00 10 00 7f 00 00 00
        < 585 c6 00 10 00 04 00 00 00
        > 605 a3 00 00 00 00 00 00 00
        < 585 81 92 01 02 00 00 00 00
        > 605 a2 02 7f 00 00 00 00 00
        < 585 80 00 10 00 03 00 04 05
        """,
    ),
    Clause(
        ABORT,
        "0504 0004h CRC error",
        """
        > 605 c6 f0 5f 01 09 00 00 00
        < 585 a4 f0 5f 01 7f 00 00 00
        > 605 01 31 32 33 34 35 36 37
        > 605 82 38 39 00 00 00 00 00
        < 585 a2 02 7f 00 00 00 00 00
        > 605 d5 c4 31 00 00 00 00 00
        < 585 80 f0 5f 01 04 00 04 05
        """,
    ),
    Clause(ABORT, "0601 0000h unsupported access to an object", "w 1A00:00 u8 0 = 06010000"),
    Clause(ABORT, "0601 0001h attempt to read a write only object", "r 5FF2:00 = 06010001"),
    Clause(ABORT, "0601 0002h attempt to write a read only object", "w 1000:00 u32 0 = 06010002"),
    Clause(
        ABORT,
        "0601 0002h attempt to write a read only object",
        "> 605 20 00 10 00 00 00 00 00\n< 585 80 00 10 00 02 00 01 06",
    ),
    Clause(
        ABORT,
        "0602 0000h object does not exist in the object dictionary",
        "r 5F00:00 = 06020000\nw 5F00:00 u8 0 = 06020000",
    ),
    Clause(
        ABORT,
        "0604 0041h object cannot be mapped to the PDO",
        """
        w 1A00:00 u8 0 = 06010000
        w 1800:01 u32 0x80000185 = ok
        w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x10170010 = 06040041
        """,
    ),
    Clause(
        ABORT,
        "0604 0042h the mapped objects would exceed PDO length",
        """
        w 1800:01 u32 0x80000185 = ok
        w 1A00:00 u8 0 = ok
        w 1A00:01 u32 0x60640020 = ok
        w 1A00:02 u32 0x60640020 = ok
        w 1A00:03 u32 0x10010008 = ok
        w 1A00:00 u8 3 = 06040042
        w 1A00:00 u8 2 = ok
        """,
    ),
    Clause(
        ABORT,
        "0604 0043h general parameter incompatibility",
        "w 1016:01 u32 0x7f0032 = ok\nw 1016:02 u32 0x7f0064 = 06040043",
    ),
    Clause(
        ABORT,
        "0607 0010h length of service parameter does not match",
        """
        > 605 21 f0 5f 01 0a 00 00 00
        < 585 60 f0 5f 01 00 00 00 00
        > 605 01 31 32 33 34 35 36 37
        < 585 80 f0 5f 01 10 00 07 06
        """,
    ),
    Clause(ABORT, "0607 0012h length of service parameter too high", "w 1017:00 u32 5 = 06070012"),
    Clause(
        ABORT,
        "0607 0012h length of service parameter too high",
        "> 605 21 f0 5f 01 01 80 00 00\n< 585 80 f0 5f 01 12 00 07 06",
    ),
    Clause(ABORT, "0607 0013h length of service parameter too low", "w 1017:00 u8 5 = 06070013"),
    Clause(ABORT, "0609 0011h sub-index does not exist", "r 1018:09 = 06090011\nw 1800:04 u8 0 = 06090011"),
    Clause(ABORT, "0609 0030h invalid value for parameter", "w 1029:01 u8 3 = 06090030"),
    Clause(
        ABORT,
        "0609 0031h value of parameter written too high",
        "w 1800:01 u32 0x80000185 = ok\nw 1800:06 u8 241 = 06090031",
    ),
    Clause(ABORT, "0609 0032h value of parameter written too low", "w 60C2:01 u8 0 = 06090032"),
    Clause(ABORT, "0800 0020h data cannot be transferred or stored to the application", "w 1010:01 u32 0 = 08000020"),
    Clause(
        ABORT, "0800 0022h because of the present device state", "w 1006:00 u32 1000 = ok\nw 1019:00 u8 10 = 08000022"
    ),
    Clause(ABORT, "0800 0024h no data available", "r 1003:01 = 08000024"),
    # Protocols.
    Clause(
        "CiA 301, 7.2.4.3.3",
        "download, expedited: e = 1, s = 1, n octets without data; without s the size is not told",
        "> 605 2b 17 10 00 0a 00 00 00\n< 585 60 17 10 00 00 00 00 00\n"
        "> 605 22 17 10 00 0b 00 00 00\n< 585 60 17 10 00 00 00 00 00\nr 1017:00 = u16 11\n"
        "> 605 22 17 10 00 00 00 00 00\n< 585 60 17 10 00 00 00 00 00",
    ),
    Clause("CiA 301, 7.2.4.3.5", "upload, expedited", "> 605 40 00 10 00 00 00 00 00\n< 585 43 00 10 00 92 01 02 00"),
    Clause(
        "CiA 301, 7.2.4.3.4",
        "download segment: t alternates from 0, n octets without data, c ends; upload segment likewise",
        """
        > 605 21 f0 5f 01 09 00 00 00
        < 585 60 f0 5f 01 00 00 00 00
        > 605 00 31 32 33 34 35 36 37
        < 585 20 00 00 00 00 00 00 00
        > 605 1b 38 39 00 00 00 00 00
        < 585 30 00 00 00 00 00 00 00
        > 605 40 f0 5f 01 00 00 00 00
        < 585 41 f0 5f 01 09 00 00 00
        > 605 60 00 00 00 00 00 00 00
        < 585 00 31 32 33 34 35 36 37
        > 605 70 00 00 00 00 00 00 00
        < 585 1b 38 39 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 301, 7.2.4.3.9 to 7.2.4.3.11",
        "block download: the CRC of 123456789 is 31C3h; n = 5 octets of the last segment without data",
        """
        > 605 c6 f0 5f 02 09 00 00 00
        < 585 a4 f0 5f 02 7f 00 00 00
        > 605 01 31 32 33 34 35 36 37
        > 605 82 38 39 00 00 00 00 00
        < 585 a2 02 7f 00 00 00 00 00
        > 605 d5 c3 31 00 00 00 00 00
        < 585 a1 00 00 00 00 00 00 00
        > 605 40 f0 5f 02 00 00 00 00
        < 585 41 f0 5f 02 09 00 00 00
        """,
    ),
    Clause(
        "CiA 301, 7.2.4.3.10",
        "a block whose segment 2 was lost is confirmed up to 1, and sent again from there",
        """
        > 605 c2 f0 5f 01 15 00 00 00
        < 585 a0 f0 5f 01 7f 00 00 00
        > 605 01 61 62 63 64 65 66 67
        > 605 83 6f 70 71 72 73 74 75
        < 585 a2 01 7f 00 00 00 00 00
        > 605 01 68 69 6a 6b 6c 6d 6e
        > 605 82 6f 70 71 72 73 74 75
        < 585 a2 02 7f 00 00 00 00 00
        > 605 c1 00 00 00 00 00 00 00
        < 585 a1 00 00 00 00 00 00 00
        > 605 a0 f0 5f 01 02 00 00 00   # and back, in blocks of 2, without CRC
        < 585 c2 f0 5f 01 15 00 00 00
        > 605 a3 00 00 00 00 00 00 00
        < 585 01 61 62 63 64 65 66 67
        < 585 02 68 69 6a 6b 6c 6d 6e
        > 605 a2 01 03 00 00 00 00 00   # the client missed the second
        < 585 01 68 69 6a 6b 6c 6d 6e
        < 585 82 6f 70 71 72 73 74 75
        > 605 a2 02 7f 00 00 00 00 00
        < 585 c1 00 00 00 00 00 00 00
        > 605 a1 00 00 00 00 00 00 00
        """,
    ),
    Clause(
        "CiA 301, 7.2.4.3.12",
        "block upload: below the protocol switch threshold the response is that of an upload",
        "> 605 a4 00 10 00 7f 04 00 00\n< 585 43 00 10 00 92 01 02 00",
    ),
    Clause(
        "CiA 301, 7.2.4.3.17",
        "an abort of the client ends the transfer and is not answered, inside a block neither",
        """
        > 605 80 00 10 00 00 00 04 05
        > 605 c2 f0 5f 01 15 00 00 00
        < 585 a0 f0 5f 01 7f 00 00 00
        > 605 01 61 62 63 64 65 66 67
        > 605 80 f0 5f 01 00 00 04 05
        r 1000:00 = u32 0x20192
        wait 2000
        """,
    ),
    Clause(
        "CiA 301, 7.2.4.3.2",
        "a new initiate replaces the transfer under way",
        """
        > 605 40 08 10 00 00 00 00 00
        < 585 41 08 10 00 ?? ?? ?? ??
        r 1000:00 = u32 0x20192
        > 605 60 00 00 00 00 00 00 00
        < 585 80 00 00 00 01 00 04 05
        """,
    ),
)
