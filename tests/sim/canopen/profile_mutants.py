"""One-step mutations of a profile, and whether anything notices before there is torque: loading, `check`, read-back."""

import copy
import json
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import can

from haptic_fieldbus.buses.canopen.master import CanopenBus
from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.drive.profile import DataType
from haptic_fieldbus.drive.rig import COUNTS, RATED_TORQUE_UNITS, TENTH_DEGREE
from haptic_fieldbus.eds import Eds
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.planning.compile import compile_plan
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.sim.canopen.eds_proof import proof_of
from tests.builders import WALL, rig_of, unproved

SHOWN = ("identity", "torque", "position", "velocity", "pdo", "setup", "sync", "commissioning", "link_loss")
NOT_SHOWN = {
    "torque.echo", "torque.controlword", "torque.slope.value", "torque.target.unit", "torque.actual.unit",
    "torque.demand.unit", "torque.rated_current.unit", "position.actual.unit", "setup.writes.value",
    "pdo.rpdo_acts", "pdo.tpdo_types", "pdo.rpdo_types", "sync.shortest_period", "commissioning.tool",
    "commissioning.shown.unit", "commissioning.shown.needed",
    "link_loss.deadline", "link_loss.reacts",
    "link_loss.abort_connection_option.value", "link_loss.fault_reaction_option.value",
}  # fmt: skip
"""Keys whose right value no EDS and no object of a drive can show: units of torque, choices, what a person knows.

The unit of a position is shown by 60A8h where a file gives its value; most do not."""
OPTIONAL = (
    "identity.vendor_id", "identity.product_codes", "torque.actual", "torque.demand", "torque.rated",
    "torque.rated_current", "sync.interpolation_time", "sync.cycle_period", "link_loss.heartbeat_consumer",
    "link_loss.life_guarding", "link_loss.abort_connection_option", "link_loss.fault_reaction_option",
)  # fmt: skip
"""Keys that a profile may leave out; that, too, is a mutation."""
Path_ = tuple[str | int, ...]


@dataclass(frozen=True)
class Mutant:
    """A profile with one other value."""

    key: str
    change: str
    text: str


def mutants(text: str) -> Iterator[Mutant]:
    """Each value of a profile that can be shown, changed by one step, and each optional key left out."""
    data = tomllib.loads(text)
    for path, value in _leaves(data):
        key = ".".join(name for name in path if isinstance(name, str))
        if path[0] in SHOWN and key not in NOT_SHOWN:
            for other in _steps(str(path[-1]), value, path):
                yield Mutant(key, f"{value} → {other}", _changed(data, path, other))
            if path[-1] == "object":
                yield Mutant(f"{key.removesuffix('object')}subindex", "+ 1", _next_subindex(data, path[:-1]))
    for key in OPTIONAL:
        section, name = key.split(".")
        if name in data.get(section, {}):
            without = copy.deepcopy(data)
            del without[section][name]
            yield Mutant(key, "left out", toml(without))


def _leaves(value: Any, path: Path_ = ()) -> Iterator[tuple[Path_, Any]]:
    if isinstance(value, dict):
        for name, member in value.items():
            yield from _leaves(member, (*path, name))
    elif isinstance(value, list) and not (path and path[-1] in ("powers", "values")):
        for number, member in enumerate(value):
            yield from _leaves(member, (*path, number))
    else:
        yield path, value


def _steps(name: str, value: Any, path: Path_) -> Iterator[Any]:
    """Other values, one step away."""
    if name == "type":
        yield from (other.value for other in DataType if other.value != value)
    elif name == "unit":
        known = tuple(RATED_TORQUE_UNITS) if "rated" in path else (COUNTS, TENTH_DEGREE)
        yield from (other for other in known if other != value)
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, list):
        yield from ([member + step for member in value] for step in (-1, 1))
    elif isinstance(value, float):
        yield from (10 * value + 0.001, 0.0 if value else 0.01)
    elif isinstance(value, int):
        yield from (value - 1, value + 1)
        if name == "mode_of_operation":
            yield -value


def _changed(data: dict[str, Any], path: Path_, value: Any) -> str:
    other = copy.deepcopy(data)
    inner: Any = other
    for name in path[:-1]:
        inner = inner[name]
    inner[path[-1]] = value
    return toml(other)


def _next_subindex(data: dict[str, Any], path: Path_) -> str:
    inner: Any = data
    for name in path:
        inner = inner[name]
    return _changed(data, (*path, "subindex"), inner.get("subindex", 0) + 1)


def toml(data: dict[str, Any]) -> str:
    """As TOML, with inline tables below the first level."""
    plain = [f"{name} = {_inline(value)}" for name, value in data.items() if not isinstance(value, dict)]
    for name, table in data.items():
        if isinstance(table, dict):
            plain += [f"[{name}]", *(f"{json.dumps(key)} = {_inline(value)}" for key, value in table.items())]
    return "\n".join(plain)


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{json.dumps(name)} = {_inline(member)}' for name, member in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(map(_inline, value))}]"
    return json.dumps(value, ensure_ascii=False)


def told_by(mutant: Mutant, original: CanopenProfile, sheets: Iterable[Eds], folder: Path) -> str:
    """Places that notice: "load", "check" beside any of the files of the drive, or "drive"; empty for nobody."""
    path = folder / f"{original.name}.toml"
    path.write_text(mutant.text, encoding="utf-8")
    try:
        profile = canopen_profile(load_profile(path))
    except HapticFieldbusError:
        return "load"
    if any(proof_of(profile, eds).faults for eds in sheets):
        return "check"
    try:
        configure(profile, original.name)
    except HapticFieldbusError:
        return "drive"
    return ""


def configure(profile: CanopenProfile, drive: str) -> None:
    """Let the master inspect and configure the simulated drive of a shipped profile; raises its errors."""
    rig = rig_of(WALL, profile=drive, raise_max_torque=True, emergency_stop="power")
    plan = unproved(compile_plan(WALL, rig, {drive: profile}, 1000.0))
    clock = VirtualClock()
    with can.Bus(interface="haptic_sim", channel=f"{drive}@1", clock=clock) as bus:
        master = CanopenBus(bus, clock, None)
        master.open(replace(plan))
        master.stop()
