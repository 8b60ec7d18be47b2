"""The way from a task (scene, bench, settings) to a compiled plan: load, check, compile."""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_RATE
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import (
    COUNTS_PER_REVOLUTION,
    MECHANICAL,
    BusSection,
    Rig,
    RigAxis,
    default_axis,
    shipped_mechanism,
)
from haptic_fieldbus.errors import PlanError, UsageError, wrong_kind
from haptic_fieldbus.margins import Stability
from haptic_fieldbus.margins.closed_loop import stiffest_of
from haptic_fieldbus.numerals import TYPED_DIGITS, rounded_down
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.known_bench import known_bench
from haptic_fieldbus.planning.plan import BusPlan, Plan
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.protocols.catalogue import AROUND_START, check_rig, load_profile, load_rig, own_profile
from haptic_fieldbus.protocols.protocol import BusName
from haptic_fieldbus.protocols.registry import parse_bus, protocol_named
from haptic_fieldbus.scenes.catalogue import Setting, load_scene
from haptic_fieldbus.scenes.element import abilities
from haptic_fieldbus.scenes.element_checks import check_elements, check_kinds
from haptic_fieldbus.scenes.own_faults import check_shapes, own_faults
from haptic_fieldbus.scenes.scene import Scene

# A scene with its settings applied. One setting may be `max` or `max/N`: the limit, or a part of it.
#
# The limit applies to the scene with all other settings, so there are two steps. `settled` returns the scene without
# this setting. `at_limit` returns the final scene after the caller has judged the first one.

PART_OF_LIMIT = re.compile(r"max(?:/(\d+(?:\.\d*)?))?")
"""Form of a setting that is a part of the limit: `max`, `max/2`, `max/1.5`."""
MOST_DIGITS = 15
"""Largest number of digits of a text that is read as a whole number: a float holds each of these exactly."""


def settled(task: Task) -> tuple[Scene, str | None]:
    """Load the scene of a task and apply all settings but a part of the limit.

    Returns the scene and the name of that setting; None without such a setting, the scene is then final. Raises
    SceneError or UsageError.
    """
    values = parsed(task.settings)
    parts = [key for key, value in values.items() if isinstance(value, str) and PART_OF_LIMIT.fullmatch(value)]
    if len(parts) > 1:
        raise UsageError(f"only one setting may be a part of the limit, not {', '.join(parts)}")
    part = parts[0] if parts else None
    found = with_settings(task.scene, {key: value for key, value in values.items() if key != part})
    if part is not None:
        _check_scales(part, values[part], found)
        limited = stiffest_of(found.couplings)  # coupled axes are judged by this stiffness alone
        if limited is not None and part != (only := f"{limited.name}.stiffness"):
            raise UsageError(f"{part}={values[part]}: for coupled axes only {only} can be set as a part of the limit")
    return found, part


def at_limit(task: Task, scene: Scene, part: str, stability: Stability | None) -> Scene:
    """Return the final scene of a task, given the verdict on `scene`, which `settled` returned with `part`.

    Raises UsageError when there is no finite limit above 0 to take a part of, and for a division by zero.
    """
    values = parsed(task.settings)
    text = f"{part}={values[part]}"
    limit = 0.0 if stability is None or stability.stiffness is None else stability.limit.value
    if not limit and stability is not None and stability.stiffness is not None:
        raise UsageError(f"{text}: the limit is 0, because no stiffness is stable; make the other elements softer")
    if not limit or math.isinf(limit):
        raise UsageError(f"{text}: this scene has no limit on this bench")
    divisor = float(str(values[part]).partition("/")[2] or 1.0)
    if divisor == 0.0:
        raise UsageError(f"{text}: division of the limit by zero")
    name, _, parameter = part.rpartition(".")
    element: Any = next((each for each in scene.elements if each.name == name), None)
    value = limit / divisor  # [N/m or N·m/rad]
    graded = abilities(element).with_stiffness
    if parameter != "stiffness" and graded is not None:
        value = getattr(graded(value), parameter)
    return with_settings(task.scene, {**values, part: rounded_down(value, TYPED_DIGITS) if value > 0.0 else value})


