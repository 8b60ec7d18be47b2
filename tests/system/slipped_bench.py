"""A simulated bench that is not what its rig says: slips of unit and of digit in the rig, and the motor as it is."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from random import Random
from typing import Any

import numpy as np

from haptic_fieldbus.api.site import _simulation
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.cycle.cycle import Cycle
from haptic_fieldbus.drive.rig import Rig, RigAxis, Seen, torque_step
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.signals import Signal
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import HANDS
from tests.builders import shipped
from tests.whole_loop import run_loop

SLIPS = (1000.0, 1e-3, 4.0, 0.25, 1e6, 1e-6, 180.0 / math.pi, math.pi / 180.0, 10.0, 0.1, 2.0 * math.pi)
"""A prefix or two, lines for counts, degrees, a digit, radians for turns."""
DESCRIPTIVE = (
    "rated_torque",
    "torque_constant",
    "rated_current",
    "peak_current",
    "inertia",
    "viscous_damping",
    "coulomb_friction",
    "encoder_counts_per_revolution",
    "mechanism",
    "sign",
)
"""Keys of a rig that describe a bench; `mechanism`: the way of the handle in a turn of the motor."""
DRIVES = [name for protocol in ("canopen", "modbus") for name in shipped(protocol) if load_profile(name).drive.usable]
NOT_CHECKED = {"iris_orca", "maxon_epos2", "simplex_motion", "technosoft_ipos"}
"""Drives that neither take a share of a rated value nor tell one."""
SHARE, AT_THE_HANDLE, ROUNDING = 0.15, {"linear": 5.0, "rotary": 0.25}, 1e-9
SECONDS = 0.4
"""[s] within which the sign is seen, or is not."""


def slipped(axis: RigAxis, key: str, factor: float) -> RigAxis:
    """The axis with a slip in one key."""
    if key == "sign":
        return replace(axis, mechanism=replace(axis.mechanism, sign=-axis.mechanism.sign))
    if key == "mechanism":
        inner = "metres_per_revolution" if axis.mechanism.kind == "linear" else "gear_ratio"
        changed: Mapping[str, Any] = {inner: factor * getattr(axis.mechanism, inner)}
        return replace(axis, mechanism=replace(axis.mechanism, **changed))
    value = factor * getattr(axis, key)
    whole = isinstance(getattr(axis, key), int)
    return replace(axis, **{key: max(1, round(min(value, 2**31 - 1))) if whole else value})


@dataclass(frozen=True)
class Bench:
    """A drawn bench: what is there, what the rig says of it, and what else happens."""

    drive: str
    task: Task
    true: Rig
    told: Rig
    keys: tuple[str, ...]
    these: tuple[faults.Fault, ...]


def drawn(seed: int) -> Bench:
    """Each drive in turn; up to three slips, on a handle that is free, held, or stuck, wired rightly or wrongly."""
    draw = Random(f"slips/{seed}")
    name = DRIVES[seed % len(DRIVES)]
    profile = load_profile(name)
    linear = name == "iris_orca" or draw.random() < 0.7
    bus = protocol_named(profile.drive.protocol).simulated_bus(profile)
    task = Task("wall" if linear else "knob_menu", drive=name, bus=bus)
    true = load(task).rig
    ((axis_name, axis),) = true.axis.items()
    axis = replace(axis, seen=Seen(), limits=replace(axis.limits, position=None))
    keys = tuple(draw.sample(DESCRIPTIVE, draw.randint(1, 3)))
    told = axis
    for key in keys:
        told = slipped(told, key, draw.choice(SLIPS))
    # What no pulse moves gets the largest ones.
    there = replace(axis, coulomb_friction=draw.choice((axis.coulomb_friction, 0.03, 0.3)))
    kinds = (faults.EncoderReversed("encoder_reversed", 0.0), faults.TorqueReversed("torque_reversed", 0.0))
    these = tuple(fault for fault in kinds if draw.random() < 0.3)
    return Bench(name, task, replace(true, axis={axis_name: there}), replace(true, axis={axis_name: told}), keys, these)


@dataclass(frozen=True)
class Torque:
    """The largest torque before the sign was seen: as a share of the motor's rated one, and as the rig describes it."""

    refused: str
    share: float
    described: float
    """At the handle [N or N·m], by the steps that the drive was sent."""
    plan: Plan | None


def before_the_sign(bench: Bench, seconds: float = SECONDS) -> Torque:
    """Run the told rig on the true bench."""
    profile, scene = load_profile(bench.drive), load_scene(str(bench.task.scene))
    try:
        plan = compile_plan(scene, bench.told, {bench.drive: profile}, None)
    except HapticFieldbusError as error:
        return Torque(str(error), 0.0, 0.0, None)
    ((name, there),) = bench.true.axis.items()
    clock, hand = VirtualClock(), HANDS["guide"] if len(bench.keys) == 1 else None
    slots = [DriveOnBus(there.node, profile, there, hand, bench.these)]
    section = bench.told.bus[there.bus]
    bus, world = _simulation(profile.drive.protocol).simulate(section, "", slots, clock, 1, None)
    assert world is not None
    cycle, refused = Cycle(plan), ""
    try:
        bus.open(plan)
        run_loop(plan, cycle, bus, clock, cycles=max(1, round(seconds * plan.rate)))
    except HapticFieldbusError as error:
        refused = str(error)
    finally:
        bus.close()
    times_ns, torques = world.trajectory(there.node).targets()
    permitted_ns = cycle.axes[name].state.permitted_ns
    early = np.abs(torques[np.asarray(times_ns) < (math.inf if permitted_ns is None else permitted_ns)])
    largest = float(early.max(initial=0.0))
    step = torque_step(profile.offers()[Signal.TARGET_TORQUE].unit, there, profile.full_scale)
    assert step is not None
    assert there.rated_torque is not None
    described = largest / step * plan.axes[0].effort_unit
    return Torque(refused, largest / there.rated_torque, described, plan)


def wrong_with(bench: Bench, torque: Torque) -> Iterator[str]:
    """Yield what of a torque before the sign is above what is permitted."""
    if torque.plan is None:
        return
    most = AT_THE_HANDLE[torque.plan.axes[0].workspace.value]
    if torque.described > most * (1.0 + ROUNDING):
        yield f"{torque.described} at the handle, at most {most}"
    if bench.drive not in NOT_CHECKED:
        if torque.share > SHARE + ROUNDING:
            yield f"{torque.share} of the rated torque of the motor, at most {SHARE}"
    elif not any("sign: " in step and "cannot be checked" in step for step in torque.plan.steps):
        yield "the plan does not tell that the torque cannot be checked"
