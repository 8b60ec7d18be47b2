"""The shipped drive profiles, and loading of profiles and rigs from files.

Rules across several keys, which the dataclasses cannot state, are checked here on the data of the file, before any
dataclass exists. So their faults are reported together with those of single values.
"""

import os
from collections.abc import Collection, Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from haptic_fieldbus import documents
from haptic_fieldbus.defaults import DEFAULT_PROTOCOL
from haptic_fieldbus.documents import Document, KeyPath, is_path, schema_of, suggestion
from haptic_fieldbus.documents.safe_read import IMPOSSIBLE_NAME
from haptic_fieldbus.drive.plausible import check_plausible
from haptic_fieldbus.drive.profile import DriveProfile
from haptic_fieldbus.drive.rig import LARGEST_COGGING, BusSection, Rig, RigAxis
from haptic_fieldbus.drive.rig_units import convert_units, schema_with_units
from haptic_fieldbus.errors import DocumentError, ProfileError, RigError, UsageError, wrong_kind
from haptic_fieldbus.protocols.protocol import FieldbusProtocol
from haptic_fieldbus.protocols.registry import BUILT_IN, protocol_named, protocol_names, protocol_of_bus

# Where drive profiles are: the folder that is shipped, and a folder of one's own.
#
# The caller names the own folder, else the environment variable HAPTIC_FIELDBUS_PROFILES does. Its `*.toml` are found
# by their names beside the shipped ones. A name that stands in both is refused: which of the two moves a motor must not
# depend on what somebody forgot.

VARIABLE = "HAPTIC_FIELDBUS_PROFILES"


