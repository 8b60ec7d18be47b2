"""An ordinary period of a plan with one axis as one function: octets of the input image → octets of the output image.

A period is ordinary if nothing happens but a motion of the handle. A sample comes in time and without a flag, the power
state stays, no limit is reached, no gap or change is at work, no contact begins or ends, no doubt is open. Before this
is decided, nothing is written. Every other period goes to `full`, the code that all plans share; it alone contains the
guards, which decide what a fault is and what follows. A comparison here decides only whether a guard would act, so it
is the guard's own comparison or a narrower one. The sums are those of the full code, in the same order, and both keep
their values in the same objects: a period may go either way. `tests/cycle/test_ordinary.py` compares both, octet by
octet and value by value.

Python looks up a variable of an enclosing function faster than an attribute of an object, and calls cost most of all.
Therefore all constants of the plan are bound once, and only the law of the scene is called in every period.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from haptic_fieldbus.cycle.energy import Ledger
from haptic_fieldbus.cycle.energy_steps import PlainAccount, bind_ledger
from haptic_fieldbus.cycle.laws import PeriodStep, in_order
from haptic_fieldbus.cycle.plausibility import TorqueEcho
from haptic_fieldbus.cycle.safety import Trip, whole_steps
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.planning.image import AGE_NS, FLAGS, STATUSWORD, T_NS
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:  # imported for its type alone: the axis does without this module
    from haptic_fieldbus.cycle.axis import AxisCycle

Step = Callable[[bytes | bytearray], bytearray]
LARGEST_COUNT = 0x7FFF_FFFF
"""Of an encoder with 32 bits, counted from zero."""


class CycleState(Protocol):
    """The part of a cycle that its step uses."""

    enabled: bool
    trip: Trip | None

    def fail(self, error: Exception) -> None: ...


class NoSignWatch:
    """In place of a sign watch if the sign cannot be watched: a block that never ends."""

    total, left = 0, -1

    def add(self) -> None:
        """Do nothing."""


class ElsewhereJudged:
    """In place of a plain account if the ledger has a step of its own: nothing is decided before that step judges."""

    by_place = settles = False
    early = late = leak = active = energy = last = behind = 0.0
    limit = math.inf
    side = math.nan
    """No comparison holds, so no target leaves the contact."""

    def __init__(self, ledger: Ledger, *, controls: bool) -> None:
        self._ledger, self._controls, self._state = ledger, controls, ledger.ports[0].state
        self._step: PeriodStep = in_order(())
        self.older = 0
        """Second last target."""

    def bind(self) -> PeriodStep:
        """Open the account of the ledger; return the step that judges the last period."""
        self._step = bind_ledger(self._ledger, controls=self._controls)
        return self.judge

    def judge(self) -> None:
        """Judge the last period, in both ways of a period."""
        self.older = self._state.target
        self._step()


Account = PlainAccount | ElsewhereJudged


def _range(axis: AxisPlan) -> tuple[float, float]:
    """Return the first and last position of ordinary periods [m or rad].

    Beyond them a limit is passed, or the counts may have wrapped around since zero: the full code then adds a turn.
    """
    lowest, highest = axis.limits.position or (-math.inf, math.inf)
    wrap = LARGEST_COUNT * abs(axis.position_unit)
    return max(lowest, -wrap), min(highest, wrap)


def bind_ordinary(
    cycle: CycleState, each: "AxisCycle", account: Account, echo: TorqueEcho, output: bytearray, full: Step
) -> Step:
    """Return the step of a cycle with the only axis `each`; periods that are not ordinary call `full`."""
    state, permission, axis, after, limits = each.state, each.permission, each.axis, each.after, each.axis.limits
    unpack, pack_into, offset = each.image.input.unpack_from, each.image.output.pack_into, each.image.outputs[0]
    place, unit, effort_unit = axis.place_of(Signal.POSITION), axis.position_unit, axis.effort_unit
    sign, mask, (lowest, highest) = axis.rig.mechanism.sign, axis.power.mask, _range(axis)
    shortest, longest, oldest_ns, largest_way, jump = each.bounds
    still_ns, standstill, limit, not_finite = each.still_ns, each.standstill, each.limit, each.not_finite
    holding, effort, largest_change = limits.holding, whole_steps(limits.effort, effort_unit), limits.slew * each.period
    early, late, kept, own, older = account.early, account.late, echo.kept, echo.own, echo.older
    tolerance, shown_at, ratio, doubt = echo.doubt.tolerance, echo.place, echo.ratio, echo.doubt
    remember, watch = echo.before.appendleft, each.sign_watch or NoSignWatch()
    judge = account.judge if isinstance(account, ElsewhereJudged) else None
    steps = [step for step in (each.sense, judge, each.look) if step is not None]
    before = in_order(steps) if steps else None

    def period(image: bytes | bytearray) -> bytearray:
        sent, second_last, zero = state.target, account.older, state.zero_counts
        # No force is permitted yet, or contact begins or ends, or the account is to be looked at in each period.
        if (
            not cycle.enabled
            or zero is None
            or account.by_place
            or (account.settles if sent == second_last else sent * account.side <= 0)
        ):
            return full(image)
        # Decode: counts → position.
        feedback = unpack(image)
        t_ns = feedback[T_NS]
        here = (feedback[place] - zero) * unit
        way = here - state.position
        # Energy that the last torques gave on the way since.
        energy = account.energy
        if way:
            energy += way * (early * second_last + late * sent - account.leak * way) - (
                account.active * way if way > 0.0 else -account.active * way
            )
        # Echo: the torque that the drive should show.
        torque = kept * echo.torque + older * second_last + own * sent
        if (
            feedback[FLAGS]
            or feedback[STATUSWORD] & mask != state.power_bits
            or state.missing
            or permission.beside
            or doubt.open
            or not shortest < t_ns - state.fresh_ns < longest
            or feedback[AGE_NS] > oldest_ns
            or not -largest_way <= way <= largest_way
            or not lowest <= here <= highest
            or not -jump <= way - state.way <= jump
            or not -tolerance <= ratio * feedback[shown_at] - torque <= tolerance
            or (
                energy > account.limit
                if way
                # Counts that stand still under torque: a test of the encoder, or a smaller force.
                else t_ns - state.moved_ns > still_ns
                and (abs(sent) * effort_unit > holding or (standstill is not None and standstill.due()))
            )
        ):
            return full(image)
        state.feedback, state.fresh_ns, state.steps, state.way = feedback, t_ns, 1, way
        if way:
            state.moved_ns, account.energy, account.behind = t_ns, energy, account.last
            state.position = account.last = here
        account.older, echo.torque = sent, torque
        remember(sent)
        try:
            # Other signals, then the law of the scene: position → force.
            if before is not None:
                before()
            state.force = force = each.field(here)
            # Limit, encode, and add the torque to the block of the sign watch.
            if (
                permission.unchanged
                and -effort <= force <= effort
                and -largest_change <= force - permission.before <= largest_change
            ):
                permission.before = force
            else:
                force = limit(force)
            if force == force:
                state.target = target = round(force / effort_unit)
                pack_into(output, offset, state.controlword, sign * target)
            else:
                not_finite()
            if watch.left:
                watch.total += state.target
                watch.left -= 1
            else:
                watch.add()
            if after is not None:
                after()
        except Exception as error:
            cycle.fail(error)
        if cycle.trip is not None:  # set above by a guard or by `fail`
            each.release(tripped=True)
        return output

    return period
