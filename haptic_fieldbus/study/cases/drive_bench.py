"""Bench of the cases in `drive`: a plan without files, a cycle fed with octets, and a short simulated run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from haptic_fieldbus.assessing.loop_report import LoopReport
from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.cycle.safety import TripKind
from haptic_fieldbus.defaults import DEFAULT_DRIVE, DEFAULT_RATE
from haptic_fieldbus.drive.rig import Limits, LinearMechanism, Rig, default_axis
from haptic_fieldbus.errors import BusError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.running.loop import run_loop
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.faults import BusOff, Fault
from haptic_fieldbus.sim.hand import hand_named

PERIOD_NS = 1_000_000
COUNT = 0.05 / 4096
"""Encoder count at the handle [m]: 50 mm a turn of 4096 counts."""
UNIT = 0.4 / 1000 / (0.05 / (2 * math.pi))
"""Step of torque at the handle [N]: a thousandth of the rated 0.4 N·m."""
ENABLED = 0x0637
"""Statusword of operation enabled."""
FADED_IN = 501
"""Periods of the fade-in of 0.5 s at 1 kHz, and one more."""
CONTACT = 0.6
"""Time at which the bus is lost [s]; the pushing hand is in the wall by then."""


def plan_of(
    *elements: Element,
    workspace: Workspace = Workspace.LINEAR,
    radius: float | None = None,
    limits: Limits | None = None,
    estimator: str | None = None,
) -> Plan:
    """Return a plan on the shipped bench; `radius` [m] replaces that of a linear mechanism."""
    scene = Scene("case", "a case of the report", (SceneAxis("handle", workspace),), elements)
    axis = default_axis(workspace, bus="sim", node=1, profile=DEFAULT_DRIVE)
    if radius is not None and workspace is Workspace.LINEAR:
        axis = replace(axis, mechanism=LinearMechanism("linear", 2 * math.pi * radius))
    axis = replace(axis, limits=limits or axis.limits)
    rig = Rig({"sim": CanSection("haptic_sim", "sim")}, {"handle": axis})
    return compile_plan(scene, rig, {DEFAULT_DRIVE: load_profile(DEFAULT_DRIVE)}, DEFAULT_RATE, estimator=estimator)


class Feeder(Cycle):
    """Cycle that keeps its plan, with which its octets are packed."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self.plan = plan

    def value(self, name: str) -> float:
        """Return a column of the handle in the last period."""
        return self.row[self.columns.index(f"handle.{name}")]

    @property
    def tripped(self) -> TripKind | None:
        """Kind of the trip; None when there was none."""
        return self.trip.kind if self.trip else None


def feed(cycle: Feeder, counts: int = 0, flags: int = 0, t_ns: int = 0) -> bytes:
    """Run one period in operation enabled at this position, and return the octets of the output image."""
    return bytes(cycle(cycle.plan.image.input.pack(t_ns, 0, flags, 0, ENABLED, counts)))


def torque(cycle: Feeder, counts: int = 0, flags: int = 0, t_ns: int = 0) -> int:
    """Run one period, and return its target torque [‰ of rated torque]."""
    return int(cycle.plan.image.output.unpack(feed(cycle, counts, flags, t_ns))[-1])


def running_feeder(plan: Plan, counts: int = 0, t_ns: int = 0) -> Feeder:
    """Return a cycle that has been in operation enabled, at rest, until force is faded in."""
    cycle = Feeder(plan)
    for _ in range(FADED_IN):
        feed(cycle, counts, t_ns=t_ns)
    return cycle


@dataclass(frozen=True)
class BusOffOutcome:
    """End of a simulated run in which the bus was lost."""

    error: str
    """Class of the error that ended the run; "none" without one."""
    guard: float
    """Guard time that the drive was given [s]."""
    pushed: float
    """Target torque of the drive when the bus was lost [N·m]."""
    torque_free_after: float
    """Time from the loss to a target torque of 0 [s]; ∞ when it was not 0 at the end."""


def _run(plan: Plan, clock: VirtualClock, cycles: int, faults: Sequence[Fault]) -> tuple[World, LoopReport, str]:
    """Run a plan on the simulated drive with a pushing hand; return the world, the report and the error's class."""
    world, report, error = World(clock, 1_000_000), LoopReport(), "none"
    axis = plan.axes[0]
    world.add_drive(axis.node, axis.profile, axis.rig, hand_named("push"), faults=faults)
    bus = CanopenBus(SimulatedBus(world=world), clock, None, owned=True)
    try:
        bus.open(plan)
        run_loop(plan, Cycle(plan), bus, clock, cycles=cycles, report=report)
    except BusError as raised:
        error = type(raised).__name__
    finally:
        bus.close()
    return world, report, error


def bus_off_in_contact() -> BusOffOutcome:
    """Run into a bus-off of our own controller while the wall pushes back, then watch the drive for 0.5 s."""
    plan, clock = plan_of(Wall("handle", stiffness=600.0, position=0.02)), VirtualClock()
    world, report, error = _run(plan, clock, 700, [BusOff("bus_off", CONTACT)])
    clock.sleep_until(clock.now_ns() + 500_000_000)
    times, torques = world.trajectory(plan.axes[0].node).targets()
    lost_ns = (report.enabled_at_ns or 0) + round(CONTACT * 1e9)
    held = [float(torque) for at, torque in zip(times, torques, strict=True) if at <= lost_ns]
    ended = [int(at) for at, torque in zip(times, torques, strict=True) if at > lost_ns and torque == 0.0]
    free = (ended[0] - lost_ns) * 1e-9 if ended and torques[-1] == 0.0 else math.inf
    return BusOffOutcome(error, canopen_profile(plan.axes[0].profile).link_loss.deadline, held[-1], free)


def odd_periods(start_ns: int, cycles: int) -> tuple[int, int]:
    """Return how many periods had a wrong length, and how many there were; the clock begins at `start_ns`."""
    _, report, _ = _run(plan_of(Wall("handle", stiffness=600.0)), VirtualClock(start_ns), cycles, ())
    return int((report.sample("period_ns")[1:] != PERIOD_NS).sum()), report.cycles