def profile_folder() -> Path:
    """Return the folder of the shipped profiles: inside an installed package, beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "profiles"
    return installed if installed.is_dir() else package.parent / "profiles"


def profile_names() -> list[str]:
    """Return the names of the shipped profiles, sorted."""
    return documents.file_names(profile_folder())


def own_files(profiles: str | Path | None = None) -> dict[str, Path]:
    """Return the files of the own folder by their names, empty where there is no such folder.

    Names that would be taken for paths, and hidden files, are left out. Raises UsageError for a folder that cannot be
    listed.
    """
    named, said = (str(profiles), "profiles") if profiles is not None else (os.environ.get(VARIABLE, ""), VARIABLE)
    if profiles is None and not named:
        return {}
    try:
        folder = Path(named).absolute()
        if not named:
            raise FileNotFoundError(2, "no name")
        names = sorted(os.listdir(folder))
    except (OSError, ValueError) as error:
        reason = str(error.strerror) if isinstance(error, OSError) else IMPOSSIBLE_NAME
        raise UsageError(f'{said} "{named}": expected a folder of drive profiles: {reason}') from error
    stems = {name.removesuffix(".toml"): folder / name for name in names if name.endswith(".toml")}
    return {stem: path for stem, path in stems.items() if stem and stem[0] != "." and not is_path(stem)}


def known_names(profiles: str | Path | None = None) -> list[str]:
    """Return the names of all profiles, shipped and own; raises what `own_files` raises."""
    return sorted({*profile_names(), *own_files(profiles)})


def profile_file(name: str | Path, profiles: str | Path | None = None) -> Path:
    """Return the file of a profile by its name, or the path that is given.

    Raises UsageError for a name that there is not, or that is both a shipped and an own one, and what `own_files`
    raises.
    """
    own = own_files(profiles)
    if is_path(name) or name not in own:
        return documents.file_of("profile", name, profile_folder(), own)
    path, shipped = own[str(name)], profile_folder() / f"{name}.toml"
    if not path.is_file():  # a pipe would be waited for
        raise UsageError(f'profile "{name}": {path} is not a file')
    if shipped.is_file() and not shipped.samefile(path):
        raise UsageError(f'profile "{name}": both {path} and the shipped {shipped} have this name; rename yours')
    return path


def own_profile(name: str, profiles: str | Path | None = None) -> str:
    """Return the path of an own profile; the name of a shipped one, and a path, stay as they are.

    Raises the errors of `profile_file` for own names.
    """
    own = own_files(profiles)
    return str(profile_file(name, profiles)) if not is_path(name) and name in own else name


PROFILE_LOADED = ("name", "source")
"""Fields that the loader fills in; a profile file must not give them."""
RIG_LOADED = ("source",)
"""Fields that the loader fills in; a rig file must not give them."""

Nodes = dict[tuple[object, object], str]
"""Bus and node-ID → axis."""

UNSOURCED = {"drive", "sources"}
"""Tables whose values need no entry in [sources]."""


def load_profile(name_or_path: str | Path, profiles: str | Path | None = None) -> DriveProfile:
    """Load a profile by its name, or by the path of its file: TOML, EDS or DCF (see `from_eds`).

    A name is that of a shipped profile or of a file in the folder `profiles`. When that is None, the environment
    variable HAPTIC_FIELDBUS_PROFILES may name the folder. Raises ProfileError or EdsError with all faults of the file,
    UsageError for an unknown name and for one that is both a shipped and an own one.
    """
    if documents.is_eds(name_or_path):
        return protocol_named(DEFAULT_PROTOCOL).vendor_profile(name_or_path)
    path = profile_file(name_or_path, profiles)
    return _shipped(path) if path.parent == profile_folder() else _profile_of(path)


def _profile_of(path: Path) -> DriveProfile:
    document = documents.read_document(path, ProfileError)
    documents.check_kind(document, "drive")
    protocol = _protocol_of(document)
    profile = document.validate(protocol.profile, loaded=PROFILE_LOADED)
    document.integers(("schema",))  # Pydantic takes 1.0 and true for the literal 1
    protocol.check_profile(document)
    _check_sources(document, protocol.profile)
    return replace(document.checked(profile), name=Path(document.source).stem, source=document.source)


_shipped = cache(_profile_of)
"""Function that reads a file of this package once: the file does not change, and a profile cannot."""


def _protocol_of(document: Document) -> FieldbusProtocol:
    """Return the protocol that the file names, whose schema decides how the rest of the file is read.

    An unknown name is taken for a slip: its fault is noted, and the rest is checked as a profile of the default
    protocol.
    """
    name = document.value("drive", "protocol")
    if not isinstance(name, str):
        return protocol_named(DEFAULT_PROTOCOL)
    # One of this package is found without a look at what is installed, which takes longer than the rest.
    if name in BUILT_IN or name in protocol_names():
        return protocol_named(name)
    document.refuse(("drive", "protocol"), " or ".join(f'"{each}"' for each in protocol_names()))
    return protocol_named(DEFAULT_PROTOCOL)


Summary = dict[str, str | bool]
Refusal = DocumentError | UsageError


def profile_summaries(profiles: str | Path | None = None) -> dict[str, Summary | Refusal]:
    """Return the facts about each profile that `profiles list` shows, by name; of a broken one, its error."""
    return {name: _summary(name, profiles) for name in known_names(profiles)}


def _summary(name: str, profiles: str | Path | None) -> Summary | Refusal:
    """Return the facts about one profile, or the error that loading it ends in."""
    try:
        profile = load_profile(name, profiles)
    except (DocumentError, UsageError) as error:
        return error
    facts = {key: getattr(profile.drive, key) for key in ("vendor", "model", "protocol", "usable", "evidence")}
    return {"name": profile.name, **facts, "source": profile.source}


def load_rig(path: str | Path, profiles: str | Path | None = None) -> Rig:
    """Load a rig file; a profile that is given as a path is looked up relative to the folder of the rig.

    It may name every profile that `load_profile` finds. Raises RigError with all faults of the file, UsageError for a
    folder of profiles that cannot be listed.
    """
    if not isinstance(path, str | Path):
        raise wrong_kind("path", "that of a rig file", path)
    document = documents.read_document(Path(path), RigError)
    documents.check_kind(document, "bus")
    for name in document.table("bus"):
        channel = document.value("bus", name, "channel")
        # Interfaces that count their channels read the number from a text. `type`, not `isinstance`: true is an int
        # too.
        if type(channel) is int and channel >= 0:
            document.table("bus", name)["channel"] = str(channel)
    for name in document.table("axis"):
        convert_units(document, RigAxis, ("axis", name))
    rig = document.validate(Rig, loaded=RIG_LOADED)
    nodes: Nodes = {}
    known = known_names(profiles)
    # `Rig` checks only the keys that all buses share; the section of its protocol checks each whole bus.
    buses: dict[str, BusSection | None] = {}
    for name in document.table("bus"):
        section = _protocol_of_bus(document, name).section
        convert_units(document, section, ("bus", name))
        buses[name] = document.validate(section, ("bus", name))
    for name in document.table("axis"):
        document.integers(("axis", name, "mechanism", "sign"))
        _check_axis(document, name, nodes, known)
    rig = document.checked(rig)
    folder = Path(path).resolve().parent

    def located(profile: str) -> str:
        return str(folder / profile) if is_path(profile) else own_profile(profile, profiles)

    axes = {name: replace(axis, profile=located(axis.profile)) for name, axis in rig.axis.items()}
    return replace(rig, axis=axes, bus={name: bus for name, bus in buses.items() if bus}, source=document.source)


def check_rig(rig: Rig) -> None:
    """Raise RigError with all faults for which the file of a rig made in Python would be refused.

    Its profiles are looked up later, since a run may have fitted them to its drives.
    """
    document = Document(rig.source or "the rig", "", RigError)
    document.data["bus"] = {name: documents.table_of(section) for name, section in rig.bus.items()}
    document.data["axis"] = {name: documents.table_of(axis) for name, axis in rig.axis.items()}
    nodes: Nodes = {}
    for name, section in rig.bus.items():
        document.validate(type(section), ("bus", name))
    for name in rig.axis:
        document.validate(RigAxis, ("axis", name))
        _check_axis(document, name, nodes)
    document.checked(rig)


AROUND_START = "a travel that contains 0, which is the place of the handle when the drive is enabled"


def _check_axis(document: Document, name: str, nodes: Nodes, known: Collection[str] | None = None) -> None:
    """Note the faults of an axis that its dataclasses cannot state; its profile is looked up where `known` is given.

    `nodes` collects the axis of each (bus, node-ID) from call to call.
    """
    _check_bus(document, name, nodes)
    if known is not None:
        _check_profile_exists(document, name, known)
    limits: KeyPath = ("axis", name, "limits", "position")
    match document.value(*limits):
        case [int() | float() as lower, int() | float() as upper] if not lower < upper:
            document.refuse(limits, "the lower limit first")
        case [int() | float() as lower, int() | float() as upper] if not lower <= 0.0 <= upper:
            if (document.value("axis", name, "mechanism", "zero") or "start") == "start":
                document.refuse(limits, f"{AROUND_START}; for another zero state mechanism.zero, an encoder count")
    _check_simulation(document, name)
    check_plausible(document, name)


def profile_schema(protocol: str = DEFAULT_PROTOCOL) -> dict[str, Any]:
    """Return the JSON Schema of a profile file of `protocol`; raises UsageError for an unknown one."""
    return schema_of(protocol_named(protocol).profile, loaded=PROFILE_LOADED)


def bus_schema(protocol: str = DEFAULT_PROTOCOL) -> dict[str, Any]:
    """Return the JSON Schema of a bus of `protocol` in a rig file; raises UsageError for an unknown one."""
    section = protocol_named(protocol).section
    schema = schema_with_units(section, schema_of(section))
    keys, number = schema["properties"], {"minimum": 0, "type": "integer"}
    keys["channel"] = {"anyOf": [keys["channel"], number]}
    return schema


def rig_schema() -> dict[str, Any]:
    """Return the JSON Schema of a rig file with buses of the protocols in this package."""
    schema = schema_with_units(Rig, schema_of(Rig, loaded=RIG_LOADED))
    # `Rig` knows only the common keys of a bus; the schema lists the whole bus of each protocol.
    schema["$defs"]["BusSection"] = {"anyOf": [bus_schema(name) for name in BUILT_IN]}
    return schema


def _check_sources(document: Document, schema: type[DriveProfile]) -> None:
    """Note each value without a source, and each source of an unknown key.

    The source of a key that the file does not give is allowed: it tells why the value is left out.
    """
    sources = document.table("sources")
    for section in document.data.keys() - UNSOURCED:
        if isinstance(document.data[section], list) and section not in sources and documents.knows(schema, (section,)):
            document.fault((section,), f'no source; expected an entry "{section}" in [sources]')
        for key, value in document.table(section).items():
            for path in _unsourced((section, key), value, sources):
                if documents.knows(schema, path):
                    document.fault(path, f'no source; expected an entry "{".".join(path)}" in [sources]', also=True)
    # Keys of the file serve the suggestion; the schema also has keys that the file leaves out.
    keys = {".".join(path) for path in _keys(document.data) if path[0] != "sources"}
    for name in sources:
        if name not in keys and not documents.knows(schema, tuple(name.split("."))):
            document.fault(("sources", name), f"source of an unknown key{suggestion(name, keys)}")


def _unsourced(path: tuple[str, ...], value: object, sources: dict[str, object]) -> list[tuple[str, ...]]:
    """Return the keys at and below `path` that no source covers; a table without any source counts as one key."""
    # A source of any table above the key covers it too.
    if any(".".join(path[:length]) in sources for length in range(1, len(path) + 1)):
        return []
    if isinstance(value, dict) and any(name.startswith(".".join(path) + ".") for name in sources):
        return [inner for key, member in value.items() for inner in _unsourced((*path, key), member, sources)]
    return [path]


def _keys(table: dict[str, object], path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Yield the paths of all keys in a table, tables included."""
    for key, value in table.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _keys(value, (*path, key))


