"""One run from opened buses to a result: simulated or real, recorded, and torque-free at its end whatever happens."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import can

from haptic_fieldbus.buses.bus import Bus
from haptic_fieldbus.buses.canopen import CanopenBus
from haptic_fieldbus.buses.canopen_node import Node
from haptic_fieldbus.buses.canopen_setup import NO_ANSWER_ADVICE
from haptic_fieldbus.buses.group import BusGroup
from haptic_fieldbus.buses.wire import Wire, open_can
from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from haptic_fieldbus.cycle import Cycle, columns
from haptic_fieldbus.drive.catalogue import load_profile
from haptic_fieldbus.drive.profile import RATED_TORQUE_UNITS
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import BusTimeoutError, HapticFieldbusError, UsageError
from haptic_fieldbus.loop import LoopReport, run_loop
from haptic_fieldbus.planning import BusPlan, Plan
from haptic_fieldbus.record import FrameWriter, Record, open_frame_writer, write_rows
from haptic_fieldbus.report.summary import Run, summarise
from haptic_fieldbus.result import Result, known_before
from haptic_fieldbus.selection import Selection
from haptic_fieldbus.sim.bus import SimulatedBus
from haptic_fieldbus.sim.faults import Fault, faults_on
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.world import World

if TYPE_CHECKING:  # a run in which nothing changes does without them
    from haptic_fieldbus.changes import Changes

ENABLING_PERIODS = 4000
"""Rows kept for the time before operation enabled."""
LONGEST_RECORD = 2_000_000
"""Rows; of a longer run the last ones are kept."""


@dataclass(frozen=True)
class Request:
    """A compiled selection, and what happens while it runs; duration in s from operation enabled."""

    selection: Selection
    duration: float
    hand: Hand | None
    seed: int
    faults: tuple[Fault, ...]
    record: Path | None
    confirm: Callable[[str], bool] | None
    progress: Callable[[int, int], None] | None
    changes: "Changes | None" = None


@dataclass(frozen=True)
class Site:
    """Where a run takes place: a clock, and by name its CAN buses and, when these are simulated, the worlds behind."""

    clock: Clock
    can_buses: Mapping[str, can.BusABC]
    worlds: Mapping[str, World]


def render(request: Request) -> Result:
    """Run and summarise; errors carry what is known by then as `result`."""
    plan = request.selection.plan
    cycles = max(1, round(request.duration * plan.rate))
    cycle, report = Cycle(plan), LoopReport()
    record = Record(columns(plan), min(cycles, LONGEST_RECORD) + ENABLING_PERIODS)
    started = perf_counter()
    try:
        with _recording(request.record, record) as log:
            site = open_site(request)
            bus = _master(site, log)
            try:
                bus.open(plan)
                _ask(request, plan, bus)
                progress = _counted(request.progress, cycles)
                run_loop(
                    plan,
                    cycle,
                    bus,
                    site.clock,
                    cycles=cycles,
                    record=record,
                    progress=progress,
                    report=report,
                    changes=request.changes,
                )
            finally:
                bus.close()
    except HapticFieldbusError as error:
        error.result = known_before(request.selection, report, cycle.trip, str(error))
        raise
    elapsed = perf_counter() - started
    result = summarise(Run(request.selection, cycle, record, report, site.worlds, site.clock.name, elapsed))
    return replace(result, warnings=tuple(bus.warnings))


def open_site(request: Request) -> Site:
    """A simulated world for each bus, all in one virtual time, or the real buses of the plan."""
    plan = request.selection.plan
    if not request.selection.bus.simulated:
        return Site(MonotonicClock(), _open_all(plan), {})
    _check_faults(request.faults, plan)
    clock = VirtualClock()
    worlds = {bus.name: _world(request, bus, clock) for bus in plan.buses}
    names = [bus.name if len(plan.buses) > 1 else "" for bus in plan.buses]
    can_buses = {
        bus.name: SimulatedBus(name, world=worlds[bus.name]) for bus, name in zip(plan.buses, names, strict=True)
    }
    return Site(clock, can_buses, worlds)


def _open_all(plan: Plan) -> dict[str, can.BusABC]:
    """All buses of the plan, or none."""
    can_buses: dict[str, can.BusABC] = {}
    with ExitStack() as opened:
        for bus in plan.buses:
            can_buses[bus.name] = open_can(plan.rig.bus[bus.name])
            opened.callback(can_buses[bus.name].shutdown)
        opened.pop_all()
    return can_buses


def _check_faults(faults: tuple[Fault, ...], plan: Plan) -> None:
    names = [bus.name for bus in plan.buses]
    unknown = [
        f'fault "{fault.kind}" is on the bus "{fault.bus}"; this run has: {", ".join(names)}'
        for fault in faults
        if fault.bus is not None and fault.bus not in names
    ]
    if unknown:
        raise UsageError("\n".join(unknown))


def _world(request: Request, bus: BusPlan, clock: Clock) -> World:
    """One simulated bus with its drives."""
    plan, hand = request.selection.plan, request.hand
    world = World(clock, bus.bitrate, _seed(request, bus))
    for axis in plan.on(bus).axes:
        waiting = hand.after(axis.limits.fade_in) if hand is not None and plan.scene.holds(axis.name) else None
        world.add_drive(axis.node, axis.profile, axis.rig, waiting, faults=faults_on(request.faults, bus.name))
    return world


def _seed(request: Request, bus: BusPlan) -> int | str:
    """Drives are drawn by their node-ID; where an earlier bus has the same, by the name of the bus too."""
    plan = request.selection.plan
    before = plan.buses[: plan.buses.index(bus)]
    taken = {axis.node for other in before for axis in plan.on(other).axes}
    twins = any(axis.node in taken for axis in plan.on(bus).axes)
    return f"{request.seed}/{bus.name}" if twins else request.seed


def _master(site: Site, log: FrameWriter | None) -> Bus:
    """One bus as it is, several as a group, each of them with its own channel in the record."""
    if len(site.can_buses) == 1:
        (can_bus,) = site.can_buses.values()
        return CanopenBus(can_bus, site.clock, log, owned=True)
    logs = {name: None if log is None else log.channel(name) for name in site.can_buses}
    return BusGroup(
        {name: CanopenBus(can_bus, site.clock, logs[name], owned=True) for name, can_bus in site.can_buses.items()}
    )


def read_rated_torques(rig: Rig) -> Rig:
    """Fill in each axis' rated torque from its drive, where the rig does not give it; raises BusError."""
    axes = {}
    for name, axis in rig.axis.items():
        mapped = load_profile(axis.profile).torque.rated
        if axis.rated_torque is None and mapped is not None:
            can_bus = open_can(rig.bus[axis.bus])
            try:
                wire = Wire(can_bus, MonotonicClock(), can_bus.channel_info)
                raw = Node(wire, axis.node, f"node {axis.node} (axis {name})").read(mapped.entry)
            except BusTimeoutError as error:
                raise BusTimeoutError(f"{error}. {NO_ANSWER_ADVICE}") from error
            finally:
                can_bus.shutdown()
            axis = replace(axis, rated_torque=raw * RATED_TORQUE_UNITS[mapped.unit])
        axes[name] = axis
    return replace(rig, axis=axes)


