"""The drive profiles that are shipped, and reading profiles and rigs from files.

Rules across keys, which the dataclasses cannot state, are checked here on the data as it stands in the file, so that
their faults are reported together with those of single values.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from haptic_fieldbus.documents import (
    Document,
    KeyPath,
    file_names,
    file_of,
    is_eds,
    is_path,
    knows,
    read_document,
    schema_of,
    suggestion,
)
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import BusSection, Rig
from haptic_fieldbus.errors import ProfileError, RigError, UsageError
from haptic_fieldbus.protocols.protocol import FieldbusProtocol
from haptic_fieldbus.protocols.registry import (
    BUILT_IN,
    DEFAULT_PROTOCOL,
    UNBUILT,
    protocol_named,
    protocol_names,
    protocol_of_bus,
)

PROFILE_LOADED = ("name", "source")
"""Filled in by the loader; a profile file must not give them."""
RIG_LOADED = ("source",)

UNSOURCED = {"drive", "sources"}
"""Tables whose values need no entry in [sources]."""


def profile_folder() -> Path:
    """Where the shipped profiles are: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "profiles"
    return installed if installed.is_dir() else package.parent / "profiles"


def profile_names() -> list[str]:
    return file_names(profile_folder())


def load_profile(name_or_path: str | Path) -> DriveProfile:
    """A shipped profile by name, or any by the path of its file; an EDS or DCF makes one too (see `from_eds`).

    Raises ProfileError or EdsError with all faults of the file, UsageError for an unknown name.
    """
    if is_eds(name_or_path):
        return protocol_named(DEFAULT_PROTOCOL).vendor_profile(name_or_path)
    document = read_document(file_of("profile", name_or_path, profile_folder()), ProfileError)
    protocol = _protocol_of(document)
    profile = document.validate(protocol.profile, loaded=PROFILE_LOADED)
    document.integers(("schema",))
    protocol.check_profile(document)
    _check_sources(document, protocol.profile)
    return replace(document.checked(profile), name=Path(document.source).stem, source=document.source)


def _protocol_of(document: Document) -> FieldbusProtocol:
    """That which the file names; without one that can be used nothing else of the file can be read.

    What is no protocol at all is taken for a slip, and the rest for CANopen's.
    """
    path: KeyPath = ("drive", "protocol")
    name = document.value(*path)
    if isinstance(name, str) and name in BUILT_IN:
        return protocol_named(name)  # without a look at what is installed, which takes longer than the rest
    known = protocol_names()
    if isinstance(name, str) and name in UNBUILT and name not in known:
        document.fault(path, f'"{name}" is not available yet in this version; there is: {", ".join(known)}')
        return document.checked(None)
    if isinstance(name, str) and name not in known:
        document.refuse(path, " or ".join(f'"{each}"' for each in known))
    return protocol_named(name if isinstance(name, str) and name in known else DEFAULT_PROTOCOL)


def profile_summaries() -> list[dict[str, str | bool]]:
    """What `profiles list` shows of each shipped profile."""
    return [
        {
            "name": profile.name,
            "vendor": profile.drive.vendor,
            "model": profile.drive.model,
            "protocol": profile.drive.protocol,
            "usable": profile.drive.usable,
            "evidence": profile.drive.evidence,
        }
        for profile in map(load_profile, profile_names())
    ]


def load_rig(path: str | Path) -> Rig:
    """A rig file; a profile that it gives as a path is taken from the rig's folder. Raises RigError with all faults."""
    document = read_document(Path(path), RigError)
    rig = document.validate(Rig, loaded=RIG_LOADED)
    nodes: dict[tuple[object, object], str] = {}
    buses = {name: _check_bus_section(document, name) for name in document.table("bus")}
    for name in document.table("axis"):
        document.integers(("axis", name, "mechanism", "sign"))
        _check_bus(document, name, nodes)
        _check_node(document, name)
        _check_profile_exists(document, name)
        _check_position_limits(document, name)
        _check_simulation(document, name)
    rig = document.checked(rig)
    folder = Path(path).resolve().parent
    axes = {
        name: replace(axis, profile=str(folder / axis.profile)) if is_path(axis.profile) else axis
        for name, axis in rig.axis.items()
    }
    return replace(rig, axis=axes, bus={name: bus for name, bus in buses.items() if bus}, source=document.source)


def profile_schema(protocol: str = DEFAULT_PROTOCOL) -> dict[str, Any]:
    """The JSON Schema of a profile file of a protocol."""
    return schema_of(protocol_named(protocol).profile, loaded=PROFILE_LOADED)


def bus_schema(protocol: str = DEFAULT_PROTOCOL) -> dict[str, Any]:
    """The JSON Schema of a bus of a protocol, as a rig file has it."""
    return schema_of(protocol_named(protocol).section)