def _check_bus(document: Document, axis: str, nodes: Nodes) -> None:
    """Note a bus that the file does not have, a node-ID out of range, and one that another axis has on the same bus.

    `nodes` collects the axis of each (bus, node-ID) from call to call.
    """
    bus, node = document.value("axis", axis, "bus"), document.value("axis", axis, "node")
    buses, path = document.table("bus"), ("axis", axis, "node")
    if isinstance(bus, str) and bus not in buses:
        document.fault(("axis", axis, "bus"), f"no [bus.{bus}] in this file{suggestion(bus, buses)}")
    # `type`, not `isinstance`: true is an int too, and has its own fault.
    if type(node) is not int or not isinstance(bus, str):
        return
    other = nodes.setdefault((bus, node), axis)
    if other != axis:
        document.fault(path, f"{node} is already the node-ID of axis {other} on {bus}; expected another one")
    # Without a usable interface the protocol is unknown, and so is the range.
    if ("bus", bus, "interface") not in document.faults:
        wanted = _protocol_of_bus(document, bus).wanted_node(node, str(document.value("bus", bus, "interface")))
        if wanted:
            document.refuse(path, wanted)


def _protocol_of_bus(document: Document, name: str) -> FieldbusProtocol:
    """Return the protocol of a bus by its interface."""
    interface = document.value("bus", name, "interface")
    return protocol_of_bus(interface) if isinstance(interface, str) else protocol_named(DEFAULT_PROTOCOL)


