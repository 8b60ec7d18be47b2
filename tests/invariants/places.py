"""Where a run is watched: a simulated CAN wire, or a simulated Modbus line, in one form.

What goes over a Modbus line is written down as if it were frames: each request that writes command or target of a drive
as one of the master, with both values as the drive has them then; each that reads its status as one of the drive. A
drive that has lost its master says so in a frame of its own, though on Modbus it tells it only when asked.
"""

from collections.abc import Callable
from typing import Any, Protocol

from tests.invariants.witness import MASTER, STRANGER
from tests.invariants.words import CONTROLWORD, EMERGENCY, LOST_MASTER, OCTETS, STATUSWORD

Seen = Callable[[int, int, bytes, int], None]
"""Called with end of frame [ns], identifier, octets and sender."""
Json = dict[str, Any]
WRITTEN, READ = 0x200, 0x180
"""Identifiers of what is written to a drive and read from it, without its number."""
TARGET = "201Ch"
"""The name under which a target of four octets stands in a frame."""
ENABLED = "operation enabled"
"""State of a drive that follows its target."""


class Place(Protocol):
    """The truth of a run."""

    clock: Any

    @property
    def now_ns(self) -> int:
        """Up to where events have run."""

    @property
    def nodes(self) -> set[int]:
        """Numbers of the drives."""

    def slave(self, node: int) -> Any:
        """The drive and what gives access to it, as `drive`."""

    def faults(self, node: int) -> tuple[Any, ...] | None:
        """The faults that are planned for a drive; None where a test does something of its own when it is enabled."""

    def run(self) -> None:
        """Let all happen up to the present."""

    def watch(self, seen: Seen) -> None:
        """Tell of every frame from now on."""


class CanPlace:
    """A simulated wire and the port of the master on it."""

    def __init__(self, world: Any, port: Any) -> None:
        self.clock, self._world = world.clock, world
        self._senders = {port: MASTER} | {own: slave.node.number for own, slave in world._drives.attached}

    @property
    def now_ns(self) -> int:
        return int(self._world._now_ns)

    @property
    def nodes(self) -> set[int]:
        return set(self._world._drives.slaves)

    def slave(self, node: int) -> Any:
        return self._world.slave(node)

    def faults(self, node: int) -> tuple[Any, ...] | None:
        planned = getattr(self.slave(node).drive.on_enabled, "args", None)
        return tuple(planned[0]) if planned else None

    def run(self) -> None:
        self._world.run()

    def watch(self, seen: Seen) -> None:
        def frame_ended(t_ns: int, frame: Any, sender: Any) -> None:
            seen(t_ns, frame.can_id, frame.data, self._senders.get(sender, STRANGER))

        self._world.watch(frame_ended)


class ModbusPlace:
    """A simulated line."""

    def __init__(self, line: Any) -> None:
        self.clock, self._line = line._clock, line

    @property
    def now_ns(self) -> int:
        return int(self._line._drives.now_ns)

    @property
    def nodes(self) -> set[int]:
        return set(self._line._drives.units)

    def slave(self, node: int) -> Any:
        return self._line.unit(node)

    def faults(self, node: int) -> tuple[Any, ...] | None:
        enabled = getattr(self.slave(node).drive.on_enabled, "args", None)
        return tuple(enabled[1].args[0]) if enabled else None

    def run(self) -> None:
        self._line.run()

    def watch(self, seen: Seen) -> None:
        for unit in self._line._drives.units.values():
            _watch(unit, seen)


def _watch(unit: Any, seen: Seen) -> None:
    """Tell of what is written and read, and of a lost master."""
    power, objects, number = unit.profile.power, unit.drive.objects, unit.number
    commands = {power.command.address, unit.profile.torque.target.address}
    speaks, ours = power.table == "cia402", objects.target_torque.value
    write, read, error, meddle = unit.write, unit.read, unit.error, unit.write_as_stranger

    def written(address: int, octets: bytes, t_ns: int) -> Any:
        nonlocal ours
        outcome, addresses = write(address, octets, t_ns), set(range(address, address + len(octets) // 2))
        if outcome is None and commands & addresses:
            # A command alone leaves the target that another master may have written.
            ours = objects.target_torque.value if unit.profile.torque.target.address in addresses else ours
            told(t_ns, ours, MASTER)
        return outcome

    def told(t_ns: int, target: int, sender: int) -> None:
        octets = objects.controlword.value.to_bytes(2, "little") + target.to_bytes(4, "little", signed=True)
        seen(t_ns, WRITTEN + number, octets, sender)

    def meddled(share: float, t_ns: int) -> None:
        meddle(share, t_ns)
        told(t_ns, objects.target_torque.value, STRANGER)

    def was_read(function: int, address: int, count: int, t_ns: int) -> Any:
        outcome = read(function, address, count, t_ns)
        # A drive without statusword shows its states in words of its own; the last of them is the same in all.
        shows = speaks or unit.drive.power.state.value == ENABLED
        if isinstance(outcome, bytes) and shows and address <= power.status.address < address + count:
            seen(t_ns, READ + number, objects.statusword.value.to_bytes(2, "little"), number)
        return outcome

    def failed(code: int, t_ns: int) -> None:
        if code == LOST_MASTER:
            seen(t_ns, EMERGENCY + number, LOST_MASTER.to_bytes(2, "little"), number)
        error(code, t_ns)

    unit.write, unit.read, unit.error, unit.write_as_stranger = written, was_read, failed, meddled


def place_of(bus: Any) -> Place | None:
    """Where the master of a simulated bus is watched; None for one of a real bus."""
    wire = getattr(bus, "_wire", None)
    if wire is not None:
        owner = getattr(wire._port, "_bus", None)
        simulated = hasattr(owner, "world") and hasattr(owner, "controller")
        return CanPlace(owner.world, owner.controller.port) if owner is not None and simulated else None
    line = getattr(bus, "_transport", None)
    return ModbusPlace(line) if hasattr(line, "unit") and hasattr(line, "_drives") else None


def pdos_of(plan: Any) -> list[Json]:
    """The frames of a part of a plan, those of Modbus as they are written down here."""
    told: list[Json] = []
    for axis in plan.axes:
        of_axis = axis.traffic.to_json(axis.rig.bus)
        told += of_axis.get("pdos", ()) if "pdos" in of_axis else _registers(axis.node)
    return told


def _registers(node: int) -> list[Json]:
    words = ((WRITTEN, (CONTROLWORD, TARGET)), (READ, (STATUSWORD,)))
    return [
        {"node": node, "cob_id": first + node, "octets": sum(OCTETS[each] for each in mapped), "mapped": mapped}
        for first, mapped in words
    ]
