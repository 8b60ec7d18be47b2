"""Hidden benches for `twin`: drawn, recorded in one scene, and judged by another one that was not recorded."""

import math
import random
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from haptic_fieldbus import api
from haptic_fieldbus.api.twin import BenchTwin, twin
from haptic_fieldbus.drive.rig import Limits, Mechanics, Rig, Seen, default_axis
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.protocols.registry import parse_bus
from haptic_fieldbus.recordings.reading import RecordedRun, read_recording
from haptic_fieldbus.signals import Workspace

DRIVES = (("maxon_epos4", "sim"), ("generic_cia402", "sim"), ("nanotec_c5_e", "sim"), ("elmo_gold", "sim"),
          ("ingenia_everest", "sim"), ("generic_cia402_modbus", "sim-modbus-tcp"))  # fmt: skip
Pair = tuple[str, str, dict[str, float]]
"""Scene, hand, and settings that are stable on every drawn bench."""
WALL, SOFT = {"wall.stiffness": 120.0}, {"spring.stiffness": 100.0}
LASTING: tuple[Pair, ...] = (
    ("wall", "shake", WALL), ("spring", "shake", SOFT), ("damper", "shake", {}), ("detents", "shake", {}),
    ("damped_wall", "shake", WALL | {"wall.damping": 2.0}), ("spring", "sine", SOFT),
    ("friction", "shake", {}), ("detents", "guide", {}),
)  # fmt: skip
"""Runs of a minute in which the handle moves. The first has contact and free motion, and tells all values."""
OTHERS: tuple[Pair, ...] = (
    ("wall", "release", WALL), ("wall", "push", WALL), ("spring", "tap", SOFT), ("damper", "guide", {}),
    ("friction", "guide", {}), ("wall", "guide", WALL), ("detents", "push", {}), ("damper", "sine", {}),
)  # fmt: skip
"""Runs that were not recorded, and are predicted."""
CHANGED = {"inertia": "inertia", "lag": "delay_and_lag", "counts": "encoder_counts_per_revolution"}
"""Planted changes, and the names by which they are told."""
LARGEST_ERROR, PREDICTED, NAMED, FALSE = 0.1, 0.9, 0.95, 0.05
"""Largest error of a prediction, and shares of benches and changes that must hold."""


@dataclass(frozen=True)
class HiddenBench:
    """A rig that states one bench, and has another one as its simulation."""

    rig: Rig
    rate: float

    @property
    def truth(self) -> Mechanics:
        return self.rig.axis["handle"].simulation

    @property
    def stated(self) -> Rig:
        """The rig without what is hidden."""
        return self.with_truth(Mechanics()).rig

    def with_truth(self, truth: Mechanics) -> "HiddenBench":
        axis = replace(self.rig.axis["handle"], simulation=truth)
        return replace(self, rig=replace(self.rig, axis={"handle": axis}))

    def changed(self, kind: str) -> "HiddenBench":
        """The bench with inertia + 15 %, a lag longer by 0.2 ms, or four times the counts."""
        truth, counts = self.truth, self.rig.axis["handle"].encoder_counts_per_revolution
        if kind == "inertia":
            return self.with_truth(replace(truth, inertia=1.15 * (truth.inertia or 0.0)))
        if kind == "counts":
            return self.with_truth(replace(truth, encoder_counts_per_revolution=4 * counts))
        lag = 1.0 / (2.0 * math.pi * (truth.torque_bandwidth or 0.0)) + 2e-4
        return self.with_truth(replace(truth, torque_bandwidth=1.0 / (2.0 * math.pi * lag)))


def hidden_bench(seed: int) -> HiddenBench:
    """Draw drive, rate and counts, and a bench with up to three times or a third of the values of its rig."""
    draw = random.Random(f"twin/{seed}")
    profile, bus = draw.choice(DRIVES)
    counts = round(2.0 ** draw.uniform(10.0, 16.0))
    shipped = default_axis(Workspace.LINEAR, bus="bus", node=5, profile=profile)
    stated = replace(
        shipped, encoder_counts_per_revolution=counts, limits=Limits(speed=10.0), raise_max_torque=True,
        seen=Seen(sign="seen"),
    )  # fmt: skip
    inertia, damping, friction = (value * 3.0 ** draw.uniform(-1.0, 1.0) for value in (4.0e-5, 1.0e-4, 2.0e-3))
    torque_scale = draw.choice([1.0] * 4 + [1.25 ** draw.uniform(-1.0, 1.0)])
    truth = Mechanics(
        torque_scale=torque_scale, inertia=inertia, viscous_damping=damping, coulomb_friction=friction,
        torque_bandwidth=10.0 ** draw.uniform(2.5, 3.3),
    )  # fmt: skip
    rig = Rig({"bus": parse_bus(bus).section}, {"handle": replace(stated, simulation=truth)})
    return HiddenBench(rig, draw.choice([500.0, 1000.0]))