def with_settings(scene: str | Path | Scene, values: Mapping[str, Setting]) -> Scene:
    """Return the scene with these values, loading it first if it is a name or a path.

    Raises SceneError for values that the scene cannot have, UsageError for an unknown scene, element or parameter.
    """
    if not isinstance(scene, Scene):
        return load_scene(scene, values)
    if not values:
        return scene
    # Imported here, because a named scene or unchanged values do not need it.
    from haptic_fieldbus.scenes.parameter_changes import changed

    return changed(scene, values)


def parsed(settings: Mapping[str, Setting] | None) -> dict[str, Setting]:
    """Return the settings with texts of a number, `true` or `false` converted; other values stay as they are.

    A text of digits, with or without a minus, is a whole number, as in a file: a parameter such as `count` needs one.

    Raises TypeError for settings that are no mapping, and for a value that no file could have.
    """
    if not isinstance(settings, Mapping | None):
        raise wrong_kind("settings", 'a mapping such as {"wall.stiffness": 800.0}', settings)
    return {key: plain_value(value, f"settings: {key}") for key, value in (settings or {}).items()}


def python_value(value: Any) -> Any:
    """Return a number of NumPy, also in an array of its own, as one of Python; anything else as it is."""
    return value.item() if hasattr(value, "item") and getattr(value, "size", 1) == 1 else value


def plain_value(value: Setting, name: str = "") -> Setting:
    """Return a value as a file would have it; raises TypeError, with its name, when none could."""
    value = python_value(value)
    if not isinstance(value, float | int | str | bool | list | tuple):
        raise wrong_kind(name, "a number, a text, True or False", value)
    if value in ("true", "false"):
        return value == "true"
    if isinstance(value, str) and value.removeprefix("-").isdecimal() and len(value) <= MOST_DIGITS:
        return int(value)
    with suppress(ValueError):
        return float(value) if isinstance(value, str) else value
    return value


def _check_scales(part: str, value: Setting, scene: Scene) -> None:
    """Raise UsageError unless the setting is a stiffness, or determines the stiffness of its element."""
    name, _, parameter = part.rpartition(".")
    element: Any = next((each for each in scene.elements if each.name == name), None)
    if parameter == "stiffness" or element is None:
        return
    own = getattr(element, parameter, None)
    graded = abilities(element).with_stiffness
    doubled = element if graded is None else graded(2.0 * element.stiffness)
    if not isinstance(own, float) or getattr(doubled, parameter) == own:
        expected = "only a stiffness, or a parameter that determines it"
        raise UsageError(f"{part}={value}: {expected}, can be a part of the limit")


HERE = "here"
"""Zero of all axes: the position of the handle when the drive is enabled."""


@dataclass(frozen=True)
class Selection:
    """A loaded task: the scene with its settings, the bench and the bus; and its plan."""

    task: Task
    scene: Scene
    """Scene with all settings but `part`."""
    part: str | None
    """Name of the setting that is a part of the limit; None when there is none."""
    rig: Rig
    bus: BusName
    profiles: Mapping[str, DriveProfile] = field(default_factory=dict)
    """Profiles that are already loaded, by their names in the rig; others are loaded on demand."""
    forced: bool = False
    """True: the force is capped, because the scene is rendered above its limit."""

    @cached_property
    def plan(self) -> Plan:
        """Plan of the task, compiled when it is first asked for.

        When a setting is a part of the limit, it is compiled twice: first without it, to know the limit.
        Raises ProfileError, EdsError, SceneError, RigError, UsageError or PlanError.
        """
        plan = self._compiled(self.scene)
        if self.part is None:
            return plan
        return self._compiled(at_limit(self.task, self.scene, self.part, plan.stability), plan.buses)

    def profile_of(self, axis: RigAxis) -> DriveProfile:
        """Return the profile of an axis of the rig; raises ProfileError, EdsError or UsageError."""
        return self.profiles.get(axis.profile) or load_profile(axis.profile)

    def _compiled(self, scene: Scene, buses: tuple[BusPlan, ...] = ()) -> Plan:
        """Return the plan of `scene` on the loaded bench, with the exchange of these buses if there are any."""
        task, scene = self.task, _renamed(scene, self.task)
        profiles = {axis.profile: self.profile_of(axis) for axis in self.rig.axis.values()}
        chosen = {"method": task.method, "estimator": task.estimator}
        return compile_plan(scene, self.rig, profiles, task.rate, buses=buses, forced=self.forced, **chosen)


