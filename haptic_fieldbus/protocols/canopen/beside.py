"""Frames beside the exchange: the signs of life of master and drive, and questions by SDO; their times and bits.

Master and drive watch each other, in one of two ways:

- Heartbeats (CiA 301 7.2.8.3.2.2): each sends its own. The drive watches ours by 1016h.
- Life guarding (CiA 301 7.2.8.3.2.1), for a drive that has no 1016h: the master requests by a remote frame, the drive
  answers with its NMT state. The drive misses us when no request came for its life time, 100Ch × 100Dh; we miss the
  drive when it has answered none for that time.
"""

import math

from haptic_fieldbus.protocols.canopen.pdo import worst_case_bits
from haptic_fieldbus.protocols.canopen.profile import CanopenProfile, LinkLossSection
from haptic_fieldbus.signals import Signal

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


def guard_time(section: LinkLossSection, rate: float) -> float:
    """Return the time after which the drive misses its master [s]: that of its profile, but five periods at least."""
    milliseconds = math.ceil(max(section.deadline, PERIODS_PER_GUARD / rate) * 1e3 - 1e-9)
    if section.life_guarding:
        milliseconds = PROOFS_PER_GUARD * math.ceil(milliseconds / PROOFS_PER_GUARD)
    return milliseconds * 1e-3


def silence(section: LinkLossSection, rate: float, node_heartbeat_ms: int) -> float:
    """Return the time without a sign of life of a drive after which it counts as gone [s]."""
    return guard_time(section, rate) if section.life_guarding else LOST_HEARTBEATS * node_heartbeat_ms * 1e-3


def bits_a_second(profile: CanopenProfile, rate: float, proofs: float, node_heartbeat_ms: int) -> float:
    """Return the bits a second of one drive beside the exchange; `proofs` are the proofs of our life a second."""
    questions = 2 * worst_case_bits(8) * min(rate, 1.0 / ASK_EVERY) if is_asked(profile) else 0.0
    if profile.link_loss.life_guarding:
        return questions + _guarding_bits() * proofs
    return questions + worst_case_bits(1) * 1000 / node_heartbeat_ms


def bits_at_once(profile: CanopenProfile) -> int:
    """Return the bits of all frames of one drive beside the exchange that can come in one period."""
    questions = 2 * worst_case_bits(8) if is_asked(profile) else 0
    return questions + (_guarding_bits() if profile.link_loss.life_guarding else worst_case_bits(1))


def is_asked(profile: CanopenProfile) -> bool:
    """Return True when the echo of the set-points is asked by SDO."""
    return profile.echo is Signal.TARGET_ASKED


def _guarding_bits() -> int:
    """Return the bits of a remote frame, which carries no data, and of its answer of one octet."""
    return worst_case_bits(0) + worst_case_bits(1)
