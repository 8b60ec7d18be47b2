"""The drives of a bench before any scene is there: found, checked and watched, and none of them enabled."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from haptic_fieldbus.api.site import access_of
from haptic_fieldbus.buses.access import Observer
from haptic_fieldbus.buses.scan_result import Check, Scan
from haptic_fieldbus.defaults import DEFAULT_BUS, DEFAULT_NODE, DEFAULT_RATE
from haptic_fieldbus.drive.rig import BusSection, Rig, RigAxis
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.request import Task, check_request
from haptic_fieldbus.planning.selection import load
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.running.rights import examine
from haptic_fieldbus.running.watch import Watched

ANY_SCENE = "wall"
"""The scene whose one axis the shipped bench gets; nothing of it is rendered."""


@dataclass(frozen=True, kw_only=True)
class BenchRequest:
    """A bench by its rig, or by one drive on a bus, as for a `Task`."""

    drive: str | None = None
    bus: str | None = None
    node: int = DEFAULT_NODE
    rig: Path | Rig | None = None
    profiles: str | None = None
    rate: float = DEFAULT_RATE
    """Rate for which computer and bus are checked [Hz]."""


@dataclass(frozen=True)
class BenchLayout:
    """The buses of a bench, the axes on each, and whether a rig or the simulation describes them."""

    buses: Mapping[str, tuple[BusSection, Mapping[str, RigAxis]]]
    known: bool


def placed_on(bench: BenchRequest) -> BenchLayout:
    """Load a bench; raises DocumentError or UsageError."""
    check_request(bus=bench.bus or DEFAULT_BUS, node=bench.node, rate=bench.rate)
    task = Task(ANY_SCENE, bench.rig, drive=bench.drive, bus=bench.bus, node=bench.node, profiles=bench.profiles)
    loaded = load(task)
    axes = loaded.rig.axis
    buses = {
        name: (loaded.rig.bus[name], {axis: each for axis, each in axes.items() if each.bus == name})
        for name in dict.fromkeys(each.bus for each in axes.values())
    }
    return BenchLayout(buses, bench.rig is not None or loaded.bus.simulated)


def scans(bench: BenchRequest, nodes: Sequence[int] = ()) -> Iterator[Scan]:
    """Yield what is found on each bus; `nodes` are the numbers that are asked, none given: those of the protocol.

    Raises DocumentError, UsageError or BusError.
    """
    for section, axes in placed_on(bench).buses.values():
        protocol = protocol_named(section.protocol)
        wanted = {node: protocol.wanted_node(node, section.interface) for node in nodes}
        if wrong := [f"--node {node}: expected {words}" for node, words in wanted.items() if words]:
            raise UsageError(wrong[0])
        yield access_of(section.protocol).scan(section, axes, bench.profiles, nodes)


def examined(bench: BenchRequest) -> list[Check]:
    """Return the checks of buses and computer; raises DocumentError or UsageError."""
    buses = placed_on(bench).buses.values()
    checks = (access_of(section.protocol).checks(section, axes, bench.rate) for section, axes in buses)
    return examine(lambda: chain.from_iterable(checks), bench.rate)


@contextmanager
def watched(bench: BenchRequest) -> Iterator[tuple[dict[str, Watched], list[Observer]]]:
    """Open the buses to watch the drives; raises DocumentError, UsageError or BusError."""
    placed = placed_on(bench)
    axes: dict[str, Watched] = {}
    with ExitStack() as open_buses:
        onlookers = []
        for section, on_it in placed.buses.values():
            protocol = protocol_named(section.protocol)
            for name, axis in on_it.items():
                profile = load_profile(axis.profile)
                axes[name] = Watched(axis, profile, protocol.power_table(profile), placed.known)
            onlookers.append(open_buses.enter_context(access_of(section.protocol).onlooker(section, on_it)))
        yield axes, onlookers