@own_faults()
def plan_task(task: Task) -> Plan:
    """Return the plan of a task, as `plan` does."""
    check_request(bus=task.bus or DEFAULT_BUS, node=task.node, rate=task.rate)
    return select(task).plan


def select(task: Task) -> Selection:
    """Load a task and check that its stability can be judged; raises DocumentError, UsageError or PlanError."""
    found = load(task)
    benches = {name: known_bench(found.rig, name, found.profile_of(axis)) for name, axis in found.rig.axis.items()}
    for name, bench in benches.items():
        if bench.fault:
            raise PlanError(
                f"stability unknown: axis {name}: {bench.fault}, so the measured values do not count. "
                f"`haptic-fieldbus identify --rig {found.rig.source or 'FILE'}` measures anew; or remove "
                f"[axis.{name}.identified]. --force runs without a known limit, with at most 5 % of rated torque"
            )
    missing = [
        f"axis.{name}.{key}"
        for name, axis in found.rig.axis.items()
        for key in ("rated_torque", *MECHANICAL)
        if getattr(axis if key == "rated_torque" else benches[name], key) is None
    ]
    if missing:
        raise PlanError(
            f"stability unknown: the bench on {found.bus.text} lacks {', '.join(missing)}. "
            f"`haptic-fieldbus identify --rig {found.rig.source or 'FILE'}` measures inertia, damping and friction; or "
            "write the values into the rig file. --force runs without a known limit, with at most 5 % of rated torque"
        )
    return found


def load(task: Task) -> Selection:
    """Load everything that the task names except profiles, without a verdict; raises DocumentError or UsageError."""
    check_rendering(task)
    if isinstance(task.rig, Rig):
        check_rig(task.rig)  # made in Python, it may have values that no file may have
    rig = load_rig(task.rig, task.profiles) if isinstance(task.rig, str | Path) else task.rig
    # A named bus replaces the buses of the rig; without both the bus is the simulation.
    bus = parse_bus(task.bus or DEFAULT_BUS) if rig is None or task.bus is not None else _bus_of(rig)
    if rig is not None and task.bus is not None:
        rig = _on_bus(rig, bus)
    scene, part = settled(task)
    if rig is None:
        rig = _shipped_bench(_renamed(scene, task), task.drive, bus, task.node)
    rig = _with_zero(rig, task.zero)
    # Paths take the place of the names of own profiles, so that loading them needs no folder.
    axes = {name: replace(axis, profile=own_profile(axis.profile, task.profiles)) for name, axis in rig.axis.items()}
    return Selection(task, scene, part, replace(rig, axis=axes), bus)


def _with_zero(rig: Rig, zero: str | None) -> Rig:
    """Return the rig with the zero that a task names in the place of its own; raises UsageError for another word."""
    if zero is None:
        return rig
    if zero != HERE:
        hint = "for an encoder count use axis.NAME.mechanism.zero in the rig"
        raise UsageError(f'--zero "{zero}": expected {HERE}; {hint}')
    for name, axis in rig.axis.items():
        low, high = axis.limits.position or (0.0, 0.0)
        if not low <= 0.0 <= high:
            raise UsageError(f"--zero {HERE}: axis.{name}.limits.position is [{low}, {high}]; expected {AROUND_START}")
    started = {name: replace(axis.mechanism, zero="start") for name, axis in rig.axis.items()}
    return replace(rig, axis={name: replace(axis, mechanism=started[name]) for name, axis in rig.axis.items()})


