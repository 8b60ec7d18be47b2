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
from haptic_fieldbus.drive.objects import DataType
from haptic_fieldbus.drive.profile import (
    POSITION_UNITS,
    RATED_TORQUE_UNITS,
    TORQUE_UNITS,
    VELOCITY_UNITS,
    DriveProfile,
)
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import ProfileError, RigError

PROFILE_LOADED = ("name", "source")
"""Filled in by the loader; a profile file must not give them."""
RIG_LOADED = ("source",)

SOURCED = ("identity", "torque", "position", "velocity", "pdo", "link_loss", "timing", "simulation")
"""Sections whose every value needs an entry in [sources]."""

_TYPES = {
    ("torque", "target"): ("int16", "int32"),
    ("torque", "actual"): ("int16", "int32"),
    ("position", "actual"): ("int32",),
    ("velocity", "actual"): ("int32",),
}
_UNITS = {
    ("torque", "target"): TORQUE_UNITS,
    ("torque", "actual"): TORQUE_UNITS,
    ("torque", "rated"): tuple(RATED_TORQUE_UNITS),
    ("position", "actual"): POSITION_UNITS,
    ("velocity", "actual"): VELOCITY_UNITS,
}
_OPTIONS = (("link_loss", "abort_connection_option"), ("link_loss", "fault_reaction_option"))


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
        return _profile_of_eds(name_or_path)
    document = read_document(file_of("profile", name_or_path, profile_folder()), ProfileError)
    profile = document.validate(DriveProfile, loaded=PROFILE_LOADED)
    document.integers(("schema",))
    _check_motion(document)
    _check_signals(document)
    _check_objects(document)
    _check_sources(document)
    return replace(document.checked(profile), name=Path(document.source).stem, source=document.source)


def _profile_of_eds(path: str | Path) -> DriveProfile:
    from haptic_fieldbus.drive.from_eds import profile_from_eds
    from haptic_fieldbus.eds import load_eds

    return profile_from_eds(load_eds(path))


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
    for name in document.table("axis"):
        document.integers(("axis", name, "mechanism", "sign"))
        _check_bus(document, name, nodes)
        _check_profile_exists(document, name)
        _check_position_limits(document, name)
        _check_simulation(document, name)
    rig = document.checked(rig)
    folder = Path(path).resolve().parent
    axes = {
        name: replace(axis, profile=str(folder / axis.profile)) if is_path(axis.profile) else axis
        for name, axis in rig.axis.items()
    }
    return replace(rig, axis=axes, source=document.source)


def profile_schema() -> dict[str, Any]:
    """The JSON Schema of a profile file."""
    return schema_of(DriveProfile, loaded=PROFILE_LOADED)


def rig_schema() -> dict[str, Any]:
    """The JSON Schema of a rig file."""
    return schema_of(Rig, loaded=RIG_LOADED)


def _check_motion(document: Document) -> None:
    """The handle must be seen: by its position, or by its velocity."""
    if "position" not in document.data and "velocity" not in document.data:
        document.fault(
            ("position",), "missing, and so is [velocity]; expected position.actual, velocity.actual or both"
        )


def _check_signals(document: Document) -> None:
    """Types and units that force can be rendered with; a profile that says it is not usable may have others."""
    if document.value("drive", "usable") is False:
        if "drive.usable" not in document.table("sources"):
            document.fault(
                ("drive", "usable"), 'false without its reason; expected an entry "drive.usable" in [sources]'
            )
        return
    known = [data_type.value for data_type in DataType]
    for path, types in _TYPES.items():
        found = document.value(*path, "type")
        if found in known and found not in types:
            document.refuse((*path, "type"), " or ".join(f'"{name}"' for name in types))
    for path, units in _UNITS.items():
        found = document.value(*path, "unit")
        if document.table(*path) and found not in units:
            document.refuse((*path, "unit"), " or ".join(f'"{name}"' for name in units))


def _check_objects(document: Document) -> None:
    """Each object has one use: two signals, or two options, in one object are a slip of copying."""
    used: dict[tuple[int, str], str] = {}
    for path in (*_UNITS, *_OPTIONS):
        index, subindex = document.value(*path, "object"), str(document.value(*path, "subindex") or 0)
        if not isinstance(index, int):
            continue
        name = ".".join(path)
        first = used.setdefault((index, subindex), name)
        if first != name:
            document.fault((*path, "object"), f"0x{index:04X} is {first} already; expected another object")


def _check_sources(document: Document) -> None:
    """Each value says where it comes from; a source may also say why a value is left out, but must name a known key."""
    sources = document.table("sources")
    for section in SOURCED:
        for key, value in document.table(section).items():
            for path in _unsourced((section, key), value, sources):
                if knows(DriveProfile, path):
                    document.fault(path, f'no source; expected an entry "{".".join(path)}" in [sources]', also=True)
    keys = {".".join(path) for path in _keys(document.data) if path[0] != "sources"}
    for name in sources:
        if name not in keys and not knows(DriveProfile, tuple(name.split("."))):
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