def _check_profile_exists(document: Document, axis: str, known: Collection[str]) -> None:
    """Note a profile that is neither one of the `known` names nor a file beside the rig."""
    path: KeyPath = ("axis", axis, "profile")
    name = document.value(*path)
    if isinstance(name, str) and not is_path(name) and name not in known:
        document.fault(path, f'no profile "{name}"{suggestion(name, known)}')
    elif isinstance(name, str) and is_path(name) and not os.path.isfile(Path(document.source).resolve().parent / name):
        document.fault(path, f'no file "{name}" in the folder of this file')


def _check_simulation(document: Document, axis: str) -> None:
    """Note a load inertia that is no part of the axis' inertia, and a lever on a linear mechanism."""
    simulation: KeyPath = ("axis", axis, "simulation")
    coupling, gravity = (*simulation, "coupling", "load_inertia"), (*simulation, "gravity", "hanging_at")
    load, inertia = document.value(*coupling), document.value("axis", axis, "inertia")
    true = document.value(*simulation, "inertia")
    if isinstance(load, int | float) and not (isinstance(inertia, int | float) and load < inertia):
        document.refuse(coupling, "less than the inertia of the axis, which is required")
    elif isinstance(load, int | float) and isinstance(true, int | float) and load >= true:
        document.refuse(coupling, "less than simulation.inertia")
    inertia = inertia if true is None else true
    # A Rig has 0 there where none is given.
    if document.value(*gravity) and document.value("axis", axis, "mechanism", "kind") == "linear":
        document.refuse(gravity, "no such key: a linear mechanism has no lever")
    torque, periods = (document.value(*simulation, "cogging", key) for key in ("torque", "periods_per_revolution"))
    if isinstance(torque, int | float) and isinstance(periods, int) and isinstance(inertia, int | float):
        shaft = inertia - (load if isinstance(load, int | float) else 0.0)
        if torque * periods > LARGEST_COGGING * shaft > 0.0:
            most = f"at most {LARGEST_COGGING * shaft / periods:.3g}"
            expected = f"{most}: with more, the shaft oscillates about its rest above 10 kHz"
            document.refuse((*simulation, "cogging", "torque"), expected)
