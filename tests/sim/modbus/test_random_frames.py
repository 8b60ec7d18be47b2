"""Any octets at all: the drives answer what is a request to them, nothing else, and live on."""

import random

import pytest

from haptic_fieldbus.sim.modbus.station import RequestServer
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
    desk = RequestServer(NoLine(), seed=1, serial=serial)
    desk.rack.add(slot(), 0)
    draw, t_ns = random.Random(thousands), 0
    for _ in range(1000 * thousands):
        t_ns += 1000
        desk.rack.run(t_ns)
        used, asked = desk.station.next(frame(draw, serial))
        assert used >= 0
        if asked is not None:
            for _, octets in desk.answer(asked, t_ns):
                assert octets[0] == NUMBER if serial else octets[6] == NUMBER
                assert not serial or octets[-2:] == crc(octets[:-2])
    used, asked = desk.station.next(rtu(NUMBER, READ) if serial else tcp(NUMBER, READ))
    assert used
    assert asked is not None
    assert len(list(desk.answer(asked, t_ns))) == 1
