"""The parts of the soak: what each does in one chunk, how much of it there is, and what it returns."""

import os
import resource
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any
from unittest.mock import patch

from haptic_fieldbus import api
from haptic_fieldbus.errors import HapticFieldbusError
from tests.builders import endless_rig
from tests.buses.canopen.limited import RUNS, Shelf
from tests.identification import drawn
from tests.identification.twins import hidden_twins
from tests.invariants.attach import watched
from tests.soak import active, files, frames
from tests.soak.case import case_of, run_case
from tests.soak.find import shrunk_case
from tests.system import slipped_bench

WHOLE = 10_000
"""SOAK_RUNS at which every part has its full size."""
HOUR = 3600.0
LONGEST_HOUR_MEMORY = 300.0
"""[MB]; what a run of any length may take, as stated for one of half an hour."""

Found = dict[str, Any]
"""Findings of a chunk: at least `broken`, a list of sentences."""


@dataclass(frozen=True)
class Chunk:
    """A share of one part that one process does at a time."""

    part: str
    first: int
    count: int

    @property
    def key(self) -> str:
        return f"{self.part}/{self.first}/{self.count}"


@dataclass(frozen=True)
class Part:
    """One part: how many there are in a whole soak, how many in a chunk, and what a chunk does."""

    whole: int
    chunk: int
    work: Callable[[int, int], Found]


def seeded_runs(first: int, count: int) -> Found:
    """Run seeds and judge them; a failing one is told with its shrunk faults."""
    broken, times, errors, seconds = list[str](), dict[str, float](), dict[str, int](), 0.0
    counts: dict[str, int] = {}
    for seed in range(first, first + count):
        case = case_of(seed)
        verdict = run_case(case)
        seconds += verdict.seconds
        errors[str(verdict.error)] = errors.get(str(verdict.error), 0) + 1
        for kind, took in verdict.zero.items():
            times[kind], counts[kind] = max(times.get(kind, 0.0), took), counts.get(kind, 0) + 1
        if verdict.broken:
            law, sentence = verdict.broken[0]
            broken.append(f"seed {seed}: {law}: {sentence}\n{shrunk_case(case, law)}")
    return {"broken": broken, "times": times, "counts": counts, "errors": errors, "virtual_s": seconds}


def an_hour(first: int, count: int) -> Found:
    """One run of `count` seconds without a fault; its memory is bounded and no invariant breaks."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    broken = []
    with watched() as found:
        try:
            result = api.run("wall", endless_rig("wall"), duration=float(count), hand="sine", seed=first)
            broken += [] if result.cycles == round(1000.0 * count) else [f"{result.cycles} periods of {1000 * count}"]
        except HapticFieldbusError as error:
            broken.append(f"a run without a fault ended: {error}")
    broken += [f"{law}: {sentence}" for law, sentence in found.broken]
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
    return {"broken": broken, "virtual_s": float(count), "grown_mb": grown}


def into_reader(name: str, large: bool, first: int, count: int) -> Found:
    files.bounded()
    return {"broken": files.into_reader(name, first, count, large=large)}


def active_elements(first: int, count: int) -> Found:
    """Walls with a source of energy while feedback is lost, and the same walls without it."""
    cases = map(active.active_case, range(first, first + count))
    return {"broken": [sentence for case in cases for sentence in active.wrong_with(case)]}


def slipped_rigs(first: int, count: int) -> Found:
    """Rigs with slips of unit, digit and sign: the torque of the motor before the sign is seen.

    Other seeds than those of the tests.
    """
    benches = [(seed, slipped_bench.drawn(WHOLE + seed)) for seed in range(first, first + count)]
    wrong = ((seed, slipped_bench.wrong_with(bench, slipped_bench.before_the_sign(bench))) for seed, bench in benches)
    return {"broken": [f"slips {WHOLE + seed}: {sentence}" for seed, own in wrong for sentence in own]}


def without_serial(first: int, count: int) -> Found:
    """Shelves of drives that share a serial number or have none: no drive gets the torque limit of another one."""
    broken = []
    for seed in range(WHOLE + first, WHOLE + first + count):
        with TemporaryDirectory() as folder, patch.dict(os.environ, XDG_STATE_HOME=folder):
            shelf = Shelf(seed)
            broken += [f"shelf {seed}: {sentence}" for _ in range(RUNS) for sentence in shelf.wrong_with_a_run()]
    return {"broken": broken}


def into_drive(first: int, count: int) -> Found:
    return {"broken": frames.into_drive(first, count)}


def into_master(first: int, count: int) -> Found:
    return {"broken": frames.into_master(first, count)}


PARTS: Mapping[str, Part] = {
    # The longest chunk first: the others fill the second process meanwhile.
    "an hour": Part(int(HOUR), int(HOUR), an_hour),
    "seeded runs": Part(WHOLE, 50, seeded_runs),
    "identified benches": Part(300, 3, drawn.work),
    "active elements under gaps": Part(500, 10, active_elements),
    "rigs with slips": Part(2_000, 40, slipped_rigs),
    "drives without serial number": Part(1_000, 50, without_serial),
    "twins of hidden benches": Part(60, 1, hidden_twins),
    "frames into the drive": Part(500_000, 10_000, into_drive),
    "frames into the master": Part(500_000, 10_000, into_master),
    **{f"small files: {name}": Part(10_000, 500, partial(into_reader, name, False)) for name in files.READERS},
    **{f"large files: {name}": Part(1_000, 50, partial(into_reader, name, True)) for name in files.READERS},
}


def chunks(runs: int) -> Iterator[Chunk]:
    """All chunks of a soak of so many seeded runs; the other parts scale with it."""
    for name, part in PARTS.items():
        left, first = max(1, round(part.whole * runs / WHOLE)), 0
        while left > 0:
            yield Chunk(name, first, min(part.chunk, left))
            left, first = left - part.chunk, first + part.chunk


def worked(chunk: Chunk) -> Found:
    """Do a chunk; whatever it raises is found broken."""
    begun = process_time()
    try:
        found = PARTS[chunk.part].work(chunk.first, chunk.count)
    except Exception as crash:
        found = {"broken": [f"{chunk.key}: {type(crash).__name__}: {crash}"]}
    return found | {"part": chunk.part, "first": chunk.first, "count": chunk.count, "cpu_s": process_time() - begun}
