"""Ready-made values for tests: a profile, a rig axis, a scene and a plan that need no files."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

from haptic_fieldbus.defaults import DEFAULT_DRIVE
from haptic_fieldbus.drive.cia402 import (
    IdentitySection,
    MappedObject,
    OptionCode,
    PositionSection,
    TorqueSection,
    VelocitySection,
)
from haptic_fieldbus.drive.profile import DataType, DriveSection, TimingSection
from haptic_fieldbus.drive.rig import Limits, Rig, RigAxis, default_axis
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.pdo import Pdo
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, PdoSection, canopen_profile
from haptic_fieldbus.protocols.canopen.traffic import CanTraffic, PdoTraffic
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.scenes.element import AnyElement
from haptic_fieldbus.scenes.scene import Scene, SceneAxis, axes_of
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace

EXAMPLE = "example_velocity_only"
"""The shipped profile that is an example and no drive."""
PERMILLE = "permille_of_rated_torque"

PROFILE = CanopenProfile(
    schema=1,
    name="test_drive",
    drive=DriveSection("test", "drive", "canopen", "vendor-data"),
    identity=IdentitySection(vendor_id=0xFB),
    torque=TorqueSection(
        mode_of_operation=10,
        target=MappedObject(0x6071, DataType.INT16, unit=PERMILLE),
        actual=MappedObject(0x6077, DataType.INT16, unit=PERMILLE),
        rated=MappedObject(0x6076, DataType.UINT32, unit="µN·m"),
        echo="actual",
    ),
    position=PositionSection(MappedObject(0x6064, DataType.INT32, unit="counts")),
    pdo=PdoSection((1, 254, 255), (1, 254, 255), "reception"),
    link_loss=LinkLossSection(
        heartbeat_consumer=0x1016,
        abort_connection_option=OptionCode(0x6007, 2),
        fault_reaction_option=OptionCode(0x605E, 0),
    ),
    timing=TimingSection(torque_bandwidth=1000.0, control_period=0.0004),
)


VELOCITY_ONLY = replace(
    PROFILE, position=None, velocity=VelocitySection(MappedObject(0x606C, DataType.INT32, unit="0.1 rpm"))
)


def rig_of(scene: Scene, **changes: Any) -> Rig:
    """The shipped bench without limits of its own, with changes to every axis; nodes count from 1."""
    axes: dict[str, RigAxis] = {}
    for position, axis in enumerate(scene.axes):
        bench = default_axis(axis.workspace, bus="bus", node=1 + position, profile=PROFILE.name)
        axes[axis.name] = replace(bench, **{"limits": Limits(), **changes})
    return Rig({"bus": CanSection("haptic_sim", "sim")}, axes)


def endless_rig(scene: str | Scene, drive: str = DEFAULT_DRIVE, bus: str | None = None) -> Rig:
    """The shipped bench with an endless way, for hands whose handle may go further than a run of that bench may."""
    rig = load(Task(scene, drive=drive, bus=bus)).rig
    axes = {name: replace(axis, limits=replace(axis.limits, position=None)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes)


def scene_of(*elements: AnyElement, workspace: Workspace = Workspace.LINEAR) -> Scene:
    """A scene whose axes are those that the elements name."""
    names = tuple(dict.fromkeys(name for element in elements for name in axes_of(element)))
    return Scene("test", "a scene for tests", tuple(SceneAxis(name, workspace) for name in names), elements)


WALL = scene_of(Wall("handle", stiffness=600.0, position=0.02))


def plan_of(
    scene: Scene = WALL,
    rate: float = 1000.0,
    rig: Rig | None = None,
    profile: CanopenProfile = PROFILE,
    method: str | None = None,
    estimator: str | None = None,
) -> Plan:
    """A plan of a scene on the shipped bench, without the proof that set-points act: most tests write the feedback of
    their own, and no drive answers with what it was sent."""
    rig = rig_of(scene) if rig is None else rig
    return unproved(compile_plan(scene, rig, {PROFILE.name: profile}, rate, method=method, estimator=estimator))


def unproved(plan: Plan) -> Plan:
    """The plan without a deadline for the echo of its set-points."""
    axes = tuple(replace(axis, limits=replace(axis.limits, echo=math.inf)) for axis in plan.axes)
    return replace(plan, axes=axes)


def can_traffic(plan: Plan, place: int = 0) -> CanTraffic:
    """Frames that one bus of a plan carries."""
    traffic = plan.buses[place].traffic
    assert isinstance(traffic, CanTraffic)
    return traffic


def bit_rates(plan: Plan) -> list[int]:
    """Of each bus [bit/s]."""
    return [can_traffic(plan, place).bitrate for place in range(len(plan.buses))]


def pdos_of(plan: Plan) -> tuple[Pdo, ...]:
    """All PDOs of a plan."""
    return tuple(pdo for axis in plan.axes if isinstance(axis.traffic, PdoTraffic) for pdo in axis.traffic.pdos)


def canopen(name: str | Path) -> CanopenProfile:
    """A shipped profile or a file."""
    return canopen_profile(load_profile(name))


def shipped(protocol: str = "canopen") -> list[str]:
    """Names of the shipped profiles of one protocol; the example stands for no drive."""
    return [name for name in profile_names() if load_profile(name).drive.protocol == protocol and name != EXAMPLE]