def rig_schema() -> dict[str, Any]:
    """The JSON Schema of a rig file, its buses those of our own protocols."""
    schema = schema_of(Rig, loaded=RIG_LOADED)
    schema["$defs"]["BusSection"] = {"anyOf": [bus_schema(name) for name in BUILT_IN]}
    return schema


def _check_sources(document: Document, schema: type[DriveProfile]) -> None:
    """Each value says where it comes from; a source may also say why a value is left out, but must name a known key."""
    sources = document.table("sources")
    for section in document.data.keys() - UNSOURCED:
        for key, value in document.table(section).items():
            for path in _unsourced((section, key), value, sources):
                if knows(schema, path):
                    document.fault(path, f'no source; expected an entry "{".".join(path)}" in [sources]', also=True)
    keys = {".".join(path) for path in _keys(document.data) if path[0] != "sources"}
    for name in sources:
        if name not in keys and not knows(schema, tuple(name.split("."))):
            document.fault(("sources", name), f"the source of an unknown key{suggestion(name, keys)}")


def _unsourced(path: tuple[str, ...], value: object, sources: dict[str, object]) -> list[tuple[str, ...]]:
    """The keys at and below `path` that no source covers; a table of which nothing is covered counts as one."""
    if any(".".join(path[:length]) in sources for length in range(1, len(path) + 1)):
        return []
    if isinstance(value, dict) and any(name.startswith(".".join(path) + ".") for name in sources):
        return [inner for key, member in value.items() for inner in _unsourced((*path, key), member, sources)]
    return [path]


def _keys(table: dict[str, object], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """All keys that a file gives."""
    for key, value in table.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _keys(value, (*path, key))


def _check_bus(document: Document, axis: str, nodes: dict[tuple[object, object], str]) -> None:
    """The axis' bus is there, and no other axis has its node-ID on it."""
    bus, node = document.value("axis", axis, "bus"), document.value("axis", axis, "node")
    buses = document.table("bus")
    if isinstance(bus, str) and bus not in buses:
        document.fault(("axis", axis, "bus"), f"no [bus.{bus}] in this file{suggestion(bus, buses)}")
    if type(node) is int and isinstance(bus, str) and nodes.setdefault((bus, node), axis) != axis:
        other = nodes[bus, node]
        document.fault(("axis", axis, "node"), f"{node} is the node-ID of axis {other} on {bus}; expected another one")


def _check_bus_section(document: Document, name: str) -> BusSection | None:
    """The bus as its protocol has it; None with its faults noted."""
    try:
        protocol = _protocol_of_bus(document, name)
    except UsageError as error:
        document.fault(("bus", name, "interface"), str(error))
        return None
    return document.validate(protocol.section, ("bus", name))


def _protocol_of_bus(document: Document, name: str) -> FieldbusProtocol:
    interface = document.value("bus", name, "interface")
    return protocol_of_bus(interface) if isinstance(interface, str) else protocol_named(DEFAULT_PROTOCOL)


def _check_node(document: Document, axis: str) -> None:
    """Its protocol says which numbers there are."""
    node, bus = document.value("axis", axis, "node"), document.value("axis", axis, "bus")
    if not isinstance(bus, str) or ("bus", bus, "interface") in document.faults:
        return
    nodes = _protocol_of_bus(document, bus).nodes
    if type(node) is int and node not in nodes:
        document.refuse(("axis", axis, "node"), f"a whole number from {nodes[0]} to {nodes[-1]}")


def _check_profile_exists(document: Document, axis: str) -> None:
    name = document.value("axis", axis, "profile")
    if not isinstance(name, str):
        return
    if is_path(name):
        if not (Path(document.source).resolve().parent / name).is_file():
            document.fault(("axis", axis, "profile"), f'no file "{name}" beside this one')
    elif name not in profile_names():
        document.fault(("axis", axis, "profile"), f'no profile "{name}"{suggestion(name, profile_names())}')


def _check_position_limits(document: Document, axis: str) -> None:
    path: KeyPath = ("axis", axis, "limits", "position")
    limits = document.value(*path)
    if not isinstance(limits, list) or len(limits) != 2:
        return
    if all(isinstance(limit, int | float) for limit in limits) and not limits[0] < limits[1]:
        document.refuse(path, "the lower limit before the upper one")


def _check_simulation(document: Document, axis: str) -> None:
    """A load behind a coupling is a part of the axis' inertia; a lever hangs down only where it can turn."""
    simulation: KeyPath = ("axis", axis, "simulation")
    load, inertia = document.value(*simulation, "coupling", "load_inertia"), document.value("axis", axis, "inertia")
    if isinstance(load, int | float) and not (isinstance(inertia, int | float) and load < inertia):
        document.refuse((*simulation, "coupling", "load_inertia"), "a part of the axis' inertia, which must be given")
    hanging = document.value(*simulation, "gravity", "hanging_at")
    if hanging is not None and document.value("axis", axis, "mechanism", "kind") == "linear":
        document.refuse((*simulation, "gravity", "hanging_at"), "no such key: a linear mechanism has no lever")
