"""Frames beside the exchange: the signs of life of master and drive, and questions by SDO; their times and bits.

Master and drive watch each other, in one of two ways:

- Heartbeats (CiA 301 7.2.8.3.2.2): each sends its own. The drive watches ours by 1016h.
- Life guarding (CiA 301 7.2.8.3.2.1), for a drive that has no 1016h: the master requests by a remote frame, the drive
  answers with its NMT state. The drive misses us when no request came for its life time, 100Ch × 100Dh; we miss the
  drive when it has answered none for that time.
"""

import math

from haptic_fieldbus.drive.cia402 import OptionCode
from haptic_fieldbus.drive.profile import DataType, ObjectEntry
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.numerals import exactly
from haptic_fieldbus.protocols.canopen.pdo import worst_case_bits
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection, SyncSection
from haptic_fieldbus.signals import Signal

# The period of the loop as a drive is told it: interpolation time period, communication cycle period.
#
# A drive that counts in whole milliseconds cannot be told of 0.5 ms, and would interpolate, warn or trip. Such a period
# is refused when the loop is planned.
#
# Reference: CiA 402-2, 60C2h; CiA 301 4.2, 7.5.2.6 (1006h).

_NS_PER_US = 1_000
Writes = tuple[tuple[ObjectEntry, int], ...]
"""Objects, each with the value that is written to it."""


