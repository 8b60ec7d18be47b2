"""The port of a master to a simulated wire: it sends, receives and refuses what python-can's messages do."""

from random import Random

import can
import pytest

from haptic_fieldbus.buses.canopen.frames import EXTENDED_FLAG, REMOTE_FLAG
from haptic_fieldbus.buses.canopen.wire import OURS, CanPort, PythonCanPort
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.link import Frame
from haptic_fieldbus.sim.canopen.site import WorldPort
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.faults import BusOff, ErrorFrame, InterfaceDown

MS = 1_000_000


class Played:
    """A world with traffic of another program, and what came of a script of random actions."""

    def __init__(self, seed: int, *, direct: bool, own: bool) -> None:
        self.world = World(VirtualClock(), 1_000_000, seed)
        self.bus = SimulatedBus(world=self.world, receive_own_messages=own)
        self.port: CanPort = WorldPort(self.bus) if direct else PythonCanPort(self.bus)
        self.other = self.world.attach()
        self.told: list[object] = []
        self.world.watch(lambda t_ns, frame, _sender: self.told.append((t_ns, frame)))
        self.random = Random(seed)
        for _ in range(300):
            self.step()
        self.bus.shutdown()

    def frame(self) -> tuple[int, bytes]:
        random = self.random
        flags = random.choice((0, 0, 0, EXTENDED_FLAG, REMOTE_FLAG, EXTENDED_FLAG | REMOTE_FLAG))
        can_id = random.randrange(1 << 29) if flags & EXTENDED_FLAG else random.randrange(0x800)
        size = random.randrange(9)
        return can_id | flags, bytes(size) if flags & REMOTE_FLAG else random.randbytes(size)

    def step(self) -> None:
        random, now_ns = self.random, self.world.clock.now_ns()
        action = random.random()
        try:
            if action < 0.35:
                can_id, data = self.frame()
                self.port.send(can_id, bytearray(data))
            elif action < 0.6:
                can_id, data = self.frame()
                self.world.send(
                    self.other,
                    Frame(can_id & 0x1FFF_FFFF, data, bool(can_id & EXTENDED_FLAG), bool(can_id & REMOTE_FLAG)),
                )
            elif action < 0.95:
                found = self.port.receive(random.choice((0.0, 1e-4, 1e-3)))
                self.told.append((found is OURS, None if found is None else (found[0], bytes(found[1]))))
            elif action < 0.97:
                self.world.inject_line(ErrorFrame("error_frame", 0.0), now_ns)
            elif action < 0.985:
                self.world.inject_line(BusOff("bus_off", 0.0, 1e-3), now_ns)
            else:
                self.world.inject_line(InterfaceDown("interface_down", 0.0, 1e-3), now_ns)
        except can.CanError as error:
            self.told.append(str(error))
        self.told.append(self.world.clock.now_ns())


@pytest.mark.parametrize("own", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_a_master_meets_the_same_bus_as_through_python_can(seed: int, own: bool) -> None:
    direct, through = (Played(seed, direct=each, own=own).told for each in (True, False))
    assert direct == through
    assert len(direct) > 400