def _ask(request: Request, plan: Plan, bus: Bus) -> None:
    """On a bus that is not simulated nothing moves until somebody says so."""
    if request.selection.bus.simulated:
        return
    question = "\n".join(_warning(plan, name, bus) for name in bus.facts)
    if request.confirm is None or not request.confirm(question):
        raise UsageError("not enabled: on a real bus nothing moves until it is confirmed (--yes for scripts)")


def _warning(plan: Plan, name: str, bus: Bus) -> str:
    axis = next(axis for axis in plan.axes if axis.name == name)
    facts = bus.facts[name]
    share = axis.limits.effort / (1000.0 * axis.effort_unit)
    serial = "" if facts.serial is None else f" (serial {facts.serial:#06x})"
    return (
        f"about to enable torque on {facts.title}, node {facts.node}, {plan.rig.bus[axis.rig.bus].channel}{serial}: "
        f"at most {100 * share:.0f} % of rated torque, {axis.limits.speed:g} {axis.workspace.length_unit}/s; "
        f"{facts.link_loss}, confirmed in the drive."
    )


def _counted(progress: Callable[[int, int], None] | None, cycles: int) -> Callable[[int], None] | None:
    return None if progress is None else lambda done: progress(done, cycles)


@contextmanager
def _recording(path: Path | None, record: Record) -> Iterator[FrameWriter | None]:
    """A writer for frames, where they are asked for; rows are written at the end, however it comes."""
    writer = open_frame_writer(path) if path is not None else None
    try:
        yield writer
    finally:
        if writer is not None:
            writer.close()
        elif path is not None:
            write_rows(record, path)
