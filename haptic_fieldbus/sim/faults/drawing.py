"""Faults drawn from a seed: `random@7` always gives the same kinds at the same times.

Each kind has a recipe, which draws its values from ranges in which the fault has an effect. The values are rounded, so
that the text of a drawn fault is short and reads back as the same fault.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from random import Random
from types import UnionType
from typing import Any, get_args

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.sim import faults

RANDOM = "random@"
"""Prefix of a seed where a file of faults may stand."""
MOST = 4
"""Most faults that are drawn at once; one is the most frequent."""
_END, _AT_THE_END = 0.04, 0.15
"""Time before the end that counts as the very end [s], and the least share of faults in this time."""
_WEIGHTS = (6, 3, 2, 1)
_LARGEST_SEED = 2**64 - 1
_LENGTHS = {0x000: 2, 0x080: 0, 0x201: 4, 0x701: 1, 0x77F: 1}
"""Frame lengths of identifiers with a meaning; 8 for all others."""
_TELLING = (0, 1, 5, 0x0F, 0x7F, 0x80, 0xFF)
"""Octets with a meaning in many services."""

Recipe = Callable[[Random], tuple[Any, ...]]
"""Function that draws the keys of a fault behind `at`, in their order."""
Draw = Callable[[Random, float], faults.TimedFault]
"""Function that draws one fault for a time [s]."""


def _frames(random: Random) -> faults.FrameGroup:
    return random.choice(("tpdo", "tpdo", "rpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"))


def _duration(random: Random) -> float | None:
    return random.choice((None, *(round(10 ** random.uniform(-3.0, -0.5), 4) for _ in range(3))))


def _flicker(random: Random) -> float | None:
    """Return the time for which a contact is open [s]: a short bounce, or None for good."""
    return random.choice((None, round(10 ** random.uniform(-4.0, -0.5), 4)))


def _count(random: Random, most: int = 60) -> int:
    return round(math.exp(random.uniform(0.0, math.log(most))))


def _foreign(random: Random) -> tuple[Any, ...]:
    # What a master, a drive or a bystander may say, and anything at all.
    can_id = random.choice((0x000, 0x080, 0x081, 0x100, 0x181, 0x201, 0x581, 0x601, 0x701, 0x77F, 0x7E5, None))
    length = random.choice((_LENGTHS.get(can_id or 0, 8), random.randrange(9)))
    data = [random.choice((*_TELLING, random.randrange(256))) for _ in range(length)]
    count = _count(random, 30)
    known = random.randrange(0x800) if can_id is None else can_id
    return known, tuple(data), count, random.choice((0.0005, 0.001, 0.01))


def _signed(random: Random, least: float, most: float) -> float:
    return random.choice((-1.0, 1.0)) * random.uniform(least, most)


def _of_ten(random: Random, least: float, most: float, digits: int = 5) -> float:
    """Return a power of ten between two exponents, rounded."""
    return round(10 ** random.uniform(least, most), digits)


_KEYS: Mapping[str, Callable[[Random], Any]] = {
    "delay": lambda random: _of_ten(random, -4.0, -1.3), "frames": _frames, "count": _count, "duration": _duration,
}  # fmt: skip
"""Recipes of single keys, in the order of drawing; for kinds without a recipe of their own."""

_OWN: Mapping[type[faults.TimedFault], Recipe] = {
    faults.FrameWrongLength: lambda random: (random.randrange(9), _frames(random), _count(random)),
    faults.FrameWrongNode: lambda random: (random.randint(1, 127), _frames(random), _count(random)),
    faults.ForeignFrame: _foreign,
    faults.Emergency: lambda random: (random.choice((0x1000, 0x3210, 0x4310, 0x8611)),),
    faults.DriveFault: lambda random: (random.choice((0x2310, 0x4310, 0x7305)),),
    faults.SafeTorqueOff: lambda random: (_flicker(random),),
    faults.NodeReset: lambda random: (round(random.uniform(0.001, 0.2), 4),),
    faults.MissingRpdos: lambda random: (random.choice((None, _count(random))),),
    faults.SyncIgnored: lambda random: (random.choice((None, _count(random))),),
    faults.EncoderJump: lambda random: (round(_signed(random, 1.0, 10 ** random.uniform(0.0, 6.0))),),
    faults.EncoderScaling: lambda random: (round(_signed(random, 0.1, 10.0), 2),),
    faults.TorqueSaturated: lambda random: (round(random.uniform(0.0, 0.3), 2),),
    faults.HostPaused: lambda random: (_of_ten(random, -2.0, 0.0, 4),),
    faults.ClockStep: lambda random: (round(_signed(random, 0.0, 10 ** random.uniform(-4.0, 0.0)), 5),),
    faults.SlowCompute: lambda random: (_of_ten(random, -4.0, -2.0), _count(random)),
    faults.HandHit: lambda random: (round(_signed(random, 10.0, 200.0)), round(random.uniform(0.002, 0.05), 4)),
    faults.AnswerDelayed: lambda random: (_of_ten(random, -4.0, -0.7), _count(random)),
    faults.AnswerTruncated: lambda random: (random.randrange(20), _count(random)),
    faults.AnswerWrongUnit: lambda random: (random.randint(1, 247), _count(random)),
    faults.AnswerException: lambda random: (random.choice((1, 2, 3, 4, 6, 11)), _count(random)),
    faults.ForeignSetPoints: lambda random: (
        round(_signed(random, 0.0, 1.0), 2), _of_ten(random, -3.0, -0.3, 4), random.choice((None, _count(random))),
    ),
}  # fmt: skip


def _by_kind(union: UnionType) -> Mapping[str, Draw]:
    """Return the functions that draw a fault, by the names of the kinds in a union."""

    def draw(kind: type[faults.TimedFault], name: str) -> Draw:
        usual = [draws for key, draws in _KEYS.items() if key in kind.__dataclass_fields__]
        recipe: Recipe = _OWN.get(kind, lambda random: tuple(draws(random) for draws in usual))
        return lambda random, at: kind(name, at, *recipe(random))

    return {name: draw(kind, name) for kind in get_args(union) for name in faults.kinds_of(kind)}


RECIPES = _by_kind(faults.LineFault | faults.DriveFaultKind | faults.HostFault | faults.HandFault)
"""Kinds that happen at an instant, on CAN."""
ANSWER_RECIPES = _by_kind(faults.AnswerFault)
"""Kinds that happen at an instant, on Modbus alone."""


def drawn(seed: int, duration: float, kinds: Sequence[str] = tuple(RECIPES)) -> tuple[faults.Fault, ...]:
    """Return the faults of a seed: one to `MOST` of these kinds, at times within a run of `duration` [s], in order."""
    recipes = {**RECIPES, **ANSWER_RECIPES}
    random = Random(f"faults/{seed}")
    (count,) = random.choices(range(1, MOST + 1), _WEIGHTS)
    times = sorted(_time(random, duration) for _ in range(count))
    return tuple(recipes[random.choice(kinds)](random, at) for at in times)


def _time(random: Random, duration: float) -> float:
    """Return a random time of a run; the very end has a higher share, because the order of events changes there."""
    first = max(0.0, duration - _END) if random.random() < _AT_THE_END else 0.0
    return round(random.uniform(first, duration), 4)


def seed_of(text: str) -> int | None:
    """Return the seed of `random@SEED`; None for a text that names a file. Raises UsageError for an invalid seed."""
    if not text.startswith(RANDOM):
        return None
    digits = text.removeprefix(RANDOM)
    if not digits.isdecimal() or int(digits) > _LARGEST_SEED:
        raise UsageError(f'faults "{text}": expected a whole number from 0 to {_LARGEST_SEED} behind {RANDOM}')
    return int(digits)
