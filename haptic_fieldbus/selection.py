"""From what a caller names (scene, rig, drive, bus, settings) to a compiled plan.

Setting values may be `max` or `max/N`: the stability limit of the scene on this bench, or a part of it.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from haptic_fieldbus.drive.catalogue import load_profile, load_rig
from haptic_fieldbus.drive.rig import BusSection, LinearMechanism, Rig, RigAxis, RotaryMechanism, default_axis
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.margins.contact import stiffest_of
from haptic_fieldbus.planning import Plan, compile_plan
from haptic_fieldbus.request import BusName, parse_bus
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.checked import check_elements
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Workspace

DEFAULT_DRIVE = "maxon_epos4"
SIMULATION = "sim"
"""Without a bit rate: that of each bus of the rig."""
DEFAULT_RATE = 1000.0
"""[Hz]"""
Value = float | str | bool
PART_OF_LIMIT = re.compile(r"max(?:/(\d+(?:\.\d*)?))?")


@dataclass(frozen=True)
class Selection:
    """A plan and the bus it is for."""

    plan: Plan
    bus: BusName


def select(
    scene: str | Path | Scene,
    rig: str | Path | Rig | None,
    *,
    drive: str,
    bus: str | None,
    node: int,
    rate: float,
    settings: Mapping[str, Value],
    method: str | None,
    estimator: str | None,
    complete: Callable[[Rig, BusName], Rig],
) -> Selection:
    """Load, check and compile; a rig replaces drive, bus and node, but a bus that is named replaces the rig's.

    `complete` gets the bench before it is compiled, to fill in or refuse what is unknown.
    """
    check_numerics(method, estimator)
    if isinstance(scene, Scene):
        check_elements(scene, 1.0 / rate, method)
    bench = load_rig(rig) if isinstance(rig, str | Path) else rig
    name = parse_bus(bus or SIMULATION) if bench is None or bus is not None else _bus_of(bench)
    if bench is not None and bus is not None:
        bench = _on_bus(bench, name)

    def compiled(chosen: Scene) -> Plan:
        used = bench if bench is not None else _shipped_bench(chosen, drive, name, node)
        used = complete(used, name)
        profiles = {axis.profile: load_profile(axis.profile) for axis in used.axis.values()}
        return compile_plan(chosen, used, profiles, rate, method=method, estimator=estimator)

    return Selection(compiled(load_scene_with(scene, settings, lambda chosen: compiled(chosen).stability)), name)


def check_numerics(method: str | None, estimator: str | None) -> None:
    """A name that does not exist is refused also where the scene needs neither; only a named one is imported."""
    if method is not None:
        from haptic_fieldbus.numerics.integrators import method_named

        method_named(method)
    if estimator is not None:
        from haptic_fieldbus.numerics.estimators import chosen

        chosen(estimator)


def refuse_unknown(rig: Rig, bus: BusName) -> Rig:
    """The rig as it is; raises PlanError that names every key without which stability cannot be judged."""
    missing = [
        f"axis.{name}.{key}"
        for name, axis in rig.axis.items()
        for key in ("rated_torque", "inertia", "viscous_damping")
        if getattr(axis, key) is None
    ]
    if missing:
        raise PlanError(
            f"the bench on {bus.text} is unknown, so stability cannot be judged. A rig file (--rig FILE) must give: "
            f"{', '.join(missing)}. Without them, --force allows 5 % of rated torque"
        )
    return rig


def load_scene_with(
    scene: str | Path | Scene, settings: Mapping[str, Value], judged: Callable[[Scene], Stability | None]
) -> Scene:
    """The scene with its settings made; `judged` gives the limits of which one may be a part."""
    values = {key: parse_value(value) if isinstance(value, str) else value for key, value in settings.items()}
    return _load(scene, _without_limits(scene, values, judged))


def _load(scene: str | Path | Scene, settings: Mapping[str, Value]) -> Scene:
    if not isinstance(scene, Scene):
        return load_scene(scene, settings)
    if not settings:
        return scene
    from haptic_fieldbus.scenes.changed import changed

    return changed(scene, settings)


def parse_value(text: str) -> Value:
    """A setting as written on the command line: number, true/false, or text."""
    if text in ("true", "false"):
        return text == "true"
    try:
        return float(text)
    except ValueError:
        return text


def _without_limits(
    scene: str | Path | Scene, values: dict[str, Value], judged: Callable[[Scene], Stability | None]
) -> dict[str, Value]:
    """Replace `max/N` by the number; the limit is that of the scene with all other settings made."""
    wanted = {key: value for key, value in values.items() if isinstance(value, str) and PART_OF_LIMIT.fullmatch(value)}
    if not wanted:
        return values
    faults = [
        f"{key}={value}: only a stiffness has a limit" for key, value in wanted.items() if ".stiffness" not in key
    ]
    if len(wanted) > 1 or faults:
        raise UsageError("; ".join(faults) or f"only one setting may be a part of the limit, not {', '.join(wanted)}")
    ((key, value),) = wanted.items()
    rest = _load(scene, {k: v for k, v in values.items() if k != key})
    _check_limited(rest, key, value)
    stability = judged(rest)
    limit = None if stability is None else stability.stiffness_limit.stable
    if not limit or math.isinf(limit):
        raise UsageError(f"{key}={value}: this bench has no stability limit to take a part of")
    match = PART_OF_LIMIT.fullmatch(str(value))
    part = float(match.group(1)) if match and match.group(1) else 1.0
    if part == 0.0:
        raise UsageError(f"{key}={value}: the limit cannot be divided by zero")
    return {**values, key: limit / part}


def _check_limited(scene: Scene, key: str, value: object) -> None:
    """Where axes are coupled, the limit is that of the stiffest coupling and of nothing else."""
    limited = stiffest_of(scene.couplings)
    if limited is not None and key != f"{limited.name}.stiffness":
        raise UsageError(f"{key}={value}: the limit of coupled axes is told for {limited.name}.stiffness alone")


def _used(rig: Rig) -> dict[str, BusSection]:
    """The buses on which there are axes, by name."""
    return {name: rig.bus[name] for name in sorted({axis.bus for axis in rig.axis.values()})}


def _bus_of(rig: Rig) -> BusName:
    """What the rig's buses are, all together; raises UsageError when one run cannot use them together."""
    names = {
        name: parse_bus(f"{section.interface}:{section.channel}@{section.bitrate}")
        for name, section in _used(rig).items()
    }
    listed = ", ".join(f"{name} is {bus.text}" for name, bus in names.items())
    if len({bus.kind for bus in names.values()}) > 1:
        raise UsageError(
            f"{rig.source or 'the rig'} mixes simulated and real buses: {listed}. A run has either virtual or real "
            "time; --bus sim simulates all of them"
        )
    if len({(bus.interface, bus.channel) for bus in names.values()}) < len(names):
        raise UsageError(
            f"{rig.source or 'the rig'} names one bus twice: {listed}. What hangs on one pair of wires is one [bus]"
        )
    first = next(iter(names.values()))
    return replace(first, text=", ".join(bus.text for bus in names.values()))