def check_rendering(task: Task) -> None:
    """Check the names of method and estimator, even if the scene needs neither, and the elements of a ready-made scene.

    Raises UsageError for an unknown name, SceneError for an element that a scene file could not have, TypeError for an
    object that is no element.
    """
    # Imported only when named, because a scene that needs neither must not import them.
    if task.method is not None:
        from haptic_fieldbus.numerics.integrators import method_named

        method_named(task.method)
    if task.estimator is not None:
        from haptic_fieldbus.numerics.estimators import chosen

        chosen(task.estimator)
    if isinstance(task.scene, Scene):
        check_kinds(task.scene)
        check_shapes(task.scene)
        check_elements(task.scene, 1.0 / (task.rate or DEFAULT_RATE), task.method)


def _renamed(scene: Scene, task: Task) -> Scene:
    """Return the scene with the names that the task gives its axes; raises UsageError for an unknown axis."""
    if not task.axes:
        return scene
    # Imported here, because unchanged names of the axes do not need it.
    from haptic_fieldbus.scenes.parameter_changes import with_axes

    return with_axes(scene, task.axes)


def _used(rig: Rig) -> dict[str, BusSection]:
    """Return the buses that carry at least one axis, sorted by name."""
    return {name: rig.bus[name] for name in sorted({axis.bus for axis in rig.axis.values()})}


def _bus_of(rig: Rig) -> BusName:
    """Return one name for all buses of the rig; raises UsageError when one run cannot use them together."""
    names = {name: protocol_named(section.protocol).bus_name(section) for name, section in _used(rig).items()}
    listed = ", ".join(f"{name} is {bus.text}" for name, bus in names.items())
    if len({bus.simulated for bus in names.values()}) > 1:
        raise UsageError(
            f"{rig.source or 'the rig'} mixes simulated and real buses: {listed}. A run has either virtual or real "
            "time; add --bus sim to simulate all"
        )
    # Two masters on one pair of wires would each send a SYNC.
    if len({section.wires for section in _used(rig).values()}) < len(names):
        raise UsageError(
            f"{rig.source or 'the rig'} lists one bus twice: {listed}. Use one [bus] for one pair of wires"
        )
    first = next(iter(names.values()))
    return replace(first, text=", ".join(bus.text for bus in names.values()))


def _on_bus(rig: Rig, named: BusName) -> Rig:
    """Return the rig with its buses replaced by the named one.

    Raises UsageError when the rig has several buses and the named one is real: only the simulation can replace all.
    """
    used = _used(rig)
    if len(used) > 1 and not named.simulated:
        raise UsageError(
            f"--bus {named.text} is one bus, but the axes of {rig.source or 'the rig'} use several: {', '.join(used)}. "
            "Omit --bus, or simulate them with --bus sim"
        )
    sections = {}
    for own, section in used.items():
        # With several buses each keeps its own name as its channel, so that the simulated ones stay apart.
        channel = own if len(used) > 1 else None
        sections[own] = protocol_named(section.protocol).in_place_of(section, named, channel)
    return replace(rig, bus=sections)


def _shipped_bench(scene: Scene, drive: str | None, bus: BusName, node: int) -> Rig:
    """Return the shipped bench: a drive for each axis of the scene, with node-IDs counting from `node`.

    On a real bus the motors are unknown, so rated torque, inertia, damping and friction are None.
    """
    protocol, last = protocol_named(bus.section.protocol), node + len(scene.axes) - 1
    if wanted := protocol.wanted_node(last, bus.section.interface):
        raise UsageError(
            f"node {node}: the {len(scene.axes)} axes of the scene would take the numbers {node} to {last}; "
            f"a node-ID is {wanted}"
        )
    name, drive = bus.text.partition("@")[0], drive or protocol.default_drive
    axes = {}
    for number, axis in enumerate(scene.axes, start=node):
        made = RigAxis(name, number, drive, shipped_mechanism(axis.workspace), COUNTS_PER_REVOLUTION)
        if bus.simulated:  # no hand at the handle, and its power can be cut at any time
            made = default_axis(axis.workspace, bus=name, node=number, profile=drive)
            made = replace(made, emergency_stop="power")
        axes[axis.name] = made
    return Rig({name: bus.section}, axes)
