"""From what a caller names (scene, rig, drive, bus, settings) to a compiled plan.

Setting values may be `max` or `max/N`: the stability limit of the scene on this bench, or a part of it.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.drive.catalogue import load_profile, load_rig
from haptic_fieldbus.drive.rig import BusSection, LinearMechanism, Rig, RigAxis, RotaryMechanism, default_axis
from haptic_fieldbus.errors import PlanError, UsageError
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.planning import Plan, compile_plan
from haptic_fieldbus.request import BusName, parse_bus
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Workspace

DEFAULT_DRIVE = "maxon_epos4"
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
    bench = load_rig(rig) if isinstance(rig, str | Path) else rig
    name = parse_bus(bus or "sim") if bench is None or bus is not None else _bus_of(bench)

    def compiled(chosen: Scene) -> Plan:
        used = _on_bus(bench, name) if bench is not None else _shipped_bench(chosen, drive, name, node)
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
    if isinstance(scene, Scene):
        if settings:
            raise UsageError("settings change a scene that is loaded by name or path; this one is ready-made")
        return scene
    return load_scene(scene, settings)


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
    stability = judged(_load(scene, {k: v for k, v in values.items() if k != key}))
    if stability is None or not stability.stiffness_limit.stable:
        raise UsageError(f"{key}={value}: this bench has no stability limit to take a part of")
    match = PART_OF_LIMIT.fullmatch(str(value))
    part = float(match.group(1)) if match and match.group(1) else 1.0
    if part == 0.0:
        raise UsageError(f"{key}={value}: the limit cannot be divided by zero")
    return {**values, key: stability.stiffness_limit.stable / part}


def _bus_of(rig: Rig) -> BusName:
    names = {axis.bus for axis in rig.axis.values()}
    section = rig.bus[min(names)]
    return parse_bus(f"{section.interface}:{section.channel}@{section.bitrate}")


def _on_bus(rig: Rig, name: BusName) -> Rig:
    """The rig, its axes moved to the bus that was named."""
    section = BusSection(name.interface, name.channel, name.bitrate)
    return Rig({axis.bus: section for axis in rig.axis.values()}, rig.axis, rig.source)


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
