"""Emergency error codes in words.

Reference: CiA 301 7.2.7.1, table 26, and the codes of IEC 61800-7-201 (CiA 402-2), clause "error codes".
"""

RESET_CLASS = 0x00
"""High octet of the code for "error reset": no error is left."""

MEANINGS = {
    0x1000: "generic error",
    0x2310: "continuous over-current at the drive's output",
    0x2320: "short circuit or earth leakage at the drive's output",
    0x3210: "DC link over-voltage",
    0x3220: "DC link under-voltage",
    0x4310: "excess temperature of the drive",
    0x5112: "under-voltage of the logic supply",
    0x5530: "parameter memory",
    0x6320: "parameter error",
    0x7121: "motor blocked",
    0x7300: "sensor error",
    0x7305: "incremental encoder signals",
    0x7510: "communication with a module of the drive",
    0x8110: "CAN overrun: objects lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat error: the drive missed the master's heartbeat",
    0x8140: "recovered from bus-off",
    0x8150: "CAN-ID collision",
    0x8210: "PDO not processed: wrong length",
    0x8220: "PDO longer than its mapping",
    0x8250: "RPDO time-out: the set-points came too late",
    0x8400: "velocity control",
    0x8500: "position control",
    0x8611: "following error",
}
"""Error code → meaning."""

CLASSES = {
    0x10: "generic error",
    0x20: "current",
    0x30: "voltage",
    0x40: "temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x70: "additional modules",
    0x80: "monitoring",
    0x90: "external error",
    0xF0: "additional functions",
}
"""Class of an error code, the upper half of its high octet → meaning, for codes that are not in `MEANINGS`."""


def emergency_meaning(code: int) -> str:
    """Return an error code in words, such as `DC link over-voltage`.

    An unlisted code is described by its class, a code of the vendor by a reference to the manual.
    """
    if code >> 8 == RESET_CLASS:
        return "error reset"
    if code >> 8 == 0xFF:  # before the class F0h, in whose range the codes of the vendor lie
        return "specific to this device, see the drive's manual"
    return MEANINGS.get(code) or CLASSES.get(code >> 8 & 0xF0, "unknown class")
