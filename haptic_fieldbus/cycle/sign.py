"""Proof of the motor direction, the sign from torque to motion, at the start of a run: pulses and pairs of pulses.

Theory and sizes stand in `planning.sign_probe`. The proof goes through the stages of the probe. If all pulses and pairs
of a stage agree, the stage decides: the direction is confirmed, or it is wrong and the run ends. As soon as a pair
disagrees, or its motion is too small, the next stage begins.

Torque grows from stage to stage while nothing moves; once something has moved, it stays the same in this attempt. After
the last stage the scene goes on within `holding` for a second, and the last stage is tried again. Three attempts in a
row without any motion end the run as a refusal; a handle that a hand moves between the pulses is not blocked. Missing
feedback spoils its pair: the handle comes to rest, and only this pair is repeated. The proof therefore ends even if
gaps come more than once in a stage. In a scene of several axes force rises when the direction of all axes is confirmed,
and a doubt about one axis limits all.
"""

import math
from operator import mul
from typing import Protocol

from haptic_fieldbus.cycle.laws import AxisState
from haptic_fieldbus.cycle.safety import Permission, TripKind, TripOff
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.sign_probe import (
    ATTEMPTS,
    PARTS,
    PAUSE,
    PULSES_OF_A_PAIR,
    PulseStage,
    SignProbe,
    longer,
    probe_of,
    sign_probe,
)


def thue_morse(number: int) -> float:
    """Return the sign of a pulse, counted from 0: + − − + − + + − …"""
    return -1.0 if number.bit_count() % 2 else 1.0


class SignOwner(Protocol):
    """The part of a cycle that is told of motor directions."""

    def sign_seen(self) -> None: ...

    def sign_doubted(self) -> None: ...


class Sign:
    """Motor direction of one axis: known, being tested, confirmed, or in doubt and tested again.

    `owner` is told of each proof, and of a new proof that begins while the scene runs; `trip` is called when the
    direction is wrong.
    """

    def __init__(
        self, axis: AxisPlan, period: float, state: AxisState, permission: Permission, trip: TripOff, owner: SignOwner
    ) -> None:
        self.doubts = 0
        """Number of doubts: the motion went against the torque."""
        self._axis, self._period, self._state, self._permission = axis, period, state, permission
        self._trip, self._owner = trip, owner
        probe = sign_probe(axis, period)
        self.proof = None if probe is None else self._prove(probe)
        """None if the motor direction is known."""

    def _prove(self, probe: SignProbe, *, again: bool = False) -> "SignProof":
        proof = SignProof(self._axis, probe, self._state, self._trip, self._owner, again=again)
        self._permission.proof = proof.give
        return proof

    @property
    def unseen(self) -> int | None:
        """Number of failed attempts; None once the direction is confirmed, or if it is known."""
        return None if self.proof is None or self.proof.seen else self.proof.failures

    @property
    def broken_off(self) -> int:
        """Number of pairs that missing feedback spoiled in the present proof."""
        return 0 if self.proof is None else self.proof.broken_off

    def begin(self, t_ns: int) -> None:
        """Note when force begins to rise, in the first rendered period, unless `hold` follows."""
        self._state.permitted_ns = t_ns

    def hold(self) -> None:
        """Permit no more than the holding force: the direction of this axis or another one is not confirmed."""
        self._state.permitted_ns = None
        if self._permission.proof is None:
            holding = self._axis.limits.before_sign
            self._permission.proof = lambda force: max(-holding, min(holding, force))
        self._permission.loosen()

    def permit(self, t_ns: int, *, deep: bool) -> None:
        """Let the force rise from the holding force to its limit: the direction of all axes is confirmed.

        After a doubt the handle may be deep in contact, because the force was small: the cap stays until contact is
        left. So it does after the first proof if the handle is `deep` in contact: a hand may have pushed it there.
        """
        if self._state.permitted_ns is None:
            limits, permission = self._axis.limits, self._permission
            permission.proof, self._state.permitted_ns = None, t_ns
            if deep or permission.fade > 0.0:  # force was permitted before, so this ends a doubt
                permission.cap_after_doubt(limits.before_sign)
            permission.fade = min(1.0, limits.before_sign / limits.effort)

    def doubt(self) -> None:
        """Test the direction again, with all axes at the holding force: motion went against the torque."""
        self.doubts += 1
        self.proof = self._prove(probe_of(self._axis, self._period), again=True)
        self.proof.begin()
        self._owner.sign_doubted()


