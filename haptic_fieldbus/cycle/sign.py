"""The proof of the sign from torque to motion, at the start of a run: pulses, pairs of pulses, and what they say.

Theory and sizes stand in `planning.sign_probe`. The proof goes through the stages of the probe. A stage decides when
all its pulses and pairs agree; then the sign is seen, or the run ends. As soon as one does not agree, or shows too
little, the next stage begins.

Torque grows from stage to stage while nothing moves, and no more in an attempt in which something moved. After the last
stage the scene goes on within `holding` for a second, and the last stage is tried again. Three attempts in which the
handle stood still end the run as a refusal; one that a hand moves meanwhile is not at a stop. Missing feedback spoils
the pair in which it falls: the handle is left to come to rest, and that pair is repeated, so that gaps which come more
often than a stage is long do not keep a proof from its end. In a scene of several axes force rises when the sign of all
has been seen, and a doubt about one of them limits all.
"""

import math
from collections.abc import Callable
from operator import mul

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


class Sign:
    """The sign of one axis: known, looked for, seen, or in doubt and looked for again.

    `seen` is called after each proof, `doubted` when another one begins while the scene runs, `trip` when the sign is
    wrong.
    """

    def __init__(
        self,
        axis: AxisPlan,
        period: float,
        state: AxisState,
        permission: Permission,
        trip: TripOff,
        seen: Callable[[], None],
        doubted: Callable[[], None],
    ) -> None:
        self.doubts = 0
        """How often the motion went against the torque."""
        self._axis, self._period, self._state, self._permission = axis, period, state, permission
        self._trip, self._seen, self._doubted = trip, seen, doubted
        probe = sign_probe(axis, period)
        self.proof = None if probe is None else self._prove(probe)
        """None where the sign is known."""

    def _prove(self, probe: SignProbe, *, again: bool = False) -> "SignProof":
        proof = SignProof(self._axis, probe, self._state, self._trip, self._seen, again=again)
        self._permission.proof = proof.give
        return proof

    @property
    def unseen(self) -> int | None:
        """How often the sign was looked for in vain; None once it was seen."""
        return None if self.proof is None or self.proof.seen else self.proof.failures

    @property
    def broken_off(self) -> int:
        """How often missing feedback broke off the search for the sign that goes on."""
        return 0 if self.proof is None else self.proof.broken_off

    def begin(self, t_ns: int) -> None:
        """Note when force begins to rise, in the first rendered period, unless `hold` follows."""
        self._state.permitted_ns = t_ns

    def hold(self) -> None:
        """Permit no more than a hand may hold: the sign of this axis or of another one is unseen."""
        self._state.permitted_ns = None
        if self._permission.proof is None:
            holding = self._axis.limits.before_sign
            self._permission.proof = lambda force: max(-holding, min(holding, force))
        self._permission.loosen()

    def permit(self, t_ns: int) -> None:
        """Let the force rise to its limit, from what a hand may hold on: the sign of all axes is seen.

        After a doubt the handle may be deep in contact, where little force has let it go: the cap stays until it is
        out.
        """
        if self._state.permitted_ns is None:
            limits, permission = self._axis.limits, self._permission
            permission.proof, self._state.permitted_ns = None, t_ns
            if permission.fade > 0.0:  # force was permitted before, so that this ends a doubt
                permission.cap_after_doubt(limits.before_sign)
            permission.fade = min(1.0, limits.before_sign / limits.effort)

    def doubt(self) -> None:
        """Look for the sign again, while no axis gives more than a hand may hold: motion went against the torque."""
        self.doubts += 1
        self.proof = self._prove(probe_of(self._axis, self._period), again=True)
        self.proof.begin()
        self._doubted()


