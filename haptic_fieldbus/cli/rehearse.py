"""Command `rehearse`: the first start of a drive, on a drive simulated inside this program, in real time."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer

from haptic_fieldbus.cli.bench import look
from haptic_fieldbus.cli.options import BENCH, OUTPUT, RENDERING, SceneOptions, check_plot, option_field, options_of
from haptic_fieldbus.cli.output import asks_at_terminal, never_wait
from haptic_fieldbus.cli.run import instruct, run_and_tell
from haptic_fieldbus.cli.screen import show
from haptic_fieldbus.cli.simulate import check_free, write
from haptic_fieldbus.defaults import DEFAULT_DRIVE, DEFAULT_RATE
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.numerals import exactly

WATCHED = 8.0
"""Time for which the handle is watched [s]; it moves back and forth once."""
OF_A_RIG = ("bus", "node", "rig", "axes", "zero", "faults", "prove", "force")
"""Options of `run` that a rehearsal leaves out: it has a bench of its own."""
SCENE = "wall"
TOLD = rf"A scene of the library by name, or the path of a scene file. \[default: {SCENE}]"
"""Help for the scene."""
SOFTER = "wall.stiffness=max/2"
"""Default setting of the wall: inside the limit of a rig with a stated damping."""
KEPT = "rig.toml"
HEADING = """Bench of `haptic-fieldbus rehearse`, as a run left it. For your own drive change bus, node and profile, and
motor, mechanism and limits. Omit `proved` and `seen`: they belong to the simulated drive."""
"""Comment at the beginning of a rig file."""


@dataclass(frozen=True, kw_only=True)
class RehearseOptions(SceneOptions):
    """Options of `rehearse`."""

    scene: Annotated[str, typer.Argument(metavar="SCENE", help=TOLD, show_default=False)] = SCENE
    drive: str | None = option_field("PROFILE", "Drive profile by name or path.", BENCH, told=DEFAULT_DRIVE)
    rate: float | None = option_field("HZ", "Loop rate in Hz.", RENDERING, told=exactly(DEFAULT_RATE))
    yes: bool = option_field(None, "Answer the questions with yes.")
    write_rig: Path | None = option_field(
        "FILE", "Save the rig file with the watchdog proof and the confirmed directions.", OUTPUT
    )


@options_of(RehearseOptions, without=OF_A_RIG)
def rehearse(options: RehearseOptions) -> None:
    """Practise the first start of a real drive on a simulated one in real time. With your drive: `run --rig`."""
    from haptic_fieldbus import api
    from haptic_fieldbus.api.bench import BenchRequest
    from haptic_fieldbus.api.rehearsal import rehearsal

    if not asks_at_terminal():
        if not options.yes:
            raise UsageError("no terminal to confirm on; add --yes")
        never_wait()
    if options.scene == SCENE and not options.settings:
        # The limit of a bench whose damping is stated is lower than that of the shipped one.
        options = replace(options, settings=[SOFTER])
    task, trial = options.task(), options.given(api.Trial)
    check_plot(options.plot)
    if options.write_rig is not None:
        check_free(options.write_rig)
    talk = sys.stderr if options.as_json else sys.stdout
    with TemporaryDirectory() as folder, rehearsal(task, trial) as bench:
        path = options.write_rig or Path(folder) / KEPT
        write(path, bench, HEADING)
        rig = replace(bench, source=str(path))
        show([("rehearsal", SIMULATED), *([("hand", MOVED)] if options.hand != "none" else [])], talk)
        show([("step", f"haptic-fieldbus watch --rig {path.name} --duration {WATCHED:g}")], talk)
        look(BenchRequest(rig=rig), WATCHED, talk)
        chosen = "".join(f" --set {each}" for each in options.settings or [])
        show([("step", f"haptic-fieldbus run {options.scene} --rig {path.name}{chosen}")], talk)
        talk.flush()
        tell = instruct if sys.stderr.isatty() else _once()
        run_and_tell(options, replace(task, rig=rig, drive=None), replace(trial, hand=None, instruct=tell))
    if options.write_rig is not None:
        show([("rig", str(options.write_rig))], talk)


SIMULATED = "drive, motor, handle and hand are simulated by this program; time, questions and watchdog tests are real"
MOVED = (
    "moves the handle 60 mm to the positive side and back while the drive is off; it answers for you when you are "
    "asked to move the handle"
)
"""Sentences at the beginning: about the rehearsal, and about the hand where there is one."""


def _once() -> Callable[[str], None]:
    """Return a function that prints only the first of the lines that overwrite each other on a terminal."""
    told: list[str] = []

    def tell(text: str) -> None:
        if not told:
            show([("direction", text)], sys.stderr)
        told.append(text)

    return tell
