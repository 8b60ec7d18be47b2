"""How long the torque of a simulated drive lasts after each cause for which it is taken away."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache

import can
import numpy as np

from haptic_fieldbus.api import plan
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.deadlines import REMAINDER, EndCause
from haptic_fieldbus.planning.limits import ECHO_SHARE, ECHO_STEPS
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.builders import can_traffic, endless_rig, shipped
from tests.whole_loop import run_loop

RATES = (1000.0, 250.0, 50.0)
AT_EVERY_RATE = ("generic_cia402", "maxon_epos4")
PROFILES = {
    name: RATES if name in AT_EVERY_RATE else RATES[:1] for name in shipped() if load_profile(name).drive.usable
}
"""Shipped CANopen drives that take torque, and the rates at which each is measured [Hz]."""
PHASES = (0.05, 0.35, 0.65, 0.95)
"""Of an event, in periods after a whole number of them from operation enabled."""
CONTACT = 1.2
"""[s] after operation enabled; the pushing hand is in the wall by then."""
SWINGING = 0.5
"""[s] after operation enabled; the hand has met the wall, and is not at rest yet."""
WATCHED_NS = 700_000_000
"""How long the motor is looked at after an event; longer than any deadline."""
GRID_NS = 20_000
MASTER_HEARTBEAT = 0x77F
CONTROLWORD_OCTETS = 2
"""Of the RPDO, before the target torque."""


FaultsAt = Callable[[float], tuple[faults.Fault, ...]]
"""Faults by the time of the event [s from operation enabled]."""


class Eventful(VirtualClock):
    """A clock on which something happens at one instant, once, when somebody waits for a later one."""

    def __init__(self) -> None:
        super().__init__()
        self.event_ns: int | None = None
        self.event: Callable[[], None] = lambda: None

    def sleep_until(self, deadline_ns: int) -> int:
        event_ns = self.event_ns
        if event_ns is not None and event_ns <= deadline_ns:
            self.event_ns = None
            super().sleep_until(event_ns)
            self.event()
        return super().sleep_until(deadline_ns)


class Mortal(CanopenBus):
    """A master of which nothing comes any more once it is `dead`, as after kill -9; who reads from it stands still."""

    dead = False

    def begin(self) -> None:
        if not self.dead:
            super().begin()

    def write(self, image: bytes | bytearray) -> None:
        if not self.dead:
            super().write(image)

    def stop(self) -> bool:
        return self.dead or super().stop()


@cache
def planned(profile: str, rate: float) -> Plan:
    """A wall of half the stiffness that is stable."""
    return plan("wall", endless_rig("wall", profile), rate=rate, settings={"wall.stiffness": "max/2"})


class Bench:
    """A drive in contact with a wall, its master, and one event; all in virtual time."""

    def __init__(
        self,
        profile: str,
        rate: float,
        phase: float = 0.0,
        faults_at: FaultsAt = lambda at: (),
        *,
        after: float = CONTACT,
    ) -> None:
        self.plan = planned(profile, rate)
        (self.axis,) = self.plan.axes
        self.at = round(after * rate) / rate + phase / rate
        """Time of the event [s from operation enabled]."""
        self.event_ns = 0
        self.clock = Eventful()
        self.world = World(self.clock, can_traffic(self.plan).bitrate)
        self.drive = self.world.add(
            DriveOnBus(self.axis.node, self.axis.profile, self.axis.rig, hand_named("push"), faults=faults_at(self.at))
        ).drive
        self._plan_faults, self.drive.on_enabled = self.drive.on_enabled, self._enabled
        self.bus = Mortal(SimulatedBus(world=self.world), self.clock, owned=True)
        self.other = SimulatedBus(world=self.world)
        """Of another program."""
        self.event: Callable[[], None] | None = None
        self.error: Exception | None = None

    def _enabled(self, t_ns: int) -> None:
        self._plan_faults(t_ns)
        self.event_ns = t_ns + round(self.at * 1e9)
        if self.event is not None:
            self.clock.event, self.clock.event_ns = self.event, self.event_ns

    def run(self, seconds: float = 10.0) -> float:
        """Run until the event has ended it; returns the time from the event to zero torque [s]."""
        self.bus.open(self.plan)
        try:
            run_loop(self.plan, Cycle(self.plan), self.bus, self.clock, cycles=round(seconds * self.plan.rate))
        except HapticFieldbusError as error:
            self.error = error
        return self.torque_lasted()

    def torque_lasted(self) -> float:
        """Time from the event to the last torque that is not zero [s]."""
        self.clock.sleep_until(self.event_ns + WATCHED_NS)
        times = np.arange(self.event_ns, self.event_ns + WATCHED_NS, GRID_NS)
        torque = np.abs(self.world.trajectory(self.axis.node).sample(times)[2])
        assert torque[0] > 0.01, "in contact the motor pushes"
        return float(np.flatnonzero(torque > REMAINDER * torque[0]).max(initial=0) + 1) * GRID_NS * 1e-9

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()
        self.other.shutdown()

    def other_program(self, can_id: int, *data: int) -> None:
        """A frame of somebody else on the bus."""
        self.other.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def _fault(make: Callable[[float], faults.Fault]) -> Callable[[str, float, float], float]:
    def measure(profile: str, rate: float, phase: float) -> float:
        with Bench(profile, rate, phase, lambda at: (make(at),)) as bench:
            return bench.run()

    return measure


def _nmt(command: int) -> Callable[[str, float, float], float]:
    def measure(profile: str, rate: float, phase: float) -> float:
        with Bench(profile, rate, phase) as bench:
            bench.event = lambda: bench.other_program(0x000, command, bench.axis.node)
            return bench.run()

    return measure


def _without_effect(profile: str, rate: float, phase: float) -> float:
    """The event is the first set-point that the drive should have shown to be another one than that which it holds.

    While the hand still swings in the wall: where it leans, torque is constant, and a constant one needs no proof.
    """

    def lost(at: float) -> tuple[faults.Fault, ...]:
        return (faults.MissingRpdos("missing_rpdos", at),)

    with Bench(profile, rate, phase, lost, after=SWINGING) as bench:
        axis = bench.axis
        lags = axis.profile.echo is Signal.TORQUE_ACTUAL
        noticed = ECHO_SHARE * axis.rated_effort / axis.effort_unit if lags else ECHO_STEPS
        lost_ns = held = 0

        def tapped(t_ns: int, can_id: int, data: bytes) -> None:
            nonlocal lost_ns, held
            if can_id != 0x200 + axis.node or not bench.event_ns:
                return
            target = int.from_bytes(data[CONTROLWORD_OCTETS:], "little", signed=True)
            lost_ns = lost_ns or bench.event_ns
            if t_ns < lost_ns:
                held = target
            elif bench.event_ns == lost_ns and abs(target - held) > noticed:
                bench.event_ns = t_ns

        bench.world.tap(tapped)
        return bench.run()


def _killed(profile: str, rate: float, phase: float) -> float:
    """Right after a heartbeat, or a request of node guarding and its answer, so that the guard takes longest."""
    with Bench(profile, rate, phase) as bench:
        guarded = can_traffic(bench.plan).members[0].traffic.life_guarding
        proof = 0x700 + bench.axis.node if guarded else MASTER_HEARTBEAT

        def tapped(t_ns: int, can_id: int, _data: bytes) -> None:
            if can_id == proof and bench.event_ns and t_ns >= bench.event_ns and not bench.bus.dead:
                bench.bus.dead, bench.event_ns = True, t_ns

        bench.world.tap(tapped)
        return bench.run()


def _stopped(profile: str, rate: float, phase: float) -> float:
    """It stands still for longer than any guard, then goes on, and must not take hold again."""
    with Bench(profile, rate, phase) as bench:
        bench.event = lambda: bench.clock.compute(WATCHED_NS // 2)
        return bench.run()


def _interrupted(profile: str, rate: float, phase: float) -> float:
    def interrupt() -> None:
        raise KeyboardInterrupt

    with Bench(profile, rate, phase) as bench:
        bench.event = interrupt
        return bench.run()


def _ended(profile: str, rate: float, phase: float) -> float:
    """The event is the latch of the period after the last."""
    with Bench(profile, rate) as bench:
        return bench.run(bench.at)


MEASURED: dict[EndCause, tuple[Callable[[str, float, float], float], ...]] = {
    EndCause.TRIP: (_fault(lambda at: faults.EncoderJump("encoder_jump", at, 20_000)),),
    EndCause.FEEDBACK: (_fault(lambda at: faults.MissingTpdos("missing_tpdos", at, 10_000)),),
    EndCause.FAULT: (
        _fault(lambda at: faults.DriveFault("drive_fault", at)),
        _fault(lambda at: faults.Emergency("emergency", at, 0x3210)),
    ),
    EndCause.RESET: (_fault(lambda at: faults.NodeReset("node_reset", at)),),
    EndCause.HEARTBEAT: (_fault(lambda at: faults.HeartbeatLost("heartbeat_lost", at)),),
    EndCause.NOT_OPERATIONAL: (_nmt(0x80), _nmt(0x02)),
    EndCause.DISCONNECTED: (
        _fault(lambda at: faults.BusOff("bus_off", at)),
        _fault(lambda at: faults.Silence("silence", at)),
    ),
    EndCause.KILLED: (_killed,),
    EndCause.STOPPED: (_stopped,),
    EndCause.NO_EFFECT: (_without_effect,),
    EndCause.END: (_interrupted, _ended),
}
"""Actions for each cause, more than one thing where there are several."""


@dataclass(frozen=True)
class Row:
    """One line of the table [s]; `measured` is the longest of all phases."""

    profile: str
    rate: float
    cause: EndCause
    stated: float
    measured: float


def measured(profile: str, rate: float, cause: EndCause, phases: tuple[float, ...] = PHASES) -> float:
    """The longest time from the event to zero torque [s]."""
    return max(measure(profile, rate, phase) for measure in MEASURED[cause] for phase in phases)


def table() -> Iterator[Row]:
    """Every cause on every profile at its rates."""
    for profile, rates in PROFILES.items():
        for rate in rates:
            for each in planned(profile, rate).deadlines:
                yield Row(profile, rate, each.cause, each.seconds, measured(profile, rate, each.cause))