def _on_bus(rig: Rig, name: BusName) -> Rig:
    """The rig on the bus that was named; of a rig with several, only the simulation can stand for all."""
    used = _used(rig)
    if len(used) > 1 and not name.simulated:
        raise UsageError(
            f"--bus {name.text} is one bus, but the axes of {rig.source or 'the rig'} are on several: "
            f"{', '.join(used)}. Leave it out, or simulate them with --bus sim"
        )
    sections = {
        own: BusSection(
            name.interface,
            name.channel if len(used) == 1 else own,
            section.bitrate if name.text == SIMULATION else name.bitrate,
        )
        for own, section in used.items()
    }
    return replace(rig, bus=sections)


def _shipped_bench(scene: Scene, drive: str, bus: BusName, node: int) -> Rig:
    """One axis per axis of the scene, nodes counting from `node`; on a real bus its plant is unknown."""
    section = BusSection(bus.interface, bus.channel, bus.bitrate)
    name = bus.text.partition("@")[0]
    make = default_axis if bus.simulated else _unknown_axis
    axes = {
        axis.name: make(axis.workspace, bus=name, node=node + position, profile=drive)
        for position, axis in enumerate(scene.axes)
    }
    return Rig({name: section}, axes)


def _unknown_axis(workspace: Workspace, *, bus: str, node: int, profile: str) -> RigAxis:
    mechanism = LinearMechanism("linear", 0.05) if workspace is Workspace.LINEAR else RotaryMechanism("rotary")
    return RigAxis(bus, node, profile, mechanism, encoder_counts_per_revolution=4096)
