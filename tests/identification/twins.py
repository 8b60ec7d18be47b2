"""Hidden benches for `twin`: drawn, recorded in one scene, and judged by another one that was not recorded."""

import math
import random
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from haptic_fieldbus import api
from haptic_fieldbus.api.twin import BenchTwin, twin
from haptic_fieldbus.drive.rig import Limits, Mechanics, Rig, Seen, default_axis
from haptic_fieldbus.errors import HapticFieldbusError
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
"""Runs of a minute in which the handle moves; in the first there is contact and free motion, which tells all values."""
OTHERS: tuple[Pair, ...] = (
    ("wall", "release", WALL), ("wall", "push", WALL), ("spring", "tap", SOFT), ("damper", "guide", {}),
    ("friction", "guide", {}), ("wall", "guide", WALL), ("detents", "push", {}), ("damper", "sine", {}),
)  # fmt: skip
"""Runs that were not recorded, and are predicted."""


@dataclass(frozen=True)
class HiddenBench:
    """A rig that states one bench, and the truth of its simulation."""

    seed: int
    rig: Rig
    rate: float

    @property
    def truth(self) -> Mechanics:
        return self.rig.axis["handle"].simulation

    def changed(self, **values: float | int) -> "HiddenBench":
        axis = self.rig.axis["handle"]
        return replace(
            self, rig=replace(self.rig, axis={"handle": replace(axis, simulation=replace(axis.simulation, **values))})
        )

    @property
    def stated(self) -> Rig:
        """The rig without what is hidden."""
        return replace(self.rig, axis={"handle": replace(self.rig.axis["handle"], simulation=Mechanics())})


def hidden_bench(seed: int) -> HiddenBench:
    """Draw drive, rate, counts, and a bench whose values are up to three times those that its rig states."""
    draw = random.Random(f"twin/{seed}")
    profile, bus = draw.choice(DRIVES)
    counts = round(2.0 ** draw.uniform(10.0, 16.0))
    shipped = default_axis(Workspace.LINEAR, bus="bus", node=5, profile=profile)
    stated = replace(shipped, encoder_counts_per_revolution=counts, limits=Limits(speed=10.0),
                     raise_max_torque=True, seen=Seen(sign="seen"))  # fmt: skip
    inertia, damping, friction = (value * 3.0 ** draw.uniform(-1.0, 1.0) for value in (4.0e-5, 1.0e-4, 2.0e-3))
    torque_scale = draw.choice([1.0] * 4 + [1.25 ** draw.uniform(-1.0, 1.0)])
    truth = Mechanics(torque_scale=torque_scale, inertia=inertia, viscous_damping=damping, coulomb_friction=friction,
                      torque_bandwidth=10.0 ** draw.uniform(2.5, 3.3))  # fmt: skip
    rig = Rig({"bus": parse_bus(bus).section}, {"handle": replace(stated, simulation=truth)})
    return HiddenBench(seed, rig, draw.choice([500.0, 1000.0]))


def recorded(
    bench: HiddenBench, pair: Pair, file: Path, duration: float, seed: int, rig: Rig | None = None
) -> RecordedRun:
    """Run a pair of scene and hand on the simulated bench, and return its rows."""
    scene, hand, settings = pair
    api.run(scene, rig or bench.rig, rate=bench.rate, settings=settings, hand=hand, duration=duration, seed=seed,
            record=file, force=True)  # fmt: skip
    return read_recording(file)


def away(found: RecordedRun, other: RecordedRun) -> tuple[float, float]:
    """Return the error of position and of force between two runs, as shares of their rms."""
    shares = []
    for name in ("handle.position", "handle.command"):
        a, b = found[name], other[name]
        n = min(len(a), len(b))
        rms = math.sqrt(float(np.mean(a[:n] ** 2))) or 1.0
        shares.append(math.sqrt(float(np.mean((a[:n] - b[:n]) ** 2))) / rms if len(a) == len(b) else math.inf)
    return shares[0], shares[1]


PLANTED = {"inertia": "inertia", "lag": "delay_and_lag", "counts": "encoder_counts_per_revolution"}


def planted(bench: HiddenBench, kind: str) -> HiddenBench:
    truth = bench.truth
    if kind == "inertia":
        return bench.changed(inertia=1.15 * (truth.inertia or 0.0))
    if kind == "lag":
        lag = 1.0 / (2.0 * math.pi * (truth.torque_bandwidth or 1.0)) + 2e-4
        return bench.changed(torque_bandwidth=1.0 / (2.0 * math.pi * lag))
    return bench.changed(encoder_counts_per_revolution=4 * bench.rig.axis["handle"].encoder_counts_per_revolution)
