"""Expedited SDO requests as octets, for where an answer is not waited for.

Reference: CiA 301 7.2.4.3.3 to 7.2.4.3.6.
"""

from haptic_fieldbus.drive.objects import ObjectEntry

DOWNLOAD_DONE, UPLOAD_DONE, ABORTED = 3, 2, 4
"""Specifiers of an SDO response, in the highest three bits of its first octet."""
EXPEDITED = 0x02
"""Bit in the first octet of an upload response: the value is in it."""


def request(entry: ObjectEntry, value: int | None) -> bytes:
    """Return the SDO request that downloads `value`, expedited, or uploads the entry when it is None."""
    if value is None:
        return bytes((0x40,)) + address(entry) + bytes(4)
    data = entry.type.pack(value)
    # Expedited, with its size: bits 2 and 3 count the octets that are not used.
    return bytes((0x23 | (4 - len(data)) << 2,)) + address(entry) + data.ljust(4, b"\0")


def address(entry: ObjectEntry) -> bytes:
    """Return index and sub-index as they stand in requests and responses."""
    return entry.object.to_bytes(2, "little") + bytes((entry.subindex,))
