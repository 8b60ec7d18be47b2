"""Faults drawn from a seed: `random@7` always gives the same kinds at the same times.

Each kind has a recipe, which draws its values from ranges in which the fault has an effect. The values are rounded, so
that the text of a drawn fault is short and reads back as the same fault.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from random import Random

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

Recipe = Callable[[Random, float], "faults.Fault"]
"""Function that draws one fault for a time [s]."""


def _frames(random: Random) -> "faults.FrameGroup":
    return random.choice(("tpdo", "tpdo", "rpdo", "rpdo", "sync", "heartbeat", "emergency", "sdo", "nmt"))


def _duration(random: Random) -> float | None:
    return random.choice((None, *(round(10 ** random.uniform(-3.0, -0.5), 4) for _ in range(3))))


def _flicker(random: Random) -> float | None:
    """Return the time for which a contact is open [s]: a short bounce, or None for good."""
    return random.choice((None, round(10 ** random.uniform(-4.0, -0.5), 4)))


def _count(random: Random, most: int = 60) -> int:
    return round(math.exp(random.uniform(0.0, math.log(most))))


def _foreign(random: Random, at: float) -> "faults.Fault":
    # What a master, a drive or a bystander may say, and anything at all.
    can_id = random.choice((0x000, 0x080, 0x081, 0x100, 0x181, 0x201, 0x581, 0x601, 0x701, 0x77F, 0x7E5, None))
    length = random.choice((_LENGTHS.get(can_id or 0, 8), random.randrange(9)))
    data = [random.choice((*_TELLING, random.randrange(256))) for _ in range(length)]
    count = _count(random, 30)
    known = random.randrange(0x800) if can_id is None else can_id
    return faults.ForeignFrame("foreign_frame", at, known, tuple(data), count, random.choice((0.0005, 0.001, 0.01)))


def _signed(random: Random, least: float, most: float) -> float:
    return random.choice((-1.0, 1.0)) * random.uniform(least, most)


RECIPES: Mapping[str, Recipe] = {
    "frame_dropped": lambda random, at: faults.FrameDropped("frame_dropped", at, _frames(random), _count(random)),
    "frame_delayed": lambda random, at: faults.FrameDelayed(
        "frame_delayed", at, round(10 ** random.uniform(-4.0, -1.3), 5), _frames(random), _count(random)
    ),
    "frame_duplicated": lambda random, at: faults.FrameDuplicated(
        "frame_duplicated", at, _frames(random), _count(random)
    ),
    "frame_wrong_length": lambda random, at: faults.FrameWrongLength(
        "frame_wrong_length", at, random.randrange(9), _frames(random), _count(random)
    ),
    "frame_wrong_node": lambda random, at: faults.FrameWrongNode(
        "frame_wrong_node", at, random.randint(1, 127), _frames(random), _count(random)
    ),
    "foreign_frame": _foreign,
    "bus_off": lambda random, at: faults.BusOff("bus_off", at, _duration(random)),
    "interface_down": lambda random, at: faults.InterfaceDown("interface_down", at, _duration(random)),
    "error_frame": lambda random, at: faults.ErrorFrame("error_frame", at),
    "emergency": lambda random, at: faults.Emergency("emergency", at, random.choice((0x1000, 0x3210, 0x4310, 0x8611))),
    "drive_fault": lambda random, at: faults.DriveFault("drive_fault", at, random.choice((0x2310, 0x4310, 0x7305))),
    "safe_torque_off": lambda random, at: faults.SafeTorqueOff("safe_torque_off", at, _flicker(random)),
    "node_reset": lambda random, at: faults.NodeReset("node_reset", at, round(random.uniform(0.001, 0.2), 4)),
    "silence": lambda random, at: faults.Silence("silence", at, _duration(random)),
    "missing_tpdos": lambda random, at: faults.MissingTpdos("missing_tpdos", at, _count(random)),
    "missing_rpdos": lambda random, at: faults.MissingRpdos("missing_rpdos", at, random.choice((None, _count(random)))),
    "sync_ignored": lambda random, at: faults.SyncIgnored("sync_ignored", at, random.choice((None, _count(random)))),
    "heartbeat_lost": lambda random, at: faults.HeartbeatLost("heartbeat_lost", at),
    "duplicate_node": lambda random, at: faults.DuplicateNode("duplicate_node", at),
    "encoder_jump": lambda random, at: faults.EncoderJump(
        "encoder_jump", at, round(_signed(random, 1.0, 10 ** random.uniform(0.0, 6.0)))
    ),
    "position_stuck": lambda random, at: faults.PositionStuck("position_stuck", at, _duration(random)),
    "encoder_scaling": lambda random, at: faults.EncoderScaling(
        "encoder_scaling", at, round(_signed(random, 0.1, 10.0), 2)
    ),
    "encoder_reversed": lambda random, at: faults.EncoderReversed("encoder_reversed", at),
    "torque_dead": lambda random, at: faults.TorqueDead("torque_dead", at),
    "torque_saturated": lambda random, at: faults.TorqueSaturated(
        "torque_saturated", at, round(random.uniform(0.0, 0.3), 2)
    ),
    "torque_reversed": lambda random, at: faults.TorqueReversed("torque_reversed", at),
    "host_late": lambda random, at: faults.HostLate(
        "host_late", at, round(10 ** random.uniform(-4.0, -1.3), 5), _count(random)
    ),
    "host_paused": lambda random, at: faults.HostPaused("host_paused", at, round(10 ** random.uniform(-2.0, 0.0), 4)),
    "clock_step": lambda random, at: faults.ClockStep(
        "clock_step", at, round(_signed(random, 0.0, 10 ** random.uniform(-4.0, 0.0)), 5)
    ),
    "slow_compute": lambda random, at: faults.SlowCompute(
        "slow_compute", at, round(10 ** random.uniform(-4.0, -2.0), 5), _count(random)
    ),
    "hand_release": lambda random, at: faults.HandRelease("hand_release", at),
    "hand_hit": lambda random, at: faults.HandHit(
        "hand_hit", at, round(_signed(random, 10.0, 200.0)), round(random.uniform(0.002, 0.05), 4)
    ),
}
"""Kinds that happen at an instant, on CAN."""

ANSWER_RECIPES: Mapping[str, Recipe] = {
    "answer_lost": lambda random, at: faults.AnswerLost("answer_lost", at, _count(random)),
    "answer_delayed": lambda random, at: faults.AnswerDelayed(
        "answer_delayed", at, round(10 ** random.uniform(-4.0, -0.7), 5), _count(random)
    ),
    "answer_swapped": lambda random, at: faults.AnswerSwapped("answer_swapped", at, _count(random)),
    "answer_garbage": lambda random, at: faults.AnswerGarbage("answer_garbage", at, _count(random)),
    "answer_corrupted": lambda random, at: faults.AnswerCorrupted("answer_corrupted", at, _count(random)),
    "answer_truncated": lambda random, at: faults.AnswerTruncated(
        "answer_truncated", at, random.randrange(20), _count(random)
    ),
    "answer_wrong_unit": lambda random, at: faults.AnswerWrongUnit(
        "answer_wrong_unit", at, random.randint(1, 247), _count(random)
    ),
    "answer_exception": lambda random, at: faults.AnswerException(
        "answer_exception", at, random.choice((1, 2, 3, 4, 6, 11)), _count(random)
    ),
    "connection_reset": lambda random, at: faults.ConnectionReset("connection_reset", at, _duration(random)),
    "foreign_set_points": lambda random, at: faults.ForeignSetPoints(
        "foreign_set_points",
        at,
        round(_signed(random, 0.0, 1.0), 2),
        round(10 ** random.uniform(-3.0, -0.3), 4),
        random.choice((None, _count(random))),
    ),
}
"""Kinds that happen at an instant, on Modbus alone."""


def drawn(seed: int, duration: float, kinds: Sequence[str] = tuple(RECIPES)) -> tuple["faults.Fault", ...]:
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