class SignProof:
    """The proof of one axis: `give` takes the force of the scene, and returns the force of the period.

    `again`: a doubt while a scene runs. The sign was seen before, so a handle that nothing moves is held by a hand.
    """

    def __init__(
        self,
        axis: AxisPlan,
        probe: SignProbe,
        state: AxisState,
        trip: TripOff,
        seen: Callable[[], None],
        *,
        again: bool = False,
    ) -> None:
        self.failures = 0
        """How often all stages were tried in vain."""
        self.broken_off = 0
        """How often missing feedback made a pair begin anew."""
        self.seen = False
        self._axis, self._probe, self._state, self._trip, self._seen = axis, probe, state, trip, seen
        # What a torque does is seen so many samples later.
        self._late = round((axis.delay.transport + axis.delay.torque_loop) / probe.period)
        self._pause = self._quiet = 0
        """Periods that are left of a pause of the proof, and of one before a stage in which nothing is given."""
        self._stages, self._number = probe.stages, 0
        self._again, self._still, self._moved = again, 0, False
        """Attempts in a row in which nothing moved, and whether pulses moved something in the present one."""
        self._from: float | None = None
        self._far = 0.0
        """Place at the begin of the present attempt, and how far from it the handle was in it."""
        self._positions: list[float] = []
        """Of the periods since the handle was last left to come to rest."""
        self._kept = 0
        """Pulses of the stage before them."""
        self._shown: list[float] = []
        """Second difference of each pulse of the stage, positive in the direction of its torque."""
        self._clock, self._times = 0, list[int]()
        """Periods so far, and those at which the pulses were looked at."""

    def give(self, force: float) -> float:
        """Return the force of the period: a pulse, or that of the scene within what a hand may hold."""
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
        """Begin the stage, after a while in which the handle comes to rest."""
        self._shown, self._times = [], []
        self._rest()

    def _follow(self, position: float) -> None:
        """Note where the handle is while pulses are given."""
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
        """Return the torque of this period: none, that of the pulse, and the same against it."""
        since, rest = divmod(len(self._positions) - 1, PARTS * stage.periods)
        pulse = self._kept + since
        if self._pause or self.seen or not self._positions or pulse >= self._pulses:
            return 0.0
        return (0.0, 1.0, -1.0)[rest // stage.periods] * thue_morse(pulse) * stage.effort

    def _look(self, stage: PulseStage) -> None:
        """After the second part of each pulse: how did the handle move, and what does the pair say?"""
        pulse, length = len(self._shown), stage.periods
        here, begun = len(self._positions) - 1, PARTS * length * (pulse - self._kept)
        if pulse == self._pulses:
            if here >= begun:  # the last pulse has stopped the handle again
                self.seen = True
                self._seen()
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
        """Return whether all pulses go to this side, after a straight line is taken out of how the handle went."""
        went = [thue_morse(pulse) * shown for pulse, shown in enumerate(self._shown)]
        middle, mean = (sum(values) / len(went) for values in (self._times, went))
        ago = [time - middle for time in self._times]
        slope = sum(map(mul, ago, went)) / sum(map(mul, ago, ago))
        rest = [each - mean - slope * time for each, time in zip(went, ago, strict=True)]
        return all(side * thue_morse(pulse) * each > 0.0 for pulse, each in enumerate(rest))

    def _next(self) -> None:
        """Go on with the next stage; after the last one with the scene, or end a run in which nothing ever moved.

        A stage of which a pair has counted, but not all, has moved the handle: the torque stays as it is from there on.
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
        """All stages were in vain: pause, then try the last one again, and larger torques if nothing moves."""
        self.failures += 1
        last, self._number = self._stage, 0
        self._still = 0 if self._moved or self._far >= self._probe.least(last) else self._still + 1
        self._pause = math.ceil(PAUSE / self._probe.period)
        self._moved, self._from, self._far = False, None, 0.0
        self._stages = (last, *(stage for stage in self._probe.stages if stage.effort > last.effort))
        if self._still >= ATTEMPTS and not self._again:
            self._trip(TripKind.SIGN_HIDDEN, float(self._still), self._probe.largest)
