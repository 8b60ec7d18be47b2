"""Random accesses to the objects of CiA 402-2: the drive never fails, its statusword is always that of one state."""

import math
import struct
from random import Random

import pytest

from haptic_fieldbus.sim.drive.objects import Defaults, rows
from haptic_fieldbus.sim.drive.settings import DriveSettings
from tests.sim.bench import MS, NODE, DriveBench
from tests.sim.drive.sentences import STATES

TABLE = rows(Defaults(0.4, 3000, 5000, 0.05, 20.0, 4096, 1000, 1000))
WORDS = (0x00, 0x02, 0x06, 0x07, 0x0F, 0x1F, 0x3F, 0x5F, 0x10F, 0x80)
MODES = (0, 1, 3, 4, 6, 8, 9, 10)


def _value(random: Random, low: int, high: int) -> int:
    """Small ones, ends of the range, anything."""
    return random.choice((low, high, random.randint(low, high), max(low, min(high, random.randint(-200, 200)))))


def _step(bench: DriveBench, random: Random) -> None:
    kind = random.random()
    if kind < 0.35:
        row = random.choice(TABLE)
        bench.write(row.index, row.subindex, _value(random, *row.type.limits), row.type.code)
    elif kind < 0.45:
        bench.write(0x6071, 0, _value(random, -32768, 32767), "h")
    elif kind < 0.6:
        bench.write(0x6060, 0, random.choice(MODES), "b")
    elif kind < 0.95:
        word = random.choice((*WORDS, 0x0F, 0x0F, 0x1F))
        for controlword in (0x06, 0x07, word) if random.random() < 0.3 else (word,):
            bench.give(0x200 + NODE, struct.pack("<H", controlword))
    elif kind < 0.97:
        bench.drive.sto(random.random() < 0.5, bench.t_ns)
    else:
        bench.drive.fault(0x2310, bench.t_ns)
    if random.random() < 0.3:
        bench.sync()
    bench.run(random.choice((0, 100_000, MS, 5 * MS)))


@pytest.mark.thorough("six storms", quick=1)
@pytest.mark.parametrize("seed", range(6))
def test_a_storm_of_values_leaves_a_drive_that_works(seed: int) -> None:
    random = Random(seed)
    settings = DriveSettings(mode_change_ns=seed % 2 * 3 * MS, following_error_faults=seed % 3 == 0)
    bench = DriveBench(settings=settings)
    bench.nmt(1)
    seen = set()
    for _ in range(1500):
        _step(bench, random)
        word = bench.status()
        matching = [name for name, (mask, value) in STATES.items() if word & mask == value]
        assert len(matching) == 1, hex(word)
        seen.add(matching[0])
        assert math.isfinite(bench.drive.plant.velocity)
        assert bench.slave.due_ns >= bench.t_ns
        if matching[0] in ("switch on disabled", "ready to switch on", "switched on", "fault"):
            assert bench.read(0x6074) == 0
    assert seen >= {"switch on disabled", "operation enabled", "fault", "quick stop active"}
