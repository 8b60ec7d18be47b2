"""Fit of the shaft model to records, with intervals, and with the reason where a value cannot be separated.

Theory. The values minimise the sum of the squared prediction errors of all samples, by the method of Levenberg and
Marquardt within bounds: inertia and lag are positive, damping, friction and delay at least 0. Derivatives come
from `shaft.predicted_slopes`. A solution at a bound of delay or lag is tried again from another share of the lag.
Of delay and lag the sum is best known, and is what a hand feels; it has an interval of its own.

What is left is then searched for Stribeck friction and for waves of torque over the angle, such as cogging. A torque δ
that the model lacks changes the prediction error by a linear filter, so the share of the residual that each of many
such torques explains is found by linear least squares, beside the sensitivities of the values that the model has. The
best one becomes part of the model while the sum of squares falls by more than `WORTH`, and all values are fitted again.
Before that, modes of an elastic shaft are tried. One that explains `MODE_WORTH` is told by its frequency. Nothing is
added then: the model stays that of a rigid shaft, and what it says of friction and damping is doubtful.

What the model lacks at random, such as set-points that act a little earlier or later in each period, adds up in a model
that is led back slowly, and the feedback of the experiment answers to it. The gain by which the model is led back is
therefore a value of the fit, too: the predictor that predicts best (Ljung, 7.2 and 13.4). A fit that leaves more than
the noise of the encoder begins with a large gain, which has fewer wrong minima, and then takes the best one.

The covariance is (HᵀH)⁻¹·S·(HᵀH)⁻¹ with the sensitivities H and S = Σ w_l·Γ_l, the covariances Γ of the gradient over
lags up to `MEMORY` with the weights of Bartlett (Newey and West, Econometrica 55, 1987, 703). So a residual that is no
white noise, as of an encoder at low speed or of cogging, widens the intervals. It is never taken below that of white
noise, nor below the noise of an encoder that rounds.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from haptic_fieldbus.identification.estimates import Estimate, estimate_of, with_reasons
from haptic_fieldbus.identification.shaft import (
    LEADING,
    HeldSpan,
    ShaftModel,
    ShaftRecord,
    acting_torques,
    predicted_motion,
    predicted_slopes,
)
from haptic_fieldbus.numerals import rounded, rounded_limit
from haptic_fieldbus.numerics.linear import Matrix

FEWEST_SAMPLES, FEWEST_ROWS = 200, 30
GUESS_WIDTHS = (0.01, 0.03, 0.06)
"""Half widths of the triangles of the first guess [s]."""
ENCODER_NOISE = 0.4
"""Largest prediction error of a shaft that the model explains, a little above that of rounding, 1/√12 [counts]."""
FASTER = 8.0
"""How much faster a model is led from which a better solution is sought."""
FASTEST_LEADING, WORTH_LEADING = 0.35, 0.95
"""Largest double pole of a predictor, times the period, and the sum of squares that a faster one has to reach."""
SETTLED = 0.6
"""Time after which the first speed of a record is forgotten [s]."""
MEMORY, BLOCK = 0.4, 0.01
"""Longest lag of the residual that widens an interval, and length of the blocks in which it is counted [s]."""
WIDTH = 2.4
"""Half of an interval in standard deviations: 95 % where the covariance itself is uncertain by a fifth."""
REPEATED = 1.35
"""Widens every spread: a motion to and fro reads nearly the same counts again, so its errors of rounding repeat too."""
LEAST_SHARE, LEAST_SHARE_OF_PARTS, LEAST_SHARE_OF_LAG = 1e-3, 5e-3, 0.03
"""Half of an interval is at least this share of its value, and half of that of the lag this share of delay and lag:
set-points act a little earlier or later in each period, and further torques are constant over a period, or over a part
of one, in the model alone."""
MOST_STEPS = 40
SHORTEST_LAG, LONGEST_LAG = 1e-5, 0.02
"""Range of the lag of a torque loop [s]."""
LONGEST_DELAY = 6.0
"""Longest delay plus lag, in periods, beyond the lag."""
LAG_SHARES = (0.3, 0.7)
"""Shares of the lag in the delay and the lag together, from which a solution at a bound is tried again."""
WORTH, MOST_WAVES = 0.04, 3
"""Share of the sum of squares that a further torque has to explain, and the largest number of waves."""
TRIED_BESIDE = 3
"""Place of the second torque that is tried, in the order of what each explains."""
HIGHEST_ORDER, COUNTS_OF_A_WAVE, MOST_ORDERS = 48.0, 4.0, 250
"""Most periods of a wave in a turn, fewest counts of one of its periods, and most orders that are tried."""
STRIBECK_SHARES = (0.01, 0.03, 0.08, 0.2, 0.4)
"""Speeds of Stribeck friction that are tried, as shares of the top speed."""
STRIBECK_AGAIN = (0.5, 2.0)
"""Factors of a found speed of Stribeck friction, from which the values are sought once more."""
LOWEST_MODE, HIGHEST_MODE, MODE_SHARE, MODE_STEP = 8.0, 100.0, 0.4, 0.02
"""Resonances that are looked for: lowest and highest one [Hz], highest one as a share of the rate, and their step."""
MODE_DAMPING = (0.01, 0.03, 0.1)
"""Damping ratios that are tried."""
MODE_WORTH, MODE_NEAR, MODE_WIDEST = 0.1, 0.9, 1.5
"""Share of the sum of squares that a resonance explains at least, the part of it that all in its interval do, and the
largest ratio of the ends of this interval."""
SMALL = 1e-4
"""Step of a difference, of the scale of its value."""
NAMES = ("inertia", "viscous_damping", "coulomb_friction", "delay", "torque_lag", "load")
FIELDS = ("inertia", "damping", "coulomb", "delay", "lag", "load")
"""Values of a fit, and the fields of `ShaftModel` that they are."""
DELAY, LAG = NAMES.index("delay"), NAMES.index("torque_lag")


@dataclass(frozen=True)
class ShaftFit:
    """The fitted shaft, and what the fit rests on."""

    model: ShaftModel
    values: Mapping[str, Estimate]
    residual: float
    """Root mean square of the prediction error [encoder counts]."""
    top_speed: float
    """[rad/s]"""
    samples: int
    resonance: Estimate | None = None
    """Frequency at which the shaft swings beside its rigid motion; None where none was seen [Hz]."""
    warnings: tuple[str, ...] = field(default=())


def fit_shaft(records: Sequence[ShaftRecord], guess: ShaftModel | None = None) -> ShaftFit:
    """Return the fit to all records together; raises ValueError if there are too few samples or nothing moved."""
    samples = sum(len(each.positions) for each in records)
    if samples < FEWEST_SAMPLES:
        raise ValueError(f"{samples} samples; at least {FEWEST_SAMPLES} are needed")
    if max(np.ptp(each.positions) / each.resolution for each in records) < 10.0:
        raise ValueError("the shaft moved by less than 10 counts; more torque is needed")
    begin = guess or first_guess(records)
    found, resonance = _Problem(records, begin).solved(), None
    if found.cost > found.noise:
        # Beside an elastic shaft, further torques would only imitate its swing.
        plain = _Problem(records, replace(begin, stribeck=0.0, waves=())).solved() if found.is_wider else found
        if resonance := plain.resonance():
            found = plain
    if not resonance and found.cost > found.noise:
        # Faster led, a model has fewer wrong minima, and the noise of what it lacks does not add up.
        led = _Problem(records, begin, min(FASTER * LEADING, FASTEST_LEADING / found.period))
        found = _best_led(_widened(led.solved()))
    if not resonance:
        found = _best_led(_widened(found))
    for factor in STRIBECK_AGAIN if found.guess.stribeck else ():
        # Its speed changes the sum of squares little, and with many kinks.
        model = replace(found.model, stribeck_speed=factor * found.model.stribeck_speed)
        found = min(found, _Problem(records, model, found.leading).solved(), key=lambda each: each.cost)
    return found.solved(enough=1e-6).told(resonance)


def _best_led(found: "_Problem") -> "_Problem":
    """Return the solution with the gain of the predictor that predicts best.

    Of gains that predict alike the smallest is taken: its errors tell more of slow torques. Below the noise of an
    encoder a larger gain would only predict how its counts round.
    """
    for factor in (0.5, 2.0):
        while LEADING <= factor * found.leading <= FASTEST_LEADING / found.period:
            if factor > 1.0 and found.cost <= found.noise:
                break
            enough = max(found.cost, found.noise) / WORTH_LEADING if factor < 1.0 else WORTH_LEADING * found.cost
            other = _Problem(found.records, found.model, factor * found.leading).solved()
            if not other.cost < enough:
                break
            found = other
    return found


def _widened(found: "_Problem") -> "_Problem":
    """Return the solution with all further torques that are worth it."""
    for _ in range(MOST_WAVES + 1):
        tries = [_Problem(found.records, each, found.leading).descended() for each in found.further()]
        wider = min(tries, key=lambda each: each.cost, default=found)
        if not wider.cost < (1.0 - WORTH) * found.cost:
            break
        found = wider
    return found


# A first guess, by linear least squares of second differences.


def first_guess(records: Sequence[ShaftRecord]) -> ShaftModel:
    """Return a first model by linear least squares.

    The second difference of the position over 2·w samples is the mean of the acceleration under a triangle of that
    width, so it is compared with the mean of the torque under the same triangle, for several widths and delays.
    """
    period = records[0].period
    found = []
    for width in dict.fromkeys(max(2, round(seconds / period)) for seconds in GUESS_WIDTHS):
        for delay in np.arange(0.0, LONGEST_DELAY + 0.1, 0.5).tolist():
            rows, force, _ = zip(*(_weak_form(each, width, delay) for each in records), strict=True)
            found.append((*_non_negative(np.vstack(rows), np.concatenate(force)), delay))
    _, (inertia, damping, coulomb, load), delay = min(found, key=lambda each: each[0])
    lag = max(0.2 * delay * period, 2e-4)
    return ShaftModel(inertia, damping, coulomb, max(delay * period - lag, 0.0), lag, load)


def _weak_form(record: ShaftRecord, width: int, delay: float) -> tuple[Matrix, Matrix, Matrix]:
    """Return the rows (acceleration, speed, direction, −1), the torque on them, and their positions."""
    y, w, period = np.array(record.positions), width, record.period
    bend = (y[2 * w :] - 2.0 * y[w:-w] + y[: -2 * w]) / (w * period) ** 2
    speed = (y[2 * w :] - y[: -2 * w]) / (2.0 * w * period)
    force = record.torques_under(w, delay)[: len(bend)]
    moving = np.abs(speed) > 2.0 * record.resolution / (2.0 * w * period)
    bend, speed, force = bend[: len(force)][moving], speed[: len(force)][moving], force[moving]
    return np.column_stack([bend, speed, np.sign(speed), -np.ones(len(bend))]), force, y[w:-w][moving]


def torque_balance(model: ShaftModel, record: ShaftRecord) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return positions [rad], speeds [rad/s], and friction and load there [N·m], where the record moves, shapes (n,).

    They are what torque less inertia times acceleration, over some samples, leaves: friction as the torque against the
    positive direction, without load and waves of the model, and load without its friction and damping.
    """
    width = max(2, round(GUESS_WIDTHS[0] / record.period))
    rows, force, places = _weak_form(record, width, (model.delay + model.lag) / record.period)
    left, speeds = force - rows[:, 0] * model.inertia, rows[:, 1]
    load, friction = model.torque_at(places, 0.0, np), np.sign(speeds) * model.friction_at(speeds, np)
    return places, speeds, left + load, friction + model.damping * speeds - left


