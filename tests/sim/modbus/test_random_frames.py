"""Any octets at all: the drives answer what is a request to them, nothing else, and live on."""

import random

import pytest
from pymodbus.pdu import DecodePDU

from haptic_fieldbus.sim.modbus.station import RequestServer, any_request, usual_request
from tests.sim.modbus.test_line import READ, crc, rtu, tcp
from tests.sim.modbus.units import NUMBER, NoLine, slot

FUNCTIONS = (1, 3, 4, 5, 6, 15, 16, 22, 23, 43, 65, 100)


def frame(draw: random.Random, serial: bool) -> bytes:
    """A request with something wrong, or nothing; or noise."""
    if draw.random() < 0.2:
        return draw.randbytes(draw.randrange(1, 40))
    body = draw.randbytes(draw.randrange(20))
    if draw.random() < 0.5:  # addresses near those that are there, and small counts
        body = bytes((draw.randrange(4), draw.randrange(16), 0, draw.randrange(10))) + body
    pdu = bytes((draw.choice((*FUNCTIONS, draw.randrange(256))),)) + body
    unit = draw.choice((0, NUMBER, NUMBER, 9))
    octets = bytearray(rtu(unit, pdu) if serial else tcp(unit, pdu, draw.randrange(0x10000)))
    if draw.random() < 0.2:
        octets[draw.randrange(len(octets))] ^= 1 << draw.randrange(8)
    return bytes(octets)


@pytest.mark.thorough("a hundred thousand frames on each line", quick=("2-True", "2-False"))
@pytest.mark.parametrize("serial", [True, False])
@pytest.mark.parametrize("thousands", [2, 98])
def test_the_drives_live_on(thousands: int, serial: bool) -> None:
    requests = RequestServer(NoLine().inject, seed=1, serial=serial)
    requests.drives.add(slot(), 0)
    draw, t_ns = random.Random(thousands), 0
    for _ in range(1000 * thousands):
        t_ns += 1000
        requests.drives.run(t_ns)
        used, asked = requests.next(frame(draw, serial))
        assert used >= 0
        if asked is not None:
            for _, octets in requests.answer(asked, t_ns):
                assert octets[0] == NUMBER if serial else octets[6] == NUMBER
                assert not serial or octets[-2:] == crc(octets[:-2])
    used, asked = requests.next(rtu(NUMBER, READ) if serial else tcp(NUMBER, READ))
    assert used
    assert asked is not None
    assert len(list(requests.answer(asked, t_ns))) == 1


def usual_body(draw: random.Random) -> bytes:
    """A request that reads or writes registers, mostly as it should."""
    address = draw.randrange(0x10000).to_bytes(2, "big")
    if draw.random() < 0.5:
        return bytes((draw.choice((3, 4)),)) + address + draw.randrange(140).to_bytes(2, "big")
    count = draw.randrange(124)
    octets = draw.randbytes(2 * count + draw.choice((0, 0, 0, -1, 1, 2)) * (count > 0))
    return b"\x10" + address + count.to_bytes(2, "big") + bytes((2 * count + draw.choice((0, 0, 0, 1)),)) + octets


def test_a_usual_request_is_what_pymodbus_makes_of_it() -> None:
    draw, decoder, usual = random.Random(1), DecodePDU(True), 0
    for _ in range(2000):
        body = usual_body(draw)
        found = usual_request(7, 8, body)
        if found is not None:
            usual += 1
            assert found == any_request(7, 8, body, decoder.decode(body))
    assert usual > 1000
