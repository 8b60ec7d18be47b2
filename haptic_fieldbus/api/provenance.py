"""Provenance of a run that is about to begin, and the run again that it describes."""

import json
import math
import os
import platform
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from haptic_fieldbus.defaults import SIMULATION
from haptic_fieldbus.documents import is_path, table_of
from haptic_fieldbus.documents.edits import file_text
from haptic_fieldbus.drive.rig import Rig
from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.planning.request import Task, check_fade_in, check_request
from haptic_fieldbus.planning.selection import load, parsed
from haptic_fieldbus.protocols.catalogue import load_rig, profile_file
from haptic_fieldbus.recordings.provenance import (
    Conditions,
    Provenance,
    RunText,
    digest,
    hidden,
    marked,
    scrubbed,
    without_secrets,
)
from haptic_fieldbus.scenes.registry import kind_of
from haptic_fieldbus.scenes.scene import Scene
from haptic_fieldbus.sim.faults import Fault, load_faults, toml_of
from haptic_fieldbus.sim.hand import HANDS, hand_named

PACKAGE = "haptic-fieldbus"
USED = ("numpy", "pydantic", "python-can", "canopen", "pymodbus", "pyserial")
"""Packages that a run may use."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of Python, of this package and of those that a run uses."""
    found = {"python": platform.python_version()}
    for name in (PACKAGE, *USED):
        with suppress(PackageNotFoundError):  # run from a folder that was never installed
            # The rest of these texts is long, and `importlib.metadata.version` parses all of it.
            stated = re.search("^Version: (.+)$", distribution(name).read_text("METADATA") or "", re.MULTILINE)
            found[name] = stated[1] if stated else version(name)
    return found


def provenance_of(
    plan: Plan,
    task: Task,
    conditions: Conditions,
    faults: tuple[Fault, ...],
    bus: str,
    *,
    anonymous: bool,
    repeats: Provenance | None = None,
) -> Provenance:
    """Return the provenance of a run that is about to begin; `conditions` and `faults` are those that act.

    The files of one that repeats another are those of that one, since its own last only as long as the run.
    """
    profiles = texts_of_profiles(plan.rig, task)
    provenance = Provenance(
        **_here(anonymous=anonymous),
        scene=text_of_scene(plan.scene),
        rig=text_of_rig(plan.rig, profiles),
        profiles=tuple({text.name: text for text in profiles.values()}.values()),
        faults=RunText.of("faults.toml", toml_of(faults)) if faults else None,
        settings=dict(parsed(task.settings)),
        conditions=conditions,
        bus=hidden(bus),
        simulated=plan.simulated,
        rehearsed=any(section.rehearsed for section in plan.rig.bus.values()),
    )
    if repeats is not None:
        scene, rig = cast(RunText, repeats.scene), repeats.rig
        provenance = replace(
            provenance, scene=_from(provenance.scene, scene), rig=_from(provenance.rig, rig),
            profiles=repeats.profiles, faults=repeats.faults, settings=repeats.settings,
        )  # fmt: skip
    return _without_paths(provenance) if anonymous else provenance


def _here(*, anonymous: bool) -> dict[str, Any]:
    """Return versions, date, command line, system, host and user; without host, user and folders if `anonymous`."""
    found = versions()
    return {
        "version": found.get(PACKAGE, "unknown"),
        "versions": found,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": scrubbed(sys.argv, paths=not anonymous),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "host": None if anonymous else platform.node(),
        "user": None if anonymous else os.environ.get("USER") or os.environ.get("USERNAME"),
    }


def picture_mark(task: Task | None = None, files: Iterable[Path] = ()) -> str:
    """Return the mark of a picture that shows no run: versions, date, command line, texts, and digests of files.

    It has neither host, user nor folders: such a picture is shown to others, and is not repeated.
    """
    told: dict[str, Any] = {"files": {path.name: digest(path.read_bytes()) for path in files}}
    if task is not None:
        found = load(task)
        profiles = texts_of_profiles(found.rig, task)
        texts = {"scene": text_of_scene(found.scene), "rig": text_of_rig(found.rig, profiles)}
        told["files"] |= {text.name: text.sha256 for text in profiles.values()}
        told |= {key: None if text is None else text.text for key, text in texts.items()}
    return marked(json.dumps({"schema": 1, **_here(anonymous=True), **told}))


def _from(text: RunText | None, origin: RunText) -> Any:
    """Return a text with the file that an earlier run had it from."""
    return None if text is None else replace(text, source=origin.source, source_sha256=origin.source_sha256)


def _without_paths(found: Provenance) -> Provenance:
    def bare(text: RunText | None) -> Any:
        return None if text is None else replace(text, source=None)

    profiles = tuple(map(bare, found.profiles))
    return replace(found, scene=bare(found.scene), rig=bare(found.rig), profiles=profiles, faults=bare(found.faults))


def text_of_scene(scene: Scene) -> RunText | None:
    """Return a scene as one file; None where an element is an object of Python, which no file can give."""
    kinds = [kind_of(type(element)) for element in scene.elements]
    if None in kinds:
        return None
    tables = {
        "description": scene.description,
        **({"hand": scene.hand} if scene.hand else {}),
        "passivity": scene.passivity,
        "axis": {
            axis.name: {"workspace": axis.workspace.value, **({} if axis.held is None else {"held": axis.held})}
            for axis in scene.axes
        },
        "element": [{"kind": kind, **table_of(element)} for kind, element in zip(kinds, scene.elements, strict=True)],
    }
    return RunText.of(f"{scene.name}.toml", file_text(tables), scene.source)