def period_objects(profile: CanopenProfile, rate: float) -> Writes:
    """Return the objects that tell the drive the period of a loop at `rate` [Hz], each with its value.

    They are empty for a drive that is not told. Raises PlanError for a period that the drive cannot take.
    """
    sync, period_ns = profile.sync, round(1e9 / rate)
    if period_ns < round(sync.shortest_period * 1e9):
        raise _refusal(profile, period_ns, f"its shortest period is {exactly(1e3 * sync.shortest_period)} ms")
    written: list[tuple[ObjectEntry, int]] = []
    if sync.interpolation_time is not None:
        value, power = _interpolation(profile, sync, period_ns)
        written.append((ObjectEntry(sync.interpolation_time, DataType.INT8, 2), power))
        written.append((ObjectEntry(sync.interpolation_time, DataType.UINT8, 1), value))
    if sync.cycle_period is not None:
        if period_ns % _NS_PER_US:
            raise _refusal(profile, period_ns, f"{sync.cycle_period:04X}h accepts whole microseconds only")
        written.append((ObjectEntry(sync.cycle_period, DataType.UINT32), period_ns // _NS_PER_US))
    return tuple(written)


def _interpolation(profile: CanopenProfile, sync: SyncSection, period_ns: int) -> tuple[int, int]:
    """Return value and power of ten of the interpolation time period."""
    low, high = sync.values
    for power in sync.powers:
        value, rest = divmod(period_ns, 10 ** (9 + power))
        if not rest and low <= value <= high:
            return value, power
    steps = " or ".join(f"{exactly(10.0 ** (3 + power))} ms" for power in sync.powers)
    raise _refusal(profile, period_ns, f"{sync.interpolation_time:04X}h accepts {low} to {high} times {steps}")


def _refusal(profile: CanopenProfile, period_ns: int, why: str) -> PlanError:
    period = f"{exactly(period_ns * 1e-6)} ms"
    return PlanError(f"{profile.title} does not support a period of {period}: {why}. Use another --rate")


PROOFS_PER_GUARD = 5
"""Proofs of our life within the guard of a drive. It is the life time factor (100Dh) too, so that the guard time
(100Ch) is the time between two requests."""
PERIODS_PER_GUARD = 5
NODE_HEARTBEAT_MS = 100
"""Producer heartbeat time that the master writes to each drive."""
LOST_HEARTBEATS = 3
"""Heartbeat periods of silence after which a node shows no sign of life."""
ASK_EVERY = 0.005
"""Shortest time between two questions for an echo that is asked by SDO [s]: a question and its answer are two frames
of eight octets, which is more than a period needs."""

QUESTION_BITS = 2 * worst_case_bits(8)
"""Bits of a question by SDO and of its answer."""
GUARDING_BITS = worst_case_bits(0) + worst_case_bits(1)
"""Bits of a remote frame, which carries no data, and of its answer of one octet."""

GUARD_TIME = ObjectEntry(0x100C, DataType.UINT16)
LIFE_TIME_FACTOR = ObjectEntry(0x100D, DataType.UINT8)
PRODUCER_HEARTBEAT = ObjectEntry(0x1017, DataType.UINT16)
MODE = ObjectEntry(0x6060, DataType.INT8)
SHAFT_BRAKES = 3
"""Abort connection option code (6007h) for quick stop."""
QUICK_STOP = OptionCode(0x605A, 2)
"""Quick stop option code: slow down on the quick stop ramp, then *switch on disabled*. By codes 5 to 8 a drive would
stay in *quick stop active*, and hold its shaft with torque for as long as it has power."""


def guard_objects(section: LinkLossSection, milliseconds: int, master_node: int, node_heartbeat_ms: int) -> Writes:
    """Return the objects by which master and drive watch each other, with their values; `milliseconds` is the guard."""
    if section.life_guarding:
        guard = (GUARD_TIME, milliseconds // PROOFS_PER_GUARD)
        return (PRODUCER_HEARTBEAT, 0), guard, (LIFE_TIME_FACTOR, PROOFS_PER_GUARD)
    index, ours = section.heartbeat_consumer, ((PRODUCER_HEARTBEAT, node_heartbeat_ms),)
    return ours if index is None else (*ours, (consumer_heartbeat(index), master_node << 16 | milliseconds))


def consumer_heartbeat(index: int) -> ObjectEntry:
    """Return the entry of a heartbeat consumer (1016h) that watches the master."""
    return ObjectEntry(index, DataType.UINT32, 1)


def reactions(section: LinkLossSection, *, brakes: bool) -> tuple[tuple[OptionCode, int], ...]:
    """Return the options for a lost master that a drive has, each with the value that it is to hold."""
    abort, fault = section.abort_connection_option, section.fault_reaction_option
    held: tuple[tuple[OptionCode, int], ...] = ()
    if abort is not None:
        held = ((abort, SHAFT_BRAKES), (QUICK_STOP, QUICK_STOP.value)) if brakes else ((abort, abort.value),)
    return held if fault is None else (*held, (fault, fault.value))


def guard_time(section: LinkLossSection, rate: float) -> float:
    """Return the time after which the drive detects the loss of its master [s], at least five periods."""
    milliseconds = math.ceil(max(section.deadline, PERIODS_PER_GUARD / rate) * 1e3 - 1e-9)
    if section.life_guarding:
        milliseconds = PROOFS_PER_GUARD * math.ceil(milliseconds / PROOFS_PER_GUARD)
    return milliseconds * 1e-3


def silence(section: LinkLossSection, rate: float, node_heartbeat_ms: int) -> float:
    """Return the time without a sign of life of a drive after which it counts as gone [s].

    A slow loop hears a heartbeat as late as a period after it came.
    """
    if section.life_guarding:
        return guard_time(section, rate)
    return max(LOST_HEARTBEATS * node_heartbeat_ms * 1e-3, node_heartbeat_ms * 1e-3 + 2.0 / rate)


def bits_a_second(profile: CanopenProfile, rate: float, proofs: float, node_heartbeat_ms: int) -> float:
    """Return the bits a second of one drive beside the exchange; `proofs` are signs of life of the master a second."""
    questions = QUESTION_BITS * min(rate, 1.0 / ASK_EVERY) if profile.echo is Signal.TARGET_ASKED else 0.0
    guards = profile.link_loss.life_guarding
    return questions + (GUARDING_BITS * proofs if guards else worst_case_bits(1) * 1000 / node_heartbeat_ms)


def bits_at_once(profile: CanopenProfile) -> int:
    """Return the bits of all frames of one drive beside the exchange that can come in one period."""
    questions = QUESTION_BITS if profile.echo is Signal.TARGET_ASKED else 0
    return questions + (GUARDING_BITS if profile.link_loss.life_guarding else worst_case_bits(1))
