"""A plan for a real Modbus line, and a master on it: what the tests of this folder share."""

from dataclasses import replace
from typing import Any

from haptic_fieldbus.buses.modbus.access import open_line
from haptic_fieldbus.buses.modbus.master import ModbusBus
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.planning.compile import compile_plan, on_bus
from haptic_fieldbus.planning.image import AXIS_HEADER, lay_out_image
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.modbus.bus import ModbusSection, parse_bus
from haptic_fieldbus.protocols.modbus.profile import ModbusProfile, modbus_profile
from haptic_fieldbus.protocols.modbus.register_traffic import Transaction
from haptic_fieldbus.protocols.modbus.traffic import ModbusTraffic
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.signals import Workspace
from tests.builders import WALL, unproved

NAME = "generic_cia402_modbus"
PROFILE = modbus_profile(load_profile(NAME))


def section_of(name: str, **changes: Any) -> ModbusSection:
    """The bus of that name."""
    section = parse_bus(name).section
    assert isinstance(section, ModbusSection)
    return replace(section, **changes)


def plan_of(
    name: str,
    profile: ModbusProfile = PROFILE,
    *,
    way: Transaction | None = None,
    rate: float = 80.0,
    scene: Scene = WALL,
    section: dict[str, Any] | None = None,
    **changes: Any,
) -> Plan:
    """A plan of a scene with one unit an axis, from 1, on the line of that name, with changes to every axis.

    `way` is that of the set-points, also where the plan would take the other one.
    """
    axes = {}
    for position, axis in enumerate(scene.axes):
        bench = default_axis(Workspace.LINEAR, bus="bus", node=1 + position, profile=NAME)
        axes[axis.name] = replace(bench, **{"limits": Limits(), **changes})
    rig = Rig({"bus": section_of(name, **(section or {}))}, axes)
    plan = compile_plan(scene, rig, {NAME: profile}, rate)
    if way is None:
        return unproved(plan)
    (bus,) = plan.buses
    assert isinstance(bus.traffic, ModbusTraffic)
    traffic = replace(bus.traffic, way=way)
    on_it = tuple(on_bus(axis, traffic, plan.period) for axis in plan.axes)
    image = lay_out_image([axis.traffic for axis in on_it])
    return unproved(replace(plan, buses=(replace(bus, traffic=traffic),), axes=on_it, image=image))


class Bench:
    """A master on a real line, and its plan."""

    def __init__(self, plan: Plan, clock: Clock | None = None) -> None:
        (section,) = plan.rig.bus.values()
        assert isinstance(section, ModbusSection)
        self.plan, self.clock = plan, clock or MonotonicClock()
        self.bus = ModbusBus(open_line(section, self.clock), self.clock, section)
        self.image = b""

    def __enter__(self) -> "Bench":
        return self

    def __exit__(self, *_: object) -> None:
        self.bus.close()

    def open(self) -> "Bench":
        self.bus.open(self.plan)
        return self

    def read(self, seconds: float = 0.5) -> tuple[int, ...]:
        """Exchange once; what the cycle would decode of the first axis."""
        self.image = bytes(self.bus.read(self.clock.now_ns() + round(1e9 * seconds)))
        return self.decoded()

    def decoded(self, axis: int = 0) -> tuple[int, ...]:
        return self.plan.image.axes[axis].input.unpack_from(self.image)

    def header(self, axis: int = 0) -> tuple[int, ...]:
        """Age [ns], flags and code."""
        return AXIS_HEADER.unpack_from(self.image, self.plan.image.axes[axis].header)

    def write(self, *values: tuple[int, int]) -> None:
        """Controlword and target torque of each axis."""
        output = bytearray(self.plan.image.output_size)
        for axis, value in zip(self.plan.image.axes, values, strict=True):
            axis.output.pack_into(output, axis.outputs[0], *value)
        self.bus.write(output)

    def enable(self) -> "Bench":
        """Walk to operation enabled."""
        for controlword in (0x06, 0x07, 0x0F, 0x0F):
            self.read()
            self.write(*[(controlword, 0)] * len(self.plan.axes))
        self.read()
        return self
