"""Nothing that describes a bench raises a torque: whatever a descriptive key says, permissions hold.

The rule, over all keys of a rig's axis and all numbers of a profile: with the permission keys fixed, another value of a
descriptive key lifts the permitted effort neither above `limits`, in the rig's units, nor above the permitted share of
rated torque, in the drive's own steps. A value that was missing may end the cap of 5 %.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from typing import Any, ClassVar, get_args, get_origin, get_type_hints

import pytest

from haptic_fieldbus.drive.fields import STRICT
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import (
    SHARES_OF_RATED,
    Contradicted,
    Identified,
    Limits,
    Mechanics,
    Permissions,
    Proved,
    Rig,
    RigAxis,
    Seen,
)
from haptic_fieldbus.drive.rig_units import tables_of
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.planning.axis_plan import AxisPlan, draft_axis
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Signal, Workspace
from tests.builders import shipped

NAMES = {"bus", "node", "profile", "mechanism.kind", "i_know"}
"""Names, and the values of which a person is sure."""
PERMISSIONS = {
    *(f"limits.{each.name}" for each in fields(Limits)),
    *(f"permissions.{each.name}" for each in fields(Permissions)),
    *(f"proved.{each.name}" for each in fields(Proved)),
    *(f"seen.{each.name}" for each in fields(Seen)),
    "on_link_loss",
    "raise_max_torque",
    "emergency_stop",
}
"""Permissions of a person, and what a run or a person has seen."""
DESCRIPTIVE = {
    "encoder_counts_per_revolution",
    "rated_torque",
    "torque_constant",
    "rated_current",
    "peak_current",
    "inertia",
    "viscous_damping",
    "coulomb_friction",
    "mechanism.metres_per_revolution",
    "mechanism.gear_ratio",
    "mechanism.sign",
    "mechanism.zero",
    "simulation.coupling.stiffness",
    "simulation.coupling.load_inertia",
    "simulation.coupling.damping",
    "simulation.coupling.backlash",
    "simulation.gravity.torque",
    "simulation.gravity.hanging_at",
    "simulation.cogging.torque",
    "simulation.cogging.periods_per_revolution",
    "simulation.stribeck.torque",
    "simulation.stribeck.velocity",
    "simulation.inertia",
    "simulation.viscous_damping",
    "simulation.coulomb_friction",
    "simulation.torque_bandwidth",
    "simulation.encoder_counts_per_revolution",
    "simulation.torque_scale",
    *(f"identified.{each.name}" for each in fields(Identified)),
    *(f"contradicted.{each.name}" for each in fields(Contradicted)),
}
MEASURED = Identified(
    inertia=3e-5, inertia_interval=(2e-5, 4e-5), viscous_damping=1e-3, viscous_damping_interval=(5e-4, 2e-3),
    coulomb_friction=4e-3, coulomb_friction_interval=(3e-3, 5e-3), delay_and_lag=5e-4,
    delay_and_lag_interval=(4e-4, 6e-4), torque_lag=1e-4, torque_lag_interval=(1e-5, 2e-4), date="2026-01-01",
    rate=1000.0, planned_delay=5e-4, serial=7, top_speed=50.0, residual_counts=0.3,
)  # fmt: skip
TRUTH = Mechanics(
    inertia=6e-5, viscous_damping=1e-4, coulomb_friction=4e-3, torque_bandwidth=500.0,
    encoder_counts_per_revolution=4096, torque_scale=1.2,
)  # fmt: skip
FACTORS = (1e6, 1e3, 57.3, 4.0, 0.25, 1e-3, 1e-6)
DRIVES = [name for protocol in ("canopen", "modbus") for name in shipped(protocol) if load_profile(name).drive.usable]
LIMIT = {Workspace.LINEAR: 8.0, Workspace.ROTARY: 0.2}
MOST = {Workspace.LINEAR: 5.0, Workspace.ROTARY: 0.25}
ROUNDING = 1.0 + 1e-9


def keys_of(schema: type, path: tuple[str, ...] = ()) -> Iterator[str]:
    """Every key of a table and of the tables in it."""
    for name, hint in get_type_hints(schema, include_extras=True).items():
        tables = tables_of(hint)
        if hint is ClassVar or get_origin(hint) is ClassVar:  # no key of a file
            continue
        for table in tables:
            yield from keys_of(table, (*path, name))
        if not tables:
            yield ".".join((*path, name))


def test_each_key_of_a_rig_describes_or_permits_and_a_new_one_is_one_of_both() -> None:
    assert STRICT["extra"] == "forbid"
    assert set(keys_of(RigAxis)) == NAMES | PERMISSIONS | DESCRIPTIVE
    assert not PERMISSIONS & DESCRIPTIVE


def changed(value: Any, path: tuple[str, ...], factor: float) -> Any:
    """The dataclass with one number in it multiplied; unchanged where the key is not there."""
    held = getattr(value, path[0], None)
    if len(path) > 1:
        return value if held is None else replace(value, **{path[0]: changed(held, path[1:], factor)})
    if isinstance(held, tuple):
        return replace(value, **{path[0]: tuple(factor * each for each in held)})
    if isinstance(held, bool) or not isinstance(held, int | float):
        return value
    if path[0] == "sign":
        return replace(value, sign=-held)
    return replace(value, **{path[0]: max(1, round(factor * held)) if isinstance(held, int) else factor * held})


def bench(drive: str, workspace: Workspace, **changes: Any) -> tuple[Rig, str, Scene]:
    """The shipped bench of a drive with an unknown sign; the name of its axis, and the scene."""
    profile, scene = load_profile(drive), "wall" if workspace is Workspace.LINEAR else "knob_menu"
    rig = load(Task(scene, drive=drive, bus=protocol_named(profile.drive.protocol).simulated_bus(profile))).rig
    ((name, axis),) = rig.axis.items()
    told = {"seen": Seen(), "identified": MEASURED, "simulation": TRUTH, **changes}
    return replace(rig, axis={name: replace(axis, **told)}), name, load_scene(scene)


def drafted(rig: Rig, name: str, scene: Scene, profile: DriveProfile) -> AxisPlan | None:
    """The plan of the axis; None where it is refused."""
    try:
        return draft_axis(scene, scene.axes[0], rig, {rig.axis[name].profile: profile}, None, None)
    except PlanError:
        return None


def check_permitted(axis: AxisPlan, *, capped: bool) -> None:
    """The plan keeps to what is permitted, in the rig's units and in steps of the drive."""
    limits, share = axis.limits, 0.05 if capped else 1.0
    assert axis.rig.limits.effort is None or limits.effort <= axis.rig.limits.effort
    assert limits.unseen <= min(limits.effort, MOST[axis.workspace]) * ROUNDING
    assert limits.before_sign <= limits.unseen
    assert limits.effort <= share * axis.rated_effort * ROUNDING
    if axis.profile.offers()[Signal.TARGET_TORQUE].unit in SHARES_OF_RATED:
        permille = axis.effort_unit
        assert limits.effort <= 1000.0 * share * permille * ROUNDING
        assert limits.unseen <= 150.0 * permille * ROUNDING
        assert limits.holding <= 50.0 * permille * ROUNDING


