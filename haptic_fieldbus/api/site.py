"""The site of a run: simulated worlds that share one virtual time, or the real buses of the plan."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from random import Random
from typing import Any, cast

from haptic_fieldbus.assessing.recording import Truth
from haptic_fieldbus.buses.access import BusAccess
from haptic_fieldbus.buses.bus import StepwiseBus
from haptic_fieldbus.clock import Clock, MonotonicClock, VirtualClock
from haptic_fieldbus.defaults import DEFAULT_SEED
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError, raise_all
from haptic_fieldbus.planning.plan import BusPlan, Plan
from haptic_fieldbus.protocols.registry import added
from haptic_fieldbus.running.session import Site
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.faults import Fault, HostFault, faults_on, of_no_drive
from haptic_fieldbus.sim.hand import Hand
from haptic_fieldbus.sim.simulation import HostClock, Simulation

# Objects as texts, so that a run imports only the protocols of its buses.
ACCESS = {
    "canopen": "haptic_fieldbus.buses.canopen.access:ACCESS",
    "modbus": "haptic_fieldbus.buses.modbus.access:ACCESS",
}
SIMULATIONS = {
    "canopen": "haptic_fieldbus.sim.canopen.site:SIMULATION",
    "modbus": "haptic_fieldbus.sim.modbus.line:SIMULATION",
}
BUS_GROUP, SIMULATION_GROUP = "haptic_fieldbus.buses", "haptic_fieldbus.simulations"
"""Entry point groups in which a package adds the real and the simulated half of its protocol."""


@contextmanager
def site_of(
    plan: Plan,
    record: Path | None = None,
    hand: Hand | None = None,
    seed: int = DEFAULT_SEED,
    faults: tuple[Fault, ...] = (),
    time: VirtualClock | None = None,
) -> Iterator[Site]:
    """Open all buses of a plan, or none, and yield them as a site; frames are recorded if `record` is a file for them.

    `hand`, `seed` (of all random numbers), `faults` and `time` are the conditions on a simulated bench. Raises
    UsageError or BusError.
    """
    if plan.simulated:
        _check_faults(faults, plan)
    clock = _clock(plan, seed, faults, time or VirtualClock()) if plan.simulated else MonotonicClock()
    buses: dict[str, StepwiseBus] = {}
    worlds: dict[str, Truth] = {}
    log_faults: list[str] = []
    with ExitStack() as opened:
        logs = _logs(plan, record, opened, log_faults)
        with ExitStack() as failing:
            for part in plan.buses:
                log = logs.get(part.name)
                if plan.simulated:
                    buses[part.name], world = simulated_bus(plan, part, clock, log, hand, seed, faults)
                    worlds |= {} if world is None else {part.name: world}
                else:
                    buses[part.name] = access_of(part.protocol).open_bus(plan.rig.bus[part.name], clock, log)
                # Closes the buses that are open when a later one fails; a site that is complete is closed by the run.
                failing.callback(buses[part.name].close)
            failing.pop_all()
        yield Site(clock, buses, worlds, "" if hand is None else hand.name, log_faults)


def _clock(plan: Plan, seed: int, faults: Sequence[Fault], time: VirtualClock) -> Clock:
    """Return the clock of a simulated run; only a host that is faulty, or late by chance, has one of its own."""
    most_ns = round(1e9 * max(plan.rig.bus[bus.name].lateness for bus in plan.buses))
    if most_ns:
        draw = Random(f"{seed}/host")
        return HostClock(time, iter(lambda: draw.randrange(most_ns + 1), None))
    return HostClock(time) if any(isinstance(fault, HostFault) for fault in faults) else time


def ask_rated_torques(rig: Rig) -> Rig:
    """Return the rig with its missing rated torques read from the drives; None stays where a drive has none.

    Raises BusError, or UsageError when a protocol has no real bus.
    """
    axes = {}
    for name, axis in rig.axis.items():
        if axis.rated_torque is None:
            section = rig.bus[axis.bus]
            axis = replace(axis, rated_torque=access_of(section.protocol).rated_torque(section, name, axis))
        axes[name] = axis
    return replace(rig, axis=axes)


def fit_profiles(rig: Rig) -> tuple[Rig, dict[str, DriveProfile]]:
    """Return the rig with a name of its own for each profile that was fitted to its drive, and these profiles.

    Raises BusError, or UsageError when a protocol has no real bus.
    """
    axes, profiles = dict(rig.axis), dict[str, DriveProfile]()
    for name in sorted({axis.bus for axis in rig.axis.values()}):
        on_it = {axis: each for axis, each in rig.axis.items() if each.bus == name}
        for axis, profile in access_of(rig.bus[name].protocol).fitted(rig.bus[name], on_it).items():
            # Two axes may have the same profile, but never the same drive.
            own = f"{rig.axis[axis].profile} of {axis}"
            axes[axis], profiles[own] = replace(rig.axis[axis], profile=own), profile
    return replace(rig, axis=axes), profiles


def _logs(plan: Plan, record: Path | None, opened: ExitStack, faults: list[str]) -> dict[str, Any]:
    """Return the recorders of frames by bus; each protocol opens its own. An error at their end goes to `faults`.

    Raises UsageError when a file cannot be begun.
    """
    logs: dict[str, Any] = {}
    for protocol in dict.fromkeys(bus.protocol for bus in plan.buses):
        names = [bus.name for bus in plan.buses if bus.protocol == protocol]
        recorder = ExitStack()
        try:
            logs |= recorder.enter_context(access_of(protocol).logs(record, names, simulated=plan.simulated))
        except OSError as error:
            raise UsageError(f"cannot record to {record}: {error.strerror}") from error
        opened.callback(_closed, recorder, faults)
    return logs


def _closed(recorder: ExitStack, faults: list[str]) -> None:
    """Close a recorder; what keeps it from being complete must not hide how the run went."""
    try:
        recorder.close()
    except Exception as error:
        faults.append(getattr(error, "strerror", None) or str(error))


def simulated_bus(
    plan: Plan,
    bus: BusPlan,
    clock: Clock,
    log: object = None,
    hand: Hand | None = None,
    seed: int = DEFAULT_SEED,
    faults: Sequence[Fault] = (),
) -> tuple[StepwiseBus, Truth | None]:
    """Return one simulated bus and the true motion of its drives; the hand waits until the force has faded in."""
    slots, simulation = [], _simulation(bus.protocol)
    here = tuple(fault for fault in faults_on(faults, bus.name) if fault.kind in simulation.kinds)
    for axis in plan.on(bus).axes:
        waiting = hand.after(axis.limits.fade_in) if hand is not None and plan.scene.holds(axis.name) else None
        slots.append(DriveOnBus(axis.node, axis.profile, axis.rig, waiting, here))
    channel = bus.name if len(plan.buses) > 1 else ""
    return simulation.simulate(plan.rig.bus[bus.name], channel, slots, clock, _seed(plan, bus, seed), log)


def _seed(plan: Plan, bus: BusPlan, seed: int) -> int | str:
    """Return the seed of a bus, with its name where an earlier bus has a drive of the same node-ID."""
    # Drives draw their numbers by seed and node-ID: twins would draw the same numbers.
    before = plan.buses[: plan.buses.index(bus)]
    taken = {axis.node for other in before for axis in plan.on(other).axes}
    return f"{seed}/{bus.name}" if any(axis.node in taken for axis in plan.on(bus).axes) else seed


def _check_faults(faults: Sequence[Fault], plan: Plan) -> None:
    kinds: dict[str | None, frozenset[str]] = {bus.name: _simulation(bus.protocol).kinds for bus in plan.buses}
    known = {None: frozenset[str]().union(*kinds.values()), **kinds}
    protocols = ", ".join(dict.fromkeys(bus.protocol for bus in plan.buses))
    wrong: list[str] = []
    for fault in faults:
        if fault.bus not in known:
            buses = ", ".join(map(str, kinds))
            wrong.append(f'fault "{fault.kind}" names the bus "{fault.bus}"; this run has: {buses}')
            continue
        if fault.kind not in known[fault.bus]:
            wrong.append(f'no bus of this run supports the fault "{fault.kind}" ({protocols}); remove it')
        named = [plan.on(bus) for bus in plan.buses if fault.bus in (None, bus.name)]
        wrong += of_no_drive((fault,), {axis.node for part in named for axis in part.axes})
    raise_all(wrong)


def kinds_on(plan: Plan) -> tuple[str, ...]:
    """Return the kinds of faults that may be drawn for a plan: what happens at an instant, on any of its buses."""
    from haptic_fieldbus.sim.faults.drawing import ANSWER_RECIPES, RECIPES

    here = frozenset[str]().union(*(_simulation(bus.protocol).kinds for bus in plan.buses))
    return tuple(kind for kind in (*RECIPES, *ANSWER_RECIPES) if kind in here)


def access_of(protocol: str) -> BusAccess:
    """Return the half of a protocol that does I/O; raises UsageError when there is none."""
    return cast(BusAccess, _found(ACCESS, BUS_GROUP, protocol, "real bus"))


def _simulation(protocol: str) -> Simulation:
    return cast(Simulation, _found(SIMULATIONS, SIMULATION_GROUP, protocol, "simulated bus"))


def _found(built_in: dict[str, str], group: str, protocol: str, what: str) -> object:
    """Return one half of a protocol, built in or added by a package; raises UsageError when there is none."""
    if protocol in built_in:
        module, name = built_in[protocol].split(":")
        return getattr(import_module(module), name)
    if protocol not in added(group):
        raise UsageError(f"{protocol} has no {what}: no installed package provides it (entry point group {group})")
    return added(group)[protocol].load()