def _non_negative(rows: Matrix, force: Matrix) -> tuple[float, list[float]]:
    """Return (share of the torque that is left, values) of the least squares.

    The inertia is above 0, damping and friction are 0 or more. A share of infinity: the rows tell nothing.
    """
    values, low, high = np.zeros(4), np.array([-math.inf, 0.0, 0.0, -math.inf]), np.full(4, math.inf)
    for _ in low:  # each step holds one more value, or reaches the solution
        step = free_step(values, low, high, rows.T @ (rows @ values - force), rows.T @ rows, 0.0)
        values = np.clip(values - step, low, high)
    known = len(force) >= FEWEST_ROWS and values[0] > 0.0
    left = float(np.sum((rows @ values - force) ** 2) / max(np.sum(force**2), 1e-300)) if known else math.inf
    scale = float(np.std(force)) / max(float(np.std(rows[:, 0])), 1e-12)
    values[0] = max(values[0] if values[0] > 0.0 else scale, 1e-3 * scale, 1e-12)
    return left, values.tolist()


def prediction_errors(model: ShaftModel, record: ShaftRecord, leading: float = LEADING) -> Matrix:
    """Return the prediction errors of a record [counts], without those of its beginning, shape (n,)."""
    found, _ = predicted_motion(model, record, leading)
    errors: Matrix = (np.array(record.positions) - found)[unsettled_samples(record) :] / record.resolution
    return errors


