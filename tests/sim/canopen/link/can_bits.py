"""An independent CAN encoder, bit by bit, straight from the standard's text; slow and plain."""


def _bits(value: int, width: int) -> list[int]:
    return [int(digit) for digit in format(value, f"0{width}b")]


def _crc(bits: list[int]) -> list[int]:
    """Long division of the polynomial x¹⁵+x¹⁴+x¹⁰+x⁸+x⁷+x⁴+x³+1 over GF(2)."""
    divisor = [1, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1]
    remainder = bits + [0] * 15
    for position in range(len(bits)):
        if remainder[position]:
            for offset, bit in enumerate(divisor):
                remainder[position + offset] ^= bit
    return remainder[-15:]


def _stuffed(bits: list[int]) -> list[int]:
    sent: list[int] = []
    for bit in bits:
        sent.append(bit)
        if len(sent) >= 5 and len(set(sent[-5:])) == 1 and _run_since_stuffing(sent) == 5:
            sent.append(1 - bit)
    return sent


def _run_since_stuffing(sent: list[int]) -> int:
    run = 1
    while run < len(sent) and sent[-run - 1] == sent[-1]:
        run += 1
    return run


def encoded(can_id: int, data: bytes, extended: bool, remote: bool) -> list[int]:
    """All bits from start of frame to end of frame."""
    head = [0]
    if extended:
        head += [*_bits(can_id >> 18, 11), 1, 1, *_bits(can_id & 0x3FFFF, 18), int(remote), 0, 0]
    else:
        head += [*_bits(can_id, 11), int(remote), 0, 0]
    head += _bits(len(data), 4)
    if not remote:
        for octet in data:
            head += _bits(octet, 8)
    return _stuffed(head + _crc(head)) + [1, 0, 1] + [1] * 7


def arbitration_bits(can_id: int, extended: bool, remote: bool) -> list[int]:
    """The bits that decide who goes on sending, up to the IDE bit and the extension."""
    if not extended:
        return [*_bits(can_id, 11), int(remote), 0]
    return [*_bits(can_id >> 18, 11), 1, 1, *_bits(can_id & 0x3FFFF, 18), int(remote)]