def recorded(
    bench: HiddenBench, pair: Pair, file: Path, seconds: float, seed: int, rig: Rig | None = None
) -> RecordedRun:
    """Run a pair of scene and hand on the simulated bench, and return its rows."""
    scene, hand, settings = pair
    api.run(scene, rig or bench.rig, rate=bench.rate, settings=settings, hand=hand, duration=seconds, seed=seed,
            record=file, force=True)  # fmt: skip
    return read_recording(file)


def errors_between(truth: RecordedRun, found: RecordedRun) -> tuple[float, float]:
    """Return the errors of position and of force, as shares of their rms; infinite when one run ended earlier."""
    shares = []
    for name in ("handle.position", "handle.command"):
        if len(truth) != len(found):
            return math.inf, math.inf
        rms = math.sqrt(float(np.mean(truth[name] ** 2))) or 1.0
        shares.append(math.sqrt(float(np.mean((truth[name] - found[name]) ** 2))) / rms)
    return shares[0], shares[1]


def twin_of(found: RecordedRun, rig: Rig, folder: Path) -> tuple[BenchTwin, Rig]:
    """Return the twin, and the rig that is read from its file."""
    made = twin(found, rig)
    file = folder / f"{len(list(folder.iterdir()))}.toml"
    file.write_text(made.text, encoding="utf-8")
    assert len(made.text.splitlines()) <= 60
    return made, load_rig(file)


def prediction(seed: int) -> tuple[float, float]:
    """Record a minute of one scene on a hidden bench, and return the errors of its twin in another scene."""
    bench, draw = hidden_bench(seed), random.Random(f"pairs/{seed}")
    lasting, other = draw.choice(LASTING), draw.choice(OTHERS)
    with TemporaryDirectory() as name:
        folder = Path(name)
        _, rig = twin_of(recorded(bench, lasting, folder / "minute.mcap", 60.0, seed), bench.stated, folder)
        truth = recorded(bench, other, folder / "other.mcap", 10.0, seed + 1000)
        return errors_between(truth, recorded(bench, other, folder / "twin.mcap", 10.0, seed + 1000, rig))


def verdicts(seed: int) -> dict[str, bool]:
    """Return whether each planted change is named, and whether a bench that did not change is left alone."""
    bench = hidden_bench(seed)
    with TemporaryDirectory() as name:
        folder = Path(name)
        _, rig = twin_of(recorded(bench, LASTING[0], folder / "first.mcap", 20.0, seed), bench.stated, folder)
        told = {}
        for kind in ("nothing", *CHANGED):
            later = bench if kind == "nothing" else bench.changed(kind)
            changed = twin(recorded(later, LASTING[0], folder / f"{kind}.mcap", 20.0, seed + 77), rig).changed
            names = [each.name for each in changed]
            told[kind] = CHANGED[kind] in names if kind in CHANGED else not names
        return told


def hidden_twins(first: int, count: int) -> dict[str, object]:
    """Findings of a chunk of the soak: how many twins predict, changes that are named, and false alarms."""
    sums = dict.fromkeys(("benches", "predicted", "named", "false"), 0)
    for seed in range(first, first + count):
        told = verdicts(seed)
        sums["benches"] += 1
        sums["predicted"] += max(prediction(seed)) <= LARGEST_ERROR
        sums["named"] += sum(told[kind] for kind in CHANGED)
        sums["false"] += not told["nothing"]
    return {"broken": [], "twins": sums}


def wrong_with_twins(found: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Yield what all twins of a soak together do not hold; of few benches a share is rounded down to whole ones."""
    parts = [each["twins"] for each in found if "twins" in each]
    sums = {key: sum(part[key] for part in parts) for key in ("benches", "predicted", "named", "false")}
    if sums["predicted"] < int(PREDICTED * sums["benches"]):
        yield f"twins: {sums['predicted']} of {sums['benches']} predict a scene that was not recorded"
    if sums["named"] < NAMED * len(CHANGED) * sums["benches"]:
        yield f"twins: {sums['named']} of {len(CHANGED) * sums['benches']} planted changes are named"
    if sums["false"] > FALSE * sums["benches"] and sums["false"] > 1:
        yield f"twins: {sums['false']} of {sums['benches']} unchanged benches are called changed"
