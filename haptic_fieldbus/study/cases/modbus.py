"""Case of a request that writes before it reads: on Modbus its torque acts one whole period late."""

import math
from dataclasses import replace

from haptic_fieldbus.assessing.record import Record
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.margins import Plant
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.bus import SIM_TCP, SIMULATION_CHANNEL, ModbusSection
from haptic_fieldbus.protocols.modbus.profile import modbus_profile
from haptic_fieldbus.running.loop import run_loop
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from haptic_fieldbus.sim.hand import hand_named
from haptic_fieldbus.sim.modbus.site import SIMULATION
from haptic_fieldbus.sim.slot import Slot
from haptic_fieldbus.study.case import CaseResult, share_used
from haptic_fieldbus.study.oracles.polynomials import schur_cohn_limit

DRIVE = "generic_cia402_modbus"
PERIOD = 1e-3
NETWORK = 0.5e-3
"""Time that a request and its answer take in the network [s]."""
FASTEST = 1e8
"""Bandwidth of a torque loop without lag [Hz], which the oracle does not know."""


def modbus_one_period(quick: bool) -> CaseResult:
    """Check that by function 23 each torque acts a period after its sample, and that the limit is that of such a delay.

    The limit is compared with a polynomial in 60 digits; the instants at which torque changed in the simulated drive
    with those of the samples that it was computed from.
    """
    plan = _plan()
    plant = plan.axes[0].plant
    limit = plan.stability.stiffness_limit.stable if plan.stability is not None else None
    if plant is None or limit is None:
        raise ValueError("the shipped bench on Modbus has a limit of stability")
    exact = schur_cohn_limit(Plant(plant.mass, plant.damping), PERIOD, 1.0)
    late = _late(plan, 800 if quick else 3000)
    worst = max(abs(each - PERIOD) for each in late)
    return CaseResult(
        f"limit {exact:.3f} N/m; each of at least 50 changes of torque {exactly(1e3 * PERIOD)} ms after its sample",
        f"limit off by {rounded(abs(limit / exact - 1.0), 1)} (1e-5 allowed); {len(late)} changes, off by at most "
        f"{rounded(1e9 * worst, 2)} ns (2 allowed)",
        abs(limit / exact - 1.0) <= 1e-5 and len(late) >= 50 and worst <= 2e-9,
        "polynomial of a loop with one period of delay, by Schur and Cohn; instants at the drive, which knows no plan",
        tolerance="1e-5 of the limit; 2 ns",
        used=share_used((limit / exact - 1.0, 1e-5), (worst, 2e-9)),
    )


def _plan() -> Plan:
    """Return a wall on the shipped bench, over a network in which two requests do not fit into a period.

    The drive has no lag of its own.
    """
    profile = modbus_profile(load_profile(DRIVE))
    profile = replace(profile, timing=replace(profile.timing, torque_bandwidth=FASTEST, control_period=0.0))
    wall = Wall("handle", stiffness=300.0, position=0.005)
    scene = Scene("case", "a case of the report", (SceneAxis("handle", Workspace.LINEAR),), (wall,))
    axis = default_axis(Workspace.LINEAR, bus="line", node=1, profile=DRIVE)
    rig = Rig({"line": ModbusSection(SIM_TCP, SIMULATION_CHANNEL, round_trip=NETWORK)}, {"handle": axis})
    return compile_plan(scene, rig, {DRIVE: profile}, 1.0 / PERIOD)


def _late(plan: Plan, cycles: int) -> list[float]:
    """Return how long after its sample each new torque acted in the drive [s]."""
    axis, clock = plan.axes[0], VirtualClock()
    hand = hand_named("push")
    slot = Slot(axis.node, axis.profile, axis.rig, None if hand is None else hand.after(axis.limits.fade_in))
    bus, line = SIMULATION.simulate(plan.rig.bus["line"], "", [slot], clock, 0, None)
    record = Record(columns(plan), cycles + 1000)
    try:
        bus.open(plan)
        run_loop(plan, Cycle(plan), bus, clock, cycles=cycles, record=record)
        if line is None:
            return [math.inf]
        times, torques = line.trajectory(axis.node).targets()
    finally:
        bus.close()
    acted = {round(1e6 * float(torque)): int(at) for at, torque in zip(times[::-1], torques[::-1], strict=True)}
    unit = axis.effort_unit * axis.rig.mechanism.ratio
    found: dict[int, int] = {}
    for at, target in zip(record.column("t_ns"), record.column("handle.target torque"), strict=True):
        found.setdefault(round(1e6 * float(target) * unit), int(at))
    return [1e-9 * (acted[torque] - at) for torque, at in found.items() if torque and torque in acted]
