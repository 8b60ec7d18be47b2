"""Command `scan`: the nodes of a bus, by reading alone."""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from haptic_fieldbus.cli.options import BENCH, JsonOption, ProfilesOption, note_assumed_bitrate, option, options_of
from haptic_fieldbus.cli.screen import print_json, show, show_table
from haptic_fieldbus.defaults import DEFAULT_BUS
from haptic_fieldbus.errors import UsageError

if TYPE_CHECKING:
    from haptic_fieldbus.api.bench import BenchRequest
    from haptic_fieldbus.buses.found import FoundNode, Scan

NOBODY_ANSWERS = (
    "no node answered: check that the drives have power, the wiring and both 120 Ω terminators, and the bit rate; "
    "doctor tells what the adapter says"
)


@dataclass(frozen=True, kw_only=True)
class BusOptions:
    """Options of a command that needs a bus alone."""

    bus: Annotated[
        str | None,
        option("BUS", "sim@BITRATE, or INTERFACE:CHANNEL@BITRATE such as socketcan:can0.", BENCH, default=DEFAULT_BUS),
    ] = None
    rig: Annotated[Path | None, option("FILE", "Rig file, whose buses are looked at.", BENCH)] = None
    profiles: ProfilesOption = None
    as_json: JsonOption = False

    def bench(self) -> "BenchRequest":
        """Return the bench that the options name."""
        from haptic_fieldbus.api.bench import BenchRequest

        fields = BenchRequest.__dataclass_fields__
        names: dict[str, Any] = {
            name: value for name, value in vars(self).items() if name in fields and value is not None
        }
        return BenchRequest(**names)


@dataclass(frozen=True, kw_only=True)
class ScanOptions(BusOptions):
    """Options of `scan`."""

    asked: Annotated[
        str | None,
        option("IDS", "Nodes to ask, as in 1-8 or 1,3.", BENCH, "--node", default="all on CAN, 1 on Modbus"),
    ] = None

    def nodes(self) -> list[int]:
        """Return the numbers that are asked; raises UsageError for a text that is none."""
        ranges = [part.partition("-") for part in (self.asked or "").split(",") if part]
        try:
            return [node for first, _, last in ranges for node in range(int(first), int(last or first) + 1)]
        except ValueError:
            raise UsageError(f"--node {self.asked}: expected numbers, as in 1-8 or 1,3") from None


@options_of(ScanOptions)
def scan(options: ScanOptions) -> None:
    """List the nodes of a bus: who they are, their state, the profile that fits. Nothing is written to them."""
    from haptic_fieldbus.api.bench import scans

    show(note_assumed_bitrate(options.bus), sys.stderr)
    found = list(scans(options.bench(), options.nodes()))
    if options.as_json:
        nodes = [{**node.to_json(), "bus": each.bus} for each in found for node in each.nodes]  # type: ignore[dict-item]
        buses = [{"bus": each.bus, "listened": each.listened, "masters": each.masters or None} for each in found]
        print_json({"nodes": nodes, "buses": buses})  # type: ignore[dict-item]
        return
    for each in found:
        _tell_of(each)


def _tell_of(found: "Scan") -> None:
    show([("bus", found.listened)])
    if found.masters:
        show([("listened", found.masters)])
    if not found.nodes:
        show([("none", NOBODY_ANSWERS)])
        return
    show_table(
        ("node", "vendor", "product", "revision", "serial", "name", "NMT", "state", "profile"),
        (list(_cells(node)) for node in found.nodes),
    )
    show((f"node {node.node}", node.sure) for node in found.nodes if node.sure is not None)


def _cells(node: "FoundNode") -> Iterator[str]:
    yield str(node.node)
    for number in (node.vendor_id, node.product_code, node.revision, node.serial):
        yield "" if number is None else f"{number:08X}h"
    for text in (node.name, node.nmt_state, node.power_state, node.profile):
        yield text or ""