def errors_after(model: ShaftModel, before: ShaftRecord, record: ShaftRecord) -> Matrix:
    """Return the prediction errors of a record that follows another one in motion [counts], shape (n,)."""
    places, torques = before.positions + record.positions, before.torques + record.torques
    return prediction_errors(model, replace(record, positions=places, torques=torques))[-len(record.positions) :]


def error_slopes(models: Sequence[ShaftModel], record: ShaftRecord, leading: float) -> Matrix:
    """Return by how much the prediction errors of further models differ from those of the first [counts], (n, m)."""
    slopes: Matrix = -predicted_slopes(models, record, leading)[unsettled_samples(record) :] / record.resolution
    return slopes


def allowed_error(fit: ShaftFit, record: ShaftRecord) -> float:
    """Return the root mean square of what values at the ends of their intervals change in a prediction [counts]."""
    ends = {key: getattr(fit.model, key) + fit.values[name].half_width for name, key in zip(NAMES, FIELDS, strict=True)}
    models = [fit.model, *(replace(fit.model, **{key: end}) for key, end in ends.items())]
    return float(np.sqrt(np.mean(np.sum(error_slopes(models, record, LEADING) ** 2, axis=1))))


def unsettled_samples(record: ShaftRecord) -> int:
    """Return the number of samples until the first speed is forgotten."""
    return min(round(SETTLED / record.period), len(record.positions) // 4)


# The problem in scaled values.


def free_step(vector: Matrix, low: Matrix, high: Matrix, gradient: Matrix, hessian: Matrix, damping: float) -> Matrix:
    """Return the step to take away, of the values that no bound holds (Levenberg and Marquardt)."""
    held = ((vector <= low) & (gradient > 0.0)) | ((vector >= high) & (gradient < 0.0))
    step, free = np.zeros(len(vector)), np.flatnonzero(~held)
    inner = hessian[np.ix_(free, free)]
    weight = np.diag(np.maximum(np.diag(inner), 1e-12 * float(np.trace(inner)) + 1e-300))
    step[free] = np.linalg.lstsq(inner + damping * weight, gradient[free], rcond=None)[0]
    return step


class _Problem:
    """Sum of squares over all records, and its solution.

    A vector holds the scaled values of `NAMES`, then those of further torques.
    """

    def __init__(self, records: Sequence[ShaftRecord], guess: ShaftModel, leading: float = LEADING) -> None:
        self.records, self.guess, self.period, self.leading = records, guess, records[0].period, leading
        self.lengths = [len(each.positions) - unsettled_samples(each) for each in records]
        """Numbers of residuals of the records."""
        self.noise = ENCODER_NOISE**2 * sum(self.lengths)
        """Sum of squares of a shaft that the model explains."""
        torque = float(np.sqrt(np.mean(np.concatenate([each.torques for each in records]) ** 2))) or 1.0
        self.top = max(each.top_speed for each in records) or 1.0
        self.way = max(float(np.ptp(each.positions)) for each in records)
        inertia, most, none = guess.inertia, LONGEST_DELAY * self.period, math.inf
        # Of each value: scale, first value, and lowest and highest one.
        rows = [
            (inertia, inertia, 1e-3 * inertia, 1e3 * inertia), (torque / self.top, guess.damping, 0.0, none),
            (torque, guess.coulomb, 0.0, none), (self.period, guess.delay, 0.0, most),
            (self.period, guess.lag, SHORTEST_LAG, LONGEST_LAG), (torque, guess.load, -none, none),
        ]  # fmt: skip
        if guess.stribeck:
            slowest, usual = 0.3 * STRIBECK_SHARES[0] * self.top, STRIBECK_SHARES[1] * self.top
            rows += [(torque, guess.stribeck, 0.0, none), (usual, guess.stribeck_speed, slowest, self.top)]
        for order, *sizes in guess.waves:
            rows += [(1.0 / self.way, order, 0.0, none), *((torque, size, -none, none) for size in sizes)]
        self.scales, *others = map(np.array, zip(*rows, strict=True))
        self.vector, self.low, self.high = (each / self.scales for each in others)
        self.cost, self.is_time = none, np.isin(np.arange(len(rows)), (DELAY, LAG))
        self.is_wider = len(rows) > len(NAMES)
        """Whether the model has torques beyond those of `NAMES`."""

    @property
    def model(self) -> ShaftModel:
        return self._model_of(self.vector)

    def _model_of(self, vector: Matrix) -> ShaftModel:
        values = (vector * self.scales).tolist()
        base, further = values[: len(NAMES)], values[len(NAMES) :]
        stribeck, speed = (further.pop(0), further.pop(0)) if self.guess.stribeck else (0.0, 1.0)
        waves = tuple((further[k], further[k + 1], further[k + 2]) for k in range(0, len(further), 3))
        return replace(ShaftModel(*base), stribeck=stribeck, stribeck_speed=speed, waves=waves)

    # Torques that the model lacks.

    def _beside(self, responses: Callable[[ShaftRecord], Matrix]) -> tuple[Matrix, Matrix]:
        """Return the residuals, and what responses to further torques have beside the sensitivities of the values."""
        residuals, columns = self.residuals(self.vector), np.vstack([responses(each) for each in self.records])
        known, _ = np.linalg.qr(self.sensitivities(self.vector))
        return residuals, columns - known @ (known.T @ columns)

    def further(self) -> list[ShaftModel]:
        """Return models with one more torque, which may explain the residual better."""
        model, cost = self.model, self.cost
        highest = min(HIGHEST_ORDER, math.tau / self.records[0].resolution / COUNTS_OF_A_WAVE)
        # A period more or less over the way is another wave; half of one is as good as any between.
        count = min(MOST_ORDERS, int(2.0 * highest * self.way / math.tau))
        orders: Matrix = np.array([math.pi / self.way * (number + 1) for number in range(count)])
        speeds: Matrix = np.array([self.top * each for each in (() if model.stribeck else STRIBECK_SHARES)])
        residuals, columns = self._beside(lambda record: self._further_responses(record, orders, speeds))
        found: list[tuple[float, ShaftModel]] = []
        for number, speed in enumerate(speeds.tolist()):
            gained, (size,) = _explained(residuals, columns[:, number : number + 1])
            if size > 0.0:
                found.append((gained, replace(model, stribeck=size, stribeck_speed=speed)))
        for number, order in enumerate(orders.tolist() if len(model.waves) < MOST_WAVES else ()):
            first = len(speeds) + 2 * number
            gained, (cosine, sine) = _explained(residuals, columns[:, first : first + 2])
            found.append((gained, replace(model, waves=(*model.waves, (order, cosine, sine)))))
        # Beside the best one stands one that is not its neighbour, because the residual is not yet that of one torque.
        found.sort(key=lambda each: each[0], reverse=True)
        best = [each for gained, each in found[: 1 + TRIED_BESIDE] if gained > WORTH * cost]
        tries = [*best[:1], *[each for each in best[TRIED_BESIDE:] if each.waves != model.waves]]
        if len(speeds) and (tries or cost > self.noise or not self._is_inside):
            # Far from its solution, friction that falls with speed looks like more Coulomb friction and less inertia.
            share = STRIBECK_SHARES[len(speeds) // 2] * self.top
            falling = replace(model, coulomb=0.6 * model.coulomb, stribeck=0.4 * model.coulomb, stribeck_speed=share)
            tries.append(replace(falling, inertia=1.6 * model.inertia))
        return tries

    def _further_responses(self, record: ShaftRecord, orders: Matrix, speeds: Matrix) -> Matrix:
        """Return the prediction of each sample [counts] by unit torques: Stribeck friction, then pairs of waves."""
        model, leading, period = self.model, self.leading, record.period
        angles, moved = predicted_motion(model, record, leading, speed=0.0)
        turns, middles = np.outer(angles + 0.5 * period * moved, orders), np.outer(moved, 1.0 / speeds)
        waves = np.stack([np.cos(turns), np.sin(turns)], axis=2).reshape(len(angles), -1)
        waves *= np.repeat(np.sinc(np.outer(moved, 0.5 * period * orders / math.pi)), 2, axis=1)
        torques = np.hstack([-np.sign(moved)[:, np.newaxis] * np.exp(-(middles**2)), waves])
        span, near, pull = HeldSpan(model, period), 1.0 - math.exp(-2.0 * leading * period), leading * leading * period
        angle, speed, out = np.zeros(torques.shape[1]), np.zeros(torques.shape[1]), np.empty_like(torques)
        for k, torque in enumerate(torques):
            out[k] = angle
            speed -= pull * angle
            angle = (1.0 - near) * angle + span.way * speed + span.way_of_force * torque
            speed = span.speed_left * speed + span.speed_of_force * torque
        responses: Matrix = out[unsettled_samples(record) :] / record.resolution
        return responses

    def resonance(self) -> Estimate | None:
        """Return the frequency of a mode that explains a good part of the residual, as of an elastic shaft, or None.

        Beyond its rigid motion a shaft with a spring swings, by the ratio of both inertias times torque over inertia.
        """
        steps = math.ceil(math.log(min(HIGHEST_MODE, MODE_SHARE / self.period) / LOWEST_MODE) / MODE_STEP)
        frequencies = LOWEST_MODE * np.exp(MODE_STEP * np.arange(steps + 1))
        modes = np.array([(math.tau * each, ratio) for each in frequencies for ratio in MODE_DAMPING])
        residuals, columns = self._beside(lambda record: _mode_responses(self.model, record, modes))
        found = [_explained(residuals, columns[:, number : number + 1]) for number in range(len(modes))]
        shares = np.array([gained / self.cost if size > 0.0 else 0.0 for gained, (size,) in found])
        by_frequency = shares.reshape(len(frequencies), len(MODE_DAMPING)).max(axis=1)
        best = int(by_frequency.argmax())
        near = np.flatnonzero(by_frequency > MODE_NEAR * by_frequency[best])
        if by_frequency[best] < MODE_WORTH or best in (0, len(frequencies) - 1):  # the curve has no top
            return None
        low, top, high = (float(frequencies[each]) for each in (near[0], best, near[-1]))
        if high > MODE_WIDEST * low:  # far from its solution, any swing explains a part of what a fit leaves
            return None
        return Estimate(top, low / math.exp(MODE_STEP), high * math.exp(MODE_STEP), "Hz")

    def residuals(self, vector: Matrix) -> Matrix:
        """Return the prediction errors of all records [counts], shape (n,)."""
        model = self._model_of(vector)
        return np.concatenate([prediction_errors(model, each, self.leading) for each in self.records])

    def sensitivities(self, vector: Matrix) -> Matrix:
        """Return the derivative of the residuals, shape (n, m)."""
        steps = np.where(vector + SMALL > self.high, -SMALL, SMALL)
        models = [self._model_of(each) for each in (vector, *(vector + np.diag(steps)))]
        slopes: Matrix = np.vstack([error_slopes(models, each, self.leading) for each in self.records]) / steps
        return slopes

    def solved(self, enough: float = 1e-3) -> "_Problem":
        """Return the problem at its least sum of squares."""
        found = self.descended(enough)
        for share in LAG_SHARES:
            if found._is_inside:
                break
            again, both = copy(found), found.vector[DELAY] + found.vector[LAG]
            again.vector = found.vector.copy()
            again.vector[[DELAY, LAG]] = (1.0 - share) * both, share * both
            found = min(found, again.descended(enough), key=lambda each: each.cost)
        return found

    @property
    def _is_inside(self) -> bool:
        """Return whether delay and lag are inside their bounds."""
        return bool(np.all((self.low < self.vector) & (self.vector < self.high), where=self.is_time))

    def descended(self, enough: float = 1e-3) -> "_Problem":
        """Go down to where a step lowers the sum of squares by less than the share `enough`; return the problem."""
        vector = np.clip(self.vector, self.low, self.high)
        residuals = self.residuals(vector)
        cost, damping, slopes, is_fresh = float(residuals @ residuals), 1e-3, None, False
        for _ in range(MOST_STEPS):
            if slopes is None:
                slopes, is_fresh = self.sensitivities(vector), True
            gradient, hessian = slopes.T @ residuals, slopes.T @ slopes
            while damping < 1e7:
                step = free_step(vector, self.low, self.high, gradient, hessian, damping)
                # An inertia changes by at most a factor of two in one step.
                step[0] = max(-vector[0], min(0.5 * vector[0], step[0]))
                moved = np.clip(vector - step, self.low, self.high)
                after = self.residuals(moved)
                if (new := float(after @ after)) < cost or not is_fresh:
                    break
                damping *= 10.0
            gained, way = cost - new, moved - vector
            if gained > 0.0:
                # A secant corrects the sensitivities along the step (Broyden, Math. Comp. 19, 1965, 577).
                slopes = slopes + np.outer(after - residuals - slopes @ way, way / max(float(way @ way), 1e-300))
                vector, residuals, cost, damping = moved, after, new, max(damping * 0.2, 1e-9)
            if gained < enough * cost:
                if is_fresh:
                    break
                slopes = None
            is_fresh = False
        self.cost, self.vector = cost, vector
        return self

    # What the solution says.

    def told(self, resonance: Estimate | None) -> ShaftFit:
        """Return the fit with its intervals and reasons."""
        model, vector, residuals = self.model, self.vector, self.residuals(self.vector)
        spreads = self._spreads(self.sensitivities(vector), residuals)
        values = (*(vector * self.scales)[: len(NAMES)].tolist(), model.delay + model.lag)
        rms, slow = float(np.sqrt(np.mean(residuals**2))), _Problem(self.records, model)
        left = float(np.sqrt(np.mean(slow.residuals(slow.vector) ** 2)))
        # Above the noise of an encoder, a residual is a torque that the model lacks, and it may take sides.
        width = WIDTH * (1.0 + min(1.0, max(0.0, rms / ENCODER_NOISE - 1.0)))
        least = LEAST_SHARE_OF_PARTS if self.is_wider else LEAST_SHARE
        estimates = {
            name: estimate_of(name, value, max(width * spread, least * abs(value)))
            for name, value, spread in zip((*NAMES, "delay_and_lag"), values, spreads, strict=True)
        }
        estimates["torque_lag"] = self._lag_interval(vector, width)
        warnings = list[str]()
        if resonance:
            frequency = f"{rounded_limit(resonance.value)} Hz, as with an elastic coupling or a hand at the handle"
            warnings.append(
                f"the shaft swings at about {frequency}, which the model does not have: damping and friction may be "
                "wrong by a factor of two"
            )
        elif left > 3.0:
            play = "play, an elastic coupling and a hand at the handle are not in it; the intervals are wider by this"
            warnings.append(f"the model leaves {rounded(left)} counts unexplained: {play}")
        told = with_reasons(estimates, self.top)
        return ShaftFit(model, told, left, self.top, len(residuals), resonance, tuple(warnings))

    def _lag_interval(self, vector: Matrix, width: float) -> Estimate:
        """Return the lag with its interval, which is symmetric in its square.

        Beside the delay, whose sum with it is known, a short lag acts by its square: at 0 it changes nothing.
        """
        both, near = vector[DELAY] + vector[LAG], vector.copy()
        near[LAG] = max(vector[LAG], LAG_SHARES[0] * both)
        near[DELAY] = max(both - near[LAG], 0.0)
        spread = width * self._spreads(self.sensitivities(near), self.residuals(vector))[LAG]
        lag, reference = (float(each[LAG] * self.scales[LAG]) for each in (vector, near))
        spread = max(spread, LEAST_SHARE_OF_LAG * both * self.period)
        wide = 2.0 * reference * spread + spread**2
        return Estimate(lag, math.sqrt(max(lag**2 - wide, 0.0)), math.sqrt(lag**2 + wide), "s")

    def _spreads(self, slopes: Matrix, residuals: Matrix) -> list[float]:
        """Return the standard deviation of each of `NAMES`, and then of the delay and the lag together."""
        inverse = np.linalg.pinv(slopes.T @ slopes, rcond=1e-14)
        noise = max(float(residuals @ residuals) / max(len(residuals) - slopes.shape[1], 1), 1.0 / 12.0)
        block, coloured = max(1, round(BLOCK / self.period)), np.zeros_like(inverse)
        for scores in np.split(slopes * residuals[:, np.newaxis], np.cumsum(self.lengths)[:-1]):
            sums = np.add.reduceat(scores, range(0, len(scores), block))
            coloured += _long_run(sums, round(MEMORY / (block * self.period)))
        forms = np.vstack([np.eye(len(NAMES), len(self.scales)), self.is_time]) * self.scales
        both = (noise * inverse, inverse @ coloured @ inverse)
        variances = [np.einsum("ij,jk,ik->i", forms, each, forms) for each in both]
        spreads: list[float] = (REPEATED * np.sqrt(np.max(variances, axis=0, initial=0.0))).tolist()
        return spreads


def _mode_responses(model: ShaftModel, record: ShaftRecord, modes: Matrix) -> Matrix:
    """Return the swing of each sample [counts] by modes of an elastic shaft, each with the torque over inertia of all.

    `modes` are angular frequencies and damping ratios, shape (m, 2). A mode is moved exactly under the torque that a
    set-point makes after delay and lag.
    """
    eigen = modes[:, 0] * (-modes[:, 1] + 1j * np.sqrt(1.0 - modes[:, 1] ** 2))
    acting, spans = acting_torques(model, record)
    pieces = []
    for seconds, ahead in spans:
        left, after = np.exp(eigen * seconds), math.exp(-seconds / model.lag)
        pieces.append((left, (left - 1.0) / eigen, (left - after) / (eigen + 1.0 / model.lag), after, ahead))
    state, torque, out = np.zeros(len(modes), complex), 0.0, np.empty((len(record.positions), len(modes)))
    for k in range(len(out)):
        out[k] = state.imag
        for left, held, fading, after, ahead in pieces:
            behind = torque - acting[k + ahead]
            state = left * state + held * acting[k + ahead] + fading * behind
            torque = acting[k + ahead] + behind * after
    responses: Matrix = (out / eigen.imag / model.inertia)[unsettled_samples(record) :] / record.resolution
    return responses


def _explained(residuals: Matrix, columns: Matrix) -> tuple[float, list[float]]:
    """Return by how much columns lower the sum of squares, and their coefficients."""
    moment = columns.T @ residuals
    sizes = np.linalg.lstsq(columns.T @ columns, moment, rcond=1e-9)[0]
    return float(moment @ sizes), sizes.tolist()


def _long_run(gradient: Matrix, most: int) -> Matrix:
    """Return the covariance of the sum of the rows, with the weights of Bartlett up to the lag `most`."""
    total: Matrix = gradient.T @ gradient
    for lag in range(1, min(most, len(gradient) - 1) + 1):
        beside = gradient[lag:].T @ gradient[:-lag]
        total = total + (1.0 - lag / (most + 1.0)) * (beside + beside.T)
    return total
