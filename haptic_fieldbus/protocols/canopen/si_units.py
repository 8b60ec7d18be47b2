"""Units that a drive says it counts in: 60A8h *SI unit position* and 60A9h *SI unit velocity* (CiA 402-2, 303-2)."""

from haptic_fieldbus.drive.units import COUNTS, COUNTS_PER_SECOND, TENTH_DEGREE

POSITION_UNIT_CODES = {0: COUNTS, 0x00B5_0000: COUNTS, 0xFF41_0000: TENTH_DEGREE}
"""Value of 60A8h → unit; 0 says nothing, and the octets are prefix and numerator (B5h counts, 41h degrees)."""
VELOCITY_UNIT_CODES = {
    0x00B4_4700: "rpm",
    0xFFB4_4700: "0.1 rpm",
    0xFEB4_4700: "0.01 rpm",
    0xFDB4_4700: "0.001 rpm",
    0x00B5_0300: COUNTS_PER_SECOND,
}
"""Value of 60A9h → unit; the octets are prefix, numerator (B4h revolutions, B5h counts), denominator (47h minutes, 03h
seconds)."""
