"""Events of one run on one simulated bus: the frames on the wire, and the truth at the motors.

A witness only writes down; it is judged when the run is over. Its times are those of the simulated world [ns].
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from tests.invariants.stated import Stated
from tests.invariants.words import State

MASTER, STRANGER = 0, -1
"""Senders that are no drive."""


@dataclass
class Shaft:
    """The truth of one drive: transitions of its automaton, and torque targets of its motor."""

    node: int
    state: State
    """At the beginning."""
    permille: float
    """1 ‰ of rated torque [N·m]."""
    unit: float
    """One step of target torque [N·m]."""
    faults: tuple[Any, ...] | None
    """Planned for it; None when they are not known."""
    transitions: list[tuple[int, int]] = field(default_factory=list)
    """(time, number) of each; negative numbers are restarts of the node."""
    targets: list[tuple[int, float]] = field(default_factory=list)
    """(time, torque [N·m])."""
    angles: dict[int, float] = field(default_factory=dict)
    """Angle of the shaft at the time of each target, and at the end [rad]."""
    now: State = State.NOT_READY
    """At the end."""


@dataclass(frozen=True)
class Part:
    """One configuration of the drives, and what was done with it until the next one."""

    begun_ns: int
    ended_ns: int
    proves: bool
    """Whether the guards of the drives were to be proved."""
    released_ns: int | None


@dataclass
class Witness:
    """One run on one bus: the proofs of its guards, each a part of its own, and then the run itself."""

    stated: Stated
    clock: Any
    shafts: dict[int, Shaft]
    begun_ns: int
    frames: list[tuple[int, int, bytes, int]] = field(default_factory=list)
    """(end of frame, identifier, octets, sender): the node-ID of a drive, MASTER or STRANGER."""
    released_ns: int | None = None
    """When the master was told to let go."""
    closed_ns: int | None = None
    """When the master had left."""
    whole: bool = True
    """False when the beginning of a long run was judged and forgotten."""
    seen_ns: int = 0
    """Up to where the truth is known."""
    earlier: list[Part] = field(default_factory=list)
    """Parts before the last one, which all else tells of."""
    proves: bool = False
    """Whether the last part is a proof of guards."""
    may_prove: bool = False
    """Whether proofs were asked for, or the bus is a real one."""
    must_prove: bool = False
    """Whether a guard of which nothing is known must be proved before the run."""
    happened: Sequence[Any] = ()
    """Faults that have happened in an earlier part, and happen once."""

    @property
    def faults(self) -> Sequence[Any]:
        """Each fault once, though every drive of a bus was given it."""
        found: list[Any] = []
        for shaft in self.shafts.values():
            known = [*self.happened, *found]
            found += [fault for fault in shaft.faults or () if not any(fault is each for each in known)]
        return found

    @property
    def is_plain(self) -> bool:
        """Whether it is known that there is no fault, and nobody but the master is on the wire."""
        known = all(shaft.faults == () for shaft in self.shafts.values())
        return known and not any(sender == STRANGER for _, _, _, sender in self.frames)

    @property
    def enabled_ns(self) -> int | None:
        """The first *operation enabled* of any drive in the last part; None when there was none."""
        return self._enabled_ns(self.shafts.values())

    def _enabled_ns(self, shafts: Iterable[Shaft]) -> int | None:
        since_ns = self.earlier[-1].ended_ns if self.earlier else self.begun_ns
        times = [t_ns for shaft in shafts for t_ns, number in shaft.transitions if number == 4 and t_ns >= since_ns]
        return min(times, default=None)

    def counts_from_ns(self, fault: Any) -> int | None:
        """The instant from which the time of a fault counts; drives of one line are enabled one after another."""
        own = self.shafts.get(getattr(fault, "node", None) or 0)
        return self.enabled_ns if own is None else self._enabled_ns([own])

    @property
    def faults_ns(self) -> int | None:
        """The instant from which the times of faults count; None while there was none."""
        return self.enabled_ns