class SignProof:
    """The proof of one axis: `give` takes the force of the scene, and returns the force of the period.

    `again`: a doubt while a scene runs. The direction was confirmed before, so a hand must be holding a handle that
    does not move.
    """

    def __init__(
        self,
        axis: AxisPlan,
        probe: SignProbe,
        state: AxisState,
        trip: TripOff,
        owner: SignOwner,
        *,
        again: bool = False,
    ) -> None:
        self.failures = 0
        """Number of attempts in which all stages failed."""
        self.broken_off = 0
        """Number of restarts of a pair after missing feedback."""
        self.seen = False
        self._axis, self._probe, self._state, self._trip, self._owner = axis, probe, state, trip, owner
        # The effect of a torque is visible this number of samples later.
        self._late = round((axis.delay.transport + axis.delay.torque_loop) / probe.period)
        self._pause = self._quiet = 0
        """Remaining periods of the pause between two attempts, and of the pause without force before a stage."""
        self._stages, self._number = probe.stages, 0
        self._again, self._still, self._moved = again, 0, False
        """`_still`: attempts in a row without motion; `_moved`: whether pulses moved the handle in this attempt."""
        self._from: float | None = None
        self._far = 0.0
        """Position at the begin of the present attempt, and largest distance of the handle from it since then."""
        self._positions: list[float] = []
        """Positions since the handle last came to rest."""
        self._kept = 0
        """Number of pulses of the stage before these positions."""
        self._shown: list[float] = []
        """Second difference of each pulse of the stage, positive in the direction of its torque."""
        self._clock, self._times = 0, list[int]()
        """Number of periods so far, and the periods in which the pulses were evaluated."""

    def give(self, force: float) -> float:
        """Return the force of the period: a pulse, or the force of the scene limited to the holding force."""
        if self._pause and not self.seen:
            self._pause -= 1
        if self._pause or self.seen:
            holding = self._probe.holding
            return max(-holding, min(holding, force))
        self._clock += self._state.steps
        if self._state.steps != 1:
            self.broken_off += 1
            self._rest()
        if self._quiet:
            self._quiet -= 1
            return 0.0
        self._follow(self._state.position)
        self._look(self._stage)
        return self._torque(self._stage)

    @property
    def _stage(self) -> PulseStage:
        return self._stages[self._number]

    @property
    def _pulses(self) -> int:
        return PULSES_OF_A_PAIR * self._stage.pairs

    def begin(self) -> None:
        """Begin the stage, after a pause in which the handle comes to rest."""
        self._shown, self._times = [], []
        self._rest()

    def _follow(self, position: float) -> None:
        """Note the position of the handle during the pulses."""
        self._positions.append(position)
        if self._from is None:
            self._from = position
        self._far = max(self._far, abs(position - self._from))

    def _rest(self) -> None:
        """Let the handle come to rest, and go on after the last whole pair."""
        self._kept = len(self._shown) // PULSES_OF_A_PAIR * PULSES_OF_A_PAIR
        del self._shown[self._kept :], self._times[self._kept :]
        self._positions = []
        self._quiet = PARTS * self._stage.periods

    def _torque(self, stage: PulseStage) -> float:
        """Return the torque of this period: 0, then the torque of the pulse, then the opposite torque."""
        since, rest = divmod(len(self._positions) - 1, PARTS * stage.periods)
        pulse = self._kept + since
        if self._pause or self.seen or not self._positions or pulse >= self._pulses:
            return 0.0
        return (0.0, 1.0, -1.0)[rest // stage.periods] * thue_morse(pulse) * stage.effort

    def _look(self, stage: PulseStage) -> None:
        """Evaluate the motion after the second part of each pulse, and judge the pair."""
        pulse, length = len(self._shown), stage.periods
        here, begun = len(self._positions) - 1, PARTS * length * (pulse - self._kept)
        if pulse == self._pulses:
            if here >= begun:  # the last pulse has stopped the handle again
                self.seen = True
                self._owner.sign_seen()
            return
        if here < begun + 2 * length + self._late:
            return
        positions = self._positions
        bend = positions[here] - 2.0 * positions[here - length] + positions[here - 2 * length]
        self._shown.append(thue_morse(pulse) * bend)
        self._times.append(self._clock)
        if pulse % PULSES_OF_A_PAIR:
            self._judge(stage)

    def _judge(self, stage: PulseStage) -> None:
        first, pair = self._shown[0], self._shown[-1] + self._shown[-2]
        if abs(pair) < self._probe.least(stage) * (1.0 - 1e-9) or first * pair <= 0.0:
            self._next()
        elif len(self._shown) < self._pulses:
            return
        elif not self._agree(math.copysign(1.0, first)):
            self._next()
        elif first < 0.0:
            self._trip(TripKind.SIGN, 0.5 * pair, stage.effort)

    def _agree(self, side: float) -> bool:
        """Return whether all pulses go to this side, after a straight line is subtracted from their motions."""
        went = [thue_morse(pulse) * shown for pulse, shown in enumerate(self._shown)]
        middle, mean = (sum(values) / len(went) for values in (self._times, went))
        ago = [time - middle for time in self._times]
        slope = sum(map(mul, ago, went)) / sum(map(mul, ago, ago))
        rest = [each - mean - slope * time for each, time in zip(went, ago, strict=True)]
        return all(side * thue_morse(pulse) * each > 0.0 for pulse, each in enumerate(rest))

    def _next(self) -> None:
        """Go on with the next stage; after the last stage pause, or end a run in which nothing ever moved.

        If some pairs of the stage counted, but not all, the stage has moved the handle: the torque then stays the same.
        """
        if len(self._shown) > PULSES_OF_A_PAIR and not self._moved:
            self._moved = True
            self._stages = (*self._stages[: self._number + 1], *longer(self._stage, self._probe.period))
        if self._number + 1 < len(self._stages):
            self._number += 1
        else:
            self._fail()
        self.begin()

    def _fail(self) -> None:
        """End a failed attempt: pause, then try the last stage again, and larger torques if nothing moves."""
        self.failures += 1
        last, self._number = self._stage, 0
        self._still = 0 if self._moved or self._far >= self._probe.least(last) else self._still + 1
        self._pause = math.ceil(PAUSE / self._probe.period)
        self._moved, self._from, self._far = False, None, 0.0
        self._stages = (last, *(stage for stage in self._probe.stages if stage.effort > last.effort))
        if self._still >= ATTEMPTS and not self._again:
            self._trip(TripKind.SIGN_HIDDEN, float(self._still), self._probe.largest)
