"""Command `simulate`: host simulated drives in real time on a bus that other programs join."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from haptic_fieldbus.cli.options import BENCH, DRIVE, HANDS, OUTPUT, SIMULATION, ProfilesOption, note_bitrate, option
from haptic_fieldbus.cli.output import never_wait
from haptic_fieldbus.cli.screen import json_text, show
from haptic_fieldbus.defaults import DEFAULT_HOSTED_HAND, DEFAULT_NODE, DEFAULT_SEED
from haptic_fieldbus.errors import UsageError

if TYPE_CHECKING:
    from haptic_fieldbus.drive.rig import Rig
    from haptic_fieldbus.protocols.protocol import BusName
    from haptic_fieldbus.sim.drive_on_bus import DriveOnBus


HEADING = """Bench of the drives that `haptic-fieldbus simulate` hosts, for `haptic-fieldbus run SCENE --rig FILE`.
The first run tests the drive watchdogs and saves the proof here."""
"""Comment at the beginning of a rig file."""


def simulate(
    drive: Annotated[
        list[str] | None, option("PROFILE@NODE", "Drive profile by name or path, may be repeated.", default=DRIVE)
    ] = None,
    bus: Annotated[
        str | None,
        option(
            "BUS",
            "Bus to host on, such as socketcan:can0, udp_multicast:239.74.163.2, modbus-tcp:127.0.0.1:0 or "
            "modbus-rtu:pty.",
        ),
    ] = None,
    node: Annotated[int, option("ID", "Node-ID of the first drive without one.", default=DEFAULT_NODE)] = DEFAULT_NODE,
    rig: Annotated[
        Path | None, option("FILE", "Rig file, such as a twin, whose drives and benches are simulated.", BENCH)
    ] = None,
    profiles: ProfilesOption = None,
    hand: Annotated[str, option("NAME", HANDS, SIMULATION, default=DEFAULT_HOSTED_HAND)] = DEFAULT_HOSTED_HAND,
    seed: Annotated[int, option("N", "Random seed.", SIMULATION, default=DEFAULT_SEED)] = DEFAULT_SEED,
    faults: Annotated[Path | None, option("FILE", "Faults of the drives.", SIMULATION)] = None,
    write_rig: Annotated[Path | None, option("FILE", "Write a rig file for `run` with these drives.", OUTPUT)] = None,
    as_json: Annotated[
        bool, option(None, "Print one JSON object per drive, each on its own line.", None, "--json")
    ] = False,
) -> None:
    """Host simulated drives for other programs, in real time, until Ctrl-C. `run --bus sim` needs none."""
    from haptic_fieldbus.protocols.catalogue import load_rig
    from haptic_fieldbus.running.rights import real_time
    from haptic_fieldbus.sim.faults import load_faults
    from haptic_fieldbus.sim.host_request import HostRequest, host_on, resolve, rig_of

    never_wait()  # the drives go on whether somebody reads or not
    if rig is not None and drive:
        raise UsageError("--rig and --drive: expected one of them")
    axes = tuple(load_rig(rig, profiles).axis.values()) if rig is not None else ()
    known_faults = load_faults(faults) if faults is not None else ()
    name, slots = resolve(HostRequest(drive or [], bus, node, hand, known_faults, profiles, axes))
    note_bitrate(bus)
    if write_rig is not None:
        check_free(write_rig)
    hosted_on = ""

    def opened(joined: "BusName") -> None:
        nonlocal hosted_on
        hosted_on = joined.text
        if write_rig is not None:
            write(write_rig, rig_of(joined, slots), HEADING)

    def ready(slot: "DriveOnBus") -> None:
        if as_json:
            print(json_text({"drive": slot.axis.profile, "node": slot.node, "bus": hosted_on}))
        else:
            show([("ready", f"{slot.axis.profile}, node {slot.node}, on {hosted_on}")])
        sys.stdout.flush()  # a program that started this one waits for the line

    # A loop beside us may take a processor for itself, so the drives stay free to move to another.
    with _until_asked_to_stop() as stopped, real_time(pinned=False):
        lost = host_on(name)(name, slots, seed, ready, stopped, _note, opened)
    if lost:
        _note(f"{lost} frames could not be sent: the transmit queue was full")


def check_free(path: Path) -> None:
    """Raise UsageError if the file exists already, before anything is hosted."""
    if os.path.exists(path):
        raise UsageError(
            f"{path} exists and is not overwritten, because a run saves its proofs in it. Omit --write-rig, or name "
            "another file"
        )


def write(path: Path, rig: "Rig", heading: str) -> None:
    """Write a new rig file; raises UsageError if it exists or cannot be written."""
    from haptic_fieldbus.drive.rig_units import rig_text

    try:
        with path.open("x", encoding="utf-8") as file:
            file.write(rig_text(rig, heading))
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot write {path}: {getattr(error, 'strerror', None) or error}") from error


def _note(sentence: str) -> None:
    show([("note", sentence)], sys.stderr)


@contextmanager
def _until_asked_to_stop() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns True after Ctrl-C or SIGTERM; restore the former signal handlers at the end.

    The signals raise nothing, so the drives end in order; the host looks at the function every 0.1 s.
    """
    asked: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _frame: asked.append(number))
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
