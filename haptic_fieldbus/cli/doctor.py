"""Command `doctor`: is this computer, its adapter and its bus fit for a loop?"""

import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from haptic_fieldbus.cli.options import (
    BENCH,
    DRIVE,
    RENDERING,
    frequency,
    note_assumed_bitrate,
    option,
    options_of,
    refuse_beside_rig,
)
from haptic_fieldbus.cli.scan import BusOptions
from haptic_fieldbus.cli.screen import print_json, show
from haptic_fieldbus.defaults import DEFAULT_NODE, DEFAULT_RATE

if TYPE_CHECKING:
    from haptic_fieldbus.api.bench import BenchRequest

WORDS = {True: "ok", False: "not ok", None: "-"}
FAILED = ("adapter", "round_trip")
"""Checks of which a failed one is a bus that failed; all others are advice."""


@dataclass(frozen=True, kw_only=True)
class DriveOptions(BusOptions):
    """Options of a command that looks at drives without a scene."""

    drive: Annotated[str | None, option("PROFILE", "Drive profile by name or path.", BENCH, default=DRIVE)] = None
    node: Annotated[int | None, option("ID", "Node-ID of the drive.", BENCH, default=DEFAULT_NODE)] = None

    def bench(self) -> "BenchRequest":
        """Return the bench that the options name; raises UsageError when `--rig` meets `--drive` or `--node`."""
        refuse_beside_rig(self.rig, self.drive, self.node)
        return super().bench()


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(DriveOptions):
    """Options of `doctor`."""

    rate: Annotated[
        float, option("HZ", "Rate of the loop that is to run.", RENDERING, default=DEFAULT_RATE, parser=frequency)
    ] = DEFAULT_RATE


@options_of(DoctorOptions)
def doctor(options: DoctorOptions) -> None:
    """Check adapter, bus and computer before a drive is used, and say what to do about each fault."""
    from haptic_fieldbus.api.bench import examined

    show(note_assumed_bitrate(options.bus), sys.stderr)
    checks = examined(options.bench())
    if options.as_json:
        print_json({"checks": [check.to_json() for check in checks]})
    else:
        for check in checks:
            show([(WORDS[check.ok], f"{check.name.replace('_', ' ')}: {check.measured}")])
            if check.advice:
                show([("", check.advice)])
    if any(check.ok is False and check.name in FAILED for check in checks):
        raise typer.Exit(1)