@pytest.mark.thorough("drafts 6,000 plans", quick=6)
@pytest.mark.parametrize("workspace", Workspace)
@pytest.mark.parametrize("drive", DRIVES)
def test_no_descriptive_key_of_a_rig_lifts_what_is_permitted(drive: str, workspace: Workspace) -> None:
    profile, planned = load_profile(drive), 0
    for limits in (Limits(), Limits(effort=LIMIT[workspace])):
        rig, name, scene = bench(drive, workspace, limits=limits)
        whole = drafted(rig, name, scene, profile)
        capped = whole is not None and whole.limits.effort <= 0.05 * whole.rated_effort * ROUNDING
        for key in sorted(DESCRIPTIVE):
            for factor in FACTORS:
                told = changed(rig.axis[name], tuple(key.split(".")), factor)
                if told == rig.axis[name]:  # a key that this bench leaves out
                    continue
                axis = drafted(replace(rig, axis={name: told}), name, scene, profile)
                planned += axis is not None
                if axis is not None:
                    check_permitted(axis, capped=capped and limits.effort is None)
    assert planned > 50 or (drive, workspace) == ("iris_orca", Workspace.ROTARY)


def numbers_of(value: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The place of every number in a dataclass that is no code of an object or register."""
    for each in fields(value):
        held = getattr(value, each.name)
        if is_dataclass(held):
            yield from numbers_of(held, (*path, each.name))
        elif isinstance(held, float):
            yield (*path, each.name)


@pytest.mark.parametrize("drive", DRIVES)
def test_no_number_of_a_profile_lifts_what_is_permitted(drive: str) -> None:
    profile = load_profile(drive)
    workspace = Workspace.LINEAR
    rig, name, scene = bench(drive, workspace)
    whole = drafted(rig, name, scene, profile)
    assert whole is not None
    capped = whole.limits.effort <= 0.05 * whole.rated_effort * ROUNDING
    places = list(numbers_of(profile))
    assert ("timing", "torque_bandwidth") in places
    for place in places:
        for factor in FACTORS:
            axis = drafted(rig, name, scene, changed(profile, place, factor))
            if axis is not None:
                check_permitted(axis, capped=capped)


@pytest.mark.parametrize("missing", ["inertia", "viscous_damping", "coulomb_friction"])
def test_a_value_that_is_supplied_may_end_the_cap_and_another_one_may_not(missing: str) -> None:
    profile = load_profile("maxon_epos4")
    rig, name, scene = bench("maxon_epos4", Workspace.LINEAR, **{missing: None}, identified=Identified())
    capped, whole = drafted(rig, name, scene, profile), drafted(*bench("maxon_epos4", Workspace.LINEAR), profile)
    assert capped is not None
    assert whole is not None
    assert capped.limits.effort == pytest.approx(0.05 * whole.limits.effort)
    unmeasured: dict[str, Any] = {missing: None, f"{missing}_interval": None}
    others = replace(rig.axis[name], identified=replace(MEASURED, **unmeasured))
    rig = replace(rig, axis={name: others})
    for key in sorted(DESCRIPTIVE - {missing}):
        for factor in FACTORS:
            told = changed(rig.axis[name], tuple(key.split(".")), factor)
            axis = drafted(replace(rig, axis={name: told}), name, scene, profile)
            if axis is not None:
                check_permitted(axis, capped=True)


def test_the_mechanisms_are_the_two_that_are_varied() -> None:
    kinds = {get_args(get_type_hints(each)["kind"])[0] for each in tables_of(get_type_hints(RigAxis)["mechanism"])}
    assert kinds == {"linear", "rotary"}
