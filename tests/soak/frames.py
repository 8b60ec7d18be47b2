"""Frames that nobody should send, to the simulated drive and to the master, in every phase of a run.

Half of them are made up, half are frames of the bus with other octets, lengths or identifiers. A drive must answer
after them; a master may end with an error of the package, and with no other, and must not exceed its limits.
"""

from collections import deque
from random import Random
from typing import Any

import can

from haptic_fieldbus import api
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.protocols.canopen.bus import can_section
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.invariants.attach import watched
from tests.soak.case import profiles
from tests.whole_loop import run_loop

CHANNEL, NODES = "maxon_epos4@5,generic_cia402@6", (5, 6)
SERVICES = (0x000, 0x080, 0x100, 0x180, 0x200, 0x280, 0x300, 0x380, 0x400, 0x480, 0x500, 0x580, 0x600, 0x700, 0x7E4)
INDICES = (0x1000, 0x1005, 0x1010, 0x1016, 0x1017, 0x1018, 0x1400, 0x1600, 0x1800, 0x1A00, 0x6040, 0x6060, 0x6071)
BEFORE_RESET = 1000
"""Frames after which a drive must still answer."""
PERIODS = 200
NOISE = 20
"""Frames in a period, on the average, as long as the master goes on."""
JUDGED = ("torque within limits", "slew within limits", "nothing enables again")
"""Laws that hold whatever the master hears; a forged statusword may well make it skip a state."""


def made_up(random: Random, nodes: tuple[int, ...]) -> can.Message:
    """A frame of any kind; most have identifiers that somebody listens to."""
    base = random.choice(SERVICES)
    can_id = min(base + random.choice((0, *nodes, 0x7F)), 0x7FF) if random.random() < 0.8 else random.randrange(0x800)
    data = random.randbytes(random.randrange(9))
    if random.random() < 0.3:
        index = random.choice(INDICES)
        data = bytes((random.randrange(256), index & 0xFF, index >> 8, random.randrange(5))) + random.randbytes(4)
    extended, remote = random.random() < 0.05, random.random() < 0.05
    return can.Message(
        arbitration_id=can_id | (random.randrange(1 << 18) << 11 if extended else 0),
        data=None if remote else data,
        dlc=len(data),
        is_remote_frame=remote,
        is_extended_id=extended,
    )


def mutated(random: Random, message: can.Message) -> can.Message:
    """The frame with another octet, bit, length or identifier."""
    data, can_id = bytearray(message.data), message.arbitration_id
    how = random.randrange(4)
    if how == 0 and data:
        data[random.randrange(len(data))] = random.randrange(256)
    elif how == 1 and data:
        data[random.randrange(len(data))] ^= 1 << random.randrange(8)
    elif how == 2:
        data = (data + random.randbytes(8))[: random.randrange(9)]
    else:
        can_id ^= 1 << random.randrange(11)
    return can.Message(arbitration_id=can_id & 0x7FF, data=data, is_extended_id=False)


def into_drive(seed: int, count: int) -> list[str]:
    """Send frames to two simulated drives; return what is wrong."""
    random, heard = Random(f"drive/{seed}"), deque[can.Message](maxlen=64)
    with SimulatedBus(CHANNEL, clock=VirtualClock()) as bus:
        for number in range(count):
            old = heard[random.randrange(len(heard))] if heard and random.random() < 0.5 else None
            frame = made_up(random, NODES) if old is None else mutated(random, old)
            try:
                bus.send(frame)
                while (message := bus.recv(random.choice((0.0, 0.0005)))) is not None:
                    heard.append(message)
                if number % BEFORE_RESET == BEFORE_RESET - 1 and not _comes_back(bus):
                    return [f"seed {seed}: after frame {number} not every drive comes back"]
            except Exception as crash:
                return [f"seed {seed}: frame {number}, {frame}: {type(crash).__name__}: {crash}"]
    return []


def _comes_back(bus: SimulatedBus) -> bool:
    """Whether every drive boots after a reset of all nodes."""
    bus.send(can.Message(arbitration_id=0, data=bytes((129, 0)), is_extended_id=False))
    booted = 0
    for _ in range(200):
        message = bus.recv(0.5)
        booted += message is not None and message.arbitration_id & 0x780 == 0x700 and bytes(message.data) == b"\0"
        if booted >= len(NODES):
            return True
    return False


class Babbling(SimulatedBus):
    """A master's port on which frames come that nobody on the wire has sent, from an instant on, up to `count`."""

    def __init__(self, world: World, random: Random, count: int, calm: bool) -> None:
        super().__init__(world=world)
        self.delivered = 0
        self.from_ns = 0
        self._random, self._count, self._calm = random, count, calm
        self._heard = deque[can.Message](maxlen=64)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        random = self._random
        babbles = self.clock.now_ns() >= self.from_ns and self.delivered < self._count
        if babbles and random.random() < NOISE / (NOISE + 4.0):
            self.delivered += 1
            return self._frame()
        message = super().recv(timeout)
        if message is not None:
            self._heard.append(message)
        return message

    def _frame(self) -> can.Message:
        random = self._random
        if self._calm:  # nothing that a master must end for: it hears many more
            frame = made_up(random, (77,))
            harmless = frame.is_extended_id or frame.is_remote_frame or frame.arbitration_id & 0x7F == 77
            return frame if harmless else can.Message(arbitration_id=0x5CD, data=frame.data, is_extended_id=False)
        old = self._heard[random.randrange(len(self._heard))] if self._heard and random.random() < 0.5 else None
        return made_up(random, (1,)) if old is None or old.is_error_frame else mutated(random, old)


def into_master(seed: int, count: int) -> list[str]:
    """Let masters hear frames until `count` have come; return what is wrong."""
    random, left, wrong = Random(f"master/{seed}"), count, list[str]()
    for number in range(count):
        if left <= 0:
            break
        delivered, said = _one_master(Random(f"master/{seed}/{number}"), random.choice(profiles()), left)
        left -= max(1, delivered)
        wrong += [f"seed {seed}/{number}: {sentence}" for sentence in said]
    return wrong


def _one_master(random: Random, profile: str, count: int) -> tuple[int, list[str]]:
    """One run with noise from some phase on: (frames that came, what is wrong)."""
    plan = api.plan("wall", drive=profile, settings={"wall.position": 0.001})
    (axis,), clock = plan.axes, VirtualClock()
    world = World(clock, can_section(plan.rig.bus[axis.rig.bus]).bitrate)
    drive: Any = world.add(DriveOnBus(axis.node, axis.profile, axis.rig, hand_named("push"))).drive
    bus = Babbling(world, random, count, random.random() < 0.5)
    phase = random.choice(("listening", "configuring", "enabled"))
    bus.from_ns = 0 if phase == "listening" else 1_100_000_000 if phase == "configuring" else 1 << 62
    plan_faults = drive.on_enabled

    def enabled(t_ns: int) -> None:
        bus.from_ns = min(bus.from_ns, t_ns + random.randrange(100_000_000))
        plan_faults(t_ns)

    drive.on_enabled = enabled
    with watched() as found:
        master = CanopenBus(bus, clock, owned=True)
        said = []
        try:
            master.open(plan)
            run_loop(plan, Cycle(plan), master, clock, cycles=PERIODS)
        except HapticFieldbusError:
            pass
        except Exception as crash:
            said.append(f"{phase}: {type(crash).__name__}: {crash}")
        finally:
            master.close()
    said += [f"{phase}: {law}: {sentence}" for law, sentence in found.broken if law in JUDGED]
    return bus.delivered, said
