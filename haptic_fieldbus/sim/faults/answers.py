"""Faults of requests and answers on Modbus: an answer that does not come as it was sent, or another master.

Those of answers concern the next `count` answers of a drive on a line; the drive has carried out the requests.
"""

from dataclasses import dataclass
from typing import Annotated, Literal

from annotated_types import Ge, Le

from haptic_fieldbus.drive.fields import NonNegativeTime, Time
from haptic_fieldbus.sim.faults.concern import Concern, Count


@dataclass(frozen=True)
class AnswerLost(Concern):
    """No answer comes."""

    kind: Literal["answer_lost"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerDelayed(Concern):
    """Answers come later by `delay` [s]."""

    kind: Literal["answer_delayed"]
    at: NonNegativeTime
    delay: Time
    count: Count = 1


@dataclass(frozen=True)
class AnswerSwapped(Concern):
    """Each answer comes when the next request was sent: the master gets the answer to an earlier one."""

    kind: Literal["answer_swapped"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerGarbage(Concern):
    """Random octets come in the place of answers."""

    kind: Literal["answer_garbage"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerCorrupted(Concern):
    """One bit of each answer is another: on RTU the checksum shows it; on TCP it is in the header."""

    kind: Literal["answer_corrupted"]
    at: NonNegativeTime
    count: Count = 1


@dataclass(frozen=True)
class AnswerTruncated(Concern):
    """Answers end after `length` octets."""

    kind: Literal["answer_truncated"]
    at: NonNegativeTime
    length: Annotated[int, Ge(0), Le(260)] = 4
    count: Count = 1


@dataclass(frozen=True)
class AnswerWrongUnit(Concern):
    """Answers come under the unit id `to`."""

    kind: Literal["answer_wrong_unit"]
    at: NonNegativeTime
    to: Annotated[int, Ge(1), Le(247)]
    count: Count = 1


@dataclass(frozen=True)
class AnswerException(Concern):
    """The drive answers with an exception, and carries nothing out."""

    kind: Literal["answer_exception"]
    at: NonNegativeTime
    code: Annotated[int, Ge(1), Le(255)] = 4
    count: Count = 1


@dataclass(frozen=True)
class ConnectionReset(Concern):
    """The connection is reset, or the serial adapter unplugged; for `duration` [s] there is none."""

    kind: Literal["connection_reset"]
    at: NonNegativeTime
    duration: Time | None = None


@dataclass(frozen=True)
class ForeignSetPoints(Concern):
    """Set-points of another master, which nobody on the line hears: a target torque of `share` of rated torque, `count`
    times, once every `interval` [s]. Each acts until the next one of either master."""

    kind: Literal["foreign_set_points"]
    at: NonNegativeTime
    share: Annotated[float, Ge(-1), Le(1)] = 0.8
    interval: Time = 0.05
    count: Count | None = None


AnswerDisturbance = (
    AnswerLost
    | AnswerDelayed
    | AnswerSwapped
    | AnswerGarbage
    | AnswerCorrupted
    | AnswerTruncated
    | AnswerWrongUnit
    | AnswerException
)
"""Kinds that concern the next answers of a drive."""
LineDisturbance = AnswerDisturbance | ConnectionReset
"""Kinds that disturb a line or what comes on it."""
AnswerFault = LineDisturbance | ForeignSetPoints
"""Kinds of a Modbus line, its masters and its drives' answers."""