def text_of_rig(rig: Rig, profiles: Mapping[str, RunText]) -> RunText:
    """Return a rig as a file that names the profiles beside it."""
    table = cast(dict[str, Any], table_of(replace(rig, source="")))
    del table["source"]
    table["bus"] = without_secrets(table["bus"])
    for name, axis in rig.axis.items():
        table["axis"][name]["profile"] = profiles[axis.profile].name
    return RunText.of("rig.toml", file_text(table), rig.source)


def texts_of_profiles(rig: Rig, task: Task) -> dict[str, RunText]:
    """Return the file of each profile of a rig; of one that was fitted to its drive, the file that it was fitted from.

    Two files of one name get different names, and none has that of the rig's text.
    """
    found: dict[str, RunText] = {}
    for name in dict.fromkeys(axis.profile for axis in rig.axis.values()):
        file = name if Path(name).is_file() or " of " not in name else name.rpartition(" of ")[0]
        path = Path(file) if is_path(file) else profile_file(file, task.profiles)
        text = RunText.of(path.name, path.read_text(encoding="utf-8", errors="surrogateescape"), path)
        taken = {"rig.toml": "", **{each.name: each.sha256 for each in found.values()}}
        if taken.get(text.name, text.sha256) != text.sha256:
            text = replace(text, name=f"{len(found)}-{text.name}")
        found[name] = text
    return found


@contextmanager
def repeated(provenance: Provenance, *, simulated: bool = True) -> Iterator[tuple[Task, dict[str, Any]]]:
    """Yield the task of a recorded run and the arguments of its trial; on the simulated bench, unless not `simulated`.

    Its texts stand in a folder that lasts as long as the block. Raises UsageError when the run cannot be repeated.
    """
    if provenance.scene is None:
        raise UsageError("the recorded run cannot be repeated: an element of its scene is an object of Python")
    made = provenance.conditions
    check_request(rate=made.rate, duration=made.duration, seed=made.seed)
    check_fade_in(made.fade_in)
    _check_parts(made)
    with TemporaryDirectory(prefix="haptic-fieldbus-") as folder:

        def written(text: RunText, room: str) -> Path:
            file = Path(folder, room, text.name)
            file.parent.mkdir(exist_ok=True)
            file.write_text(text.text, encoding="utf-8", errors="surrogateescape")
            return file

        bench, *_ = [written(text, "bench") for text in (provenance.rig, *provenance.profiles)]
        faults = None
        if provenance.faults is not None:
            faults = load_faults(written(provenance.faults, "faults")) if provenance.faults.text.strip() else ()
        rig = load_rig(bench)
        _check_led(provenance, rig)
        if provenance.rig.source_sha256 is None:  # no file then: it is judged as that bench was, with exact values
            rig = replace(rig, source="")
        stand_ins = {name: rig.bus[name].in_place_of_real() for name in made.in_place_of_real if name in rig.bus}
        rig = replace(rig, bus={**rig.bus, **stand_ins})
        bus, scene = SIMULATION if simulated and not provenance.simulated else None, written(provenance.scene, "scene")
        task = Task(scene, rig, rate=made.rate, method=made.method, estimator=made.estimator, bus=bus)
        changes: Any = None
        if made.changes:
            from haptic_fieldbus.running.changes import Changes

            changes = Changes(made.changes) if made.ramp is None else Changes(made.changes, ramp=made.ramp)
        yield task, {
            "duration": made.duration, "hand": made.hand, "fade_in": made.fade_in, "seed": made.seed,
            "force": made.force, "prove": made.prove, "faults": faults, "changes": changes,
        }  # fmt: skip


def _check_parts(made: Conditions) -> None:
    """Raise UsageError for a hand, method or estimator that is not here; a recording has its name alone."""
    from haptic_fieldbus.numerics.estimators import chosen
    from haptic_fieldbus.numerics.integrators import method_named

    finders: dict[str, Callable[[str], object]] = {"hand": hand_named, "method": method_named, "estimator": chosen}
    for sort, find in finders.items():
        name = getattr(made, sort)
        try:
            if name is not None:
                find(name)
        except UsageError as error:
            raise UsageError(
                f'the {sort} "{name}" of the recorded run was an object of a program, or is from a package that is not '
                f"installed ({error}); repeat the run from Python with repeat(FILE, {sort}=...)"
            ) from error


def _check_led(provenance: Provenance, rig: Rig) -> None:
    """Raise UsageError for commands to the hand that no page has given."""
    before = 0
    for period, axis, to in provenance.conditions.led or ():
        hand = isinstance(to, str) and not axis and to in HANDS
        place = axis in rig.axis and (to is None or (isinstance(to, float) and math.isfinite(to)))
        if period < before or not (hand or place):
            told = json.dumps([period, axis, to])
            raise UsageError(f"conditions.led: {told}: expected a later period, and an axis and a place or a hand")
        before = period


def differences_of(provenance: Provenance) -> list[str]:
    """Return a sentence for each thing that a repetition has otherwise: versions, and a hand that was led for long."""
    now, hand = versions(), provenance.conditions.hand
    names = dict.fromkeys((*provenance.versions, *now))
    led = f'the hand was led on a page for longer than is recorded: the repetition has the hand "{hand}"'
    return [led] * (provenance.conditions.led is None) + [
        f"recorded with {name} {provenance.versions.get(name, 'none')}, repeated with {now.get(name, 'none')}: "
        "frames and rows may differ"
        for name in names
        if provenance.versions.get(name) != now.get(name)
    ]
