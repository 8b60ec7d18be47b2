"""Cases of measurement: velocity from counts, tachometers, jittered and missing samples, and the lag of the torque."""

import math
from collections.abc import Callable, Iterable, Sequence
from functools import reduce

import numpy as np

from haptic_fieldbus import margins
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics import estimators, integrators
from haptic_fieldbus.numerics.estimators import tachometer
from haptic_fieldbus.numerics.linear import Matrix, StateSpace, system_of
from haptic_fieldbus.numerics.sampled import loop_matrix, spectral_radius
from haptic_fieldbus.study.case import (
    CaseResult,
    greatest,
    largest_error,
    refused,
    relative_error,
    result_of,
    values_text,
)
from haptic_fieldbus.study.measure import region
from haptic_fieldbus.study.measure.problems import spring
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import bisected, limit_in_contact, moved_by_force

PERIOD, STEP = 1e-3, 1e-5
"""Period [s] and encoder count [m]."""
# A fraction by which phases of a count come as evenly as they can: multiples of the golden ratio never repeat.
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def _counted(speed: float, samples: int) -> list[float]:
    """Return the encoder positions of a steady motion [m], sample by sample."""
    return [STEP * math.floor(speed * PERIOD * number / STEP) for number in range(samples)]


def _estimated(spec: str, positions: Iterable[float], period: float = PERIOD) -> list[float]:
    """Return the velocities of an estimator that is given the encoder count [m/s]."""
    return list(map(estimators.bind(spec, period, STEP), positions))


def velocity_quantisation(quick: bool) -> CaseResult:
    """Check that a difference of counts gives only whole multiples of D/T, with the rms error of theory."""
    samples, ratio = 20_000 if quick else 1_000_000, 3.0 + GOLDEN
    found = np.array(_estimated("backward-difference", _counted(ratio * STEP / PERIOD, samples))[1:])
    unit = STEP / PERIOD
    levels = sorted(set(np.round(found / unit, 6).tolist()))
    error = float(np.sqrt(np.mean((found - ratio * unit) ** 2)))
    expected = unit * math.sqrt(GOLDEN * (1.0 - GOLDEN))
    return result_of(
        f"3 or 4 times D/T = {exactly(unit * 1e3)} mm/s, rms error D/T·√(f(1 − f)) = {expected * 1e3:.4f} mm/s (0.1 %)",
        f"{' or '.join(f'{exactly(level)}' for level in levels)} times, rms {error * 1e3:.4f} mm/s",
        "closed form: two levels with shares f and 1 − f, f the fraction of v·T/D",
        tolerance="0.1 % of the rms error; levels exact",
        within=[(error / expected - 1.0, 1e-3)],
        holds=levels == [3.0, 4.0],
    )


def zero_transition_window(quick: bool) -> CaseResult:
    """Check that a window without a count reads 0 although the handle moves, and the time between counts does not."""
    samples, ratio, window = 20_000 if quick else 1_000_000, GOLDEN / 10.0, 8
    speed = ratio * STEP / PERIOD
    positions = _counted(speed, samples)
    share = _estimated(f"moving-average:window={window}", positions).count(0.0) / samples
    *timed, stopped = _estimated("tick-interval", positions + 1000 * positions[-1:])
    timed = timed[1000:samples]
    least, most = min(timed) / speed - 1.0, greatest(timed) / speed - 1.0
    expected = 1.0 - window * ratio
    low, high = (1.0 / (apart * ratio) - 1.0 for apart in (math.ceil(1.0 / ratio), math.floor(1.0 / ratio)))
    return result_of(
        f"{expected:.4f} of the windows of {window} read 0 (±0.002); the time between counts, 16 or 17 periods, errs "
        f"by {low:.4f} to {high:.4f} (1e-9), and falls to D/s = {STEP * 1e6:.1f} µm/s a second after a stop",
        f"{share:.4f} read 0; errs by {least:.4f} to {most:.4f}, {stopped * 1e6:.1f} µm/s after the stop",
        "closed form: a window of N periods sees no count in 1 − N·v·T/D of all phases",
        tolerance="0.002 of the share, 1e-9 of the errors",
        within=[(share - expected, 2e-3), (least - low, 1e-9), (most - high, 1e-9)],
        holds=0.98 * STEP <= stopped <= 1.001 * STEP,
    )


def differentiator_tau_below_half_t(quick: bool) -> CaseResult:
    """Check that s/(τs + 1) by the forward mapping is refused below τ = T/2, where its pole 1 − T/τ is unstable."""
    steps = 100 if quick else 10_000
    tau = 0.49 * PERIOD
    refusal = refused(lambda: estimators.bind(f"filtered-derivative:tau={tau!r},mapping=forward", PERIOD))
    answers = _estimated(f"filtered-derivative:tau={0.51 * PERIOD!r},mapping=forward", (0.0, *[1.0] * 50))
    ratio = answers[50] / answers[49]
    lag = system_of([[-1.0 / tau]], [[1.0 / tau]], [[-1.0 / tau]], [[1.0 / tau]])
    pole = float(integrators.discrete(lag, PERIOD, "forward-euler").a[0, 0])
    growth, expected = abs(pole) ** steps, (1.0 / 0.49 - 1.0) ** steps
    return result_of(
        f"τ = 0.49 T refused with the limit 0.0005 s, for it grows by {rounded(expected, 4)} in {steps} steps; 0.51 T "
        f"rings with {1.0 - 1.0 / 0.51:.6f} a step (1e-9)",
        f"{'refused' if refusal else 'taken'}, growth {rounded(growth, 4)}; 0.51 T rings with {ratio:.6f}",
        "closed form of the pole, 1 − T/τ",
        tolerance="1e-9 of the growths; the words exact",
        within=[(growth / expected - 1.0, 1e-9), (ratio - 1.0 + 1.0 / 0.51, 1e-9)],
        holds="0.0005 s" in refusal,
    )


def lecture_noise(quick: bool) -> CaseResult:
    """Check y = sin t + 0.1·sin 10t differentiated: the noise grows as large as the signal, a filter reduces it."""
    turns, samples = 3, 2000 if quick else 200_000
    period, tau = 2.0 * math.pi / samples, 0.2
    times = period * np.arange(turns * samples)
    heard = (np.sin(times) + 0.1 * np.sin(10.0 * times)).tolist()

    def amplitudes(spec: str) -> tuple[float, float]:
        last = np.array(_estimated(spec, heard, period)[-samples:])
        one, ten = (2.0 / samples * abs(np.sum(last * np.exp(-1j * w * times[-samples:]))) for w in (1.0, 10.0))
        return float(one), float(ten)

    plain = amplitudes("backward-difference")
    smooth = amplitudes(f"filtered-derivative:tau={tau},mapping=trapezoidal")
    mapped = [2.0 / period * math.tan(0.5 * w * period) for w in (1.0, 10.0)]
    expected = (2.0 / period * math.sin(0.5 * period), 0.2 / period * math.sin(5.0 * period))
    filtered = [part * w / math.hypot(1.0, tau * w) for part, w in zip((1.0, 0.1), mapped, strict=True)]
    worst = largest_error((*plain, *smooth), (*expected, *filtered))
    return result_of(
        f"noise over signal 0.1 before, {expected[1] / expected[0]:.4f} differentiated, "
        f"{filtered[1] / filtered[0]:.4f} with τ = {tau} s; amplitudes to 1e-4",
        f"{plain[1] / plain[0]:.4f}, {smooth[1] / smooth[0]:.4f} with the filter; worst amplitude off by "
        f"{rounded(worst, 2)}",
        "closed form: (2/T)·sin(ωT/2), and Ω/√(1 + τ²Ω²) with Ω = (2/T)·tan(ωT/2)",
        tolerance="1e-4 of the amplitudes",
        within=[(worst, 1e-4)],
    )


def tachometer_drift(quick: bool) -> CaseResult:
    """Check that a tachometer rounded down drifts by half a step, and one rounded to nearest loses slow motions."""
    samples, unit = 20_001 if quick else 1_000_001, 1e-3
    down, near = tachometer.bind_position(PERIOD), tachometer.bind_position(PERIOD)
    x = slow = 0.0
    for number in range(samples):
        velocity = 20.3 * unit * (abs(4.0 * ((0.5 * number * PERIOD + GOLDEN) % 1.0) - 2.0) - 1.0)
        x = down(unit * math.floor(velocity / unit))
        slow = near(unit * round(0.49))
    seconds = (samples - 1) * PERIOD
    expected = -0.5 * unit
    return result_of(
        f"{expected * 1e3:.3f} mm/s to and fro (1 %); a motion of 0.49 steps stays at 0 m exactly",
        f"{x / seconds * 1e3:.4f} mm/s over {seconds:.0f} s; {exactly(slow)} m of {rounded(0.49 * unit * seconds, 4)} "
        "m",
        "closed form: rounding down takes half a step on average",
        tolerance="1 % of the drift; 0 exact",
        within=[(x / seconds / expected - 1.0, 0.01)],
        holds=slow == 0.0,
    )


def tachometer_alias(quick: bool) -> CaseResult:
    """Check that an oscillation at the sampling rate reads as a constant velocity, and a slower one loses amplitude."""
    samples, phase, size = 2000 if quick else 200_000, 0.3, 1e-4
    turn = 2.0 * math.pi / PERIOD
    aliased, slower = tachometer.bind_position(PERIOD), tachometer.bind_position(PERIOD)
    x, positions = 0.0, []
    for number in range(samples):
        x = aliased(size * turn * math.cos(turn * number * PERIOD + phase))
        positions.append(slower(size * 2.0 / PERIOD * math.cos(2.0 * number)))
    drift, expected = x / ((samples - 1) * PERIOD), size * turn * math.cos(phase)
    share = 0.5 * float(np.ptp(positions)) / size
    return result_of(
        f"drift of {expected:.6f} m/s at the sampling rate (1e-9), {1.0 / math.tan(1.0):.4f} of the amplitude at "
        "ωT = 2 (1e-3)",
        f"{drift:.6f} m/s, {share:.4f} of the amplitude",
        "closed form: A·ω·cos φ, and (ωT/2)/tan(ωT/2)",
        tolerance="1e-9 of the drift, 1e-3 of the amplitude",
        within=[(drift / expected - 1.0, 1e-9), (share * math.tan(1.0) - 1.0, 1e-3)],
    )


def jittered_sampling(quick: bool) -> CaseResult:
    """Check that jitter lowers the limit by its square, and is an error of a difference that assumes the period T."""
    number, plant = 300 if quick else 3000, margins.Plant(5.0, 0.5)
    times = PERIOD * (1.0 + np.random.default_rng(4).uniform(-0.5, 0.5, number))
    devices = [margins.sample(plant, float(time), 0.0) for time in times]

    def is_stable(stiffness: float) -> bool:
        maps: list[Matrix] = [loop_matrix(device, spring(stiffness)) for device in devices]
        return spectral_radius(reduce(lambda before, after: after @ before, maps)) <= 1.0

    expected = 2.0 * plant.damping * float(times.sum() / (times**2).sum())
    low, _ = bisected(is_stable, 0.5 * expected, 2.0 * expected, 5e-4 if quick else 2e-6)
    sides = [_grows_by_hand(plant, part * low, (times / PERIOD).tolist()) for part in (1.0 - 1e-3, 1.0 + 1e-3)]
    timed, instants = estimators.bind("tick-interval", PERIOD), np.cumsum(times).tolist()
    error = float(np.std(_estimated("backward-difference", instants)[1:]))
    worst = greatest(abs(v - 1.0) for v in [timed(x, x * 1e9) for x in instants][1:])
    spread = float(np.std(times[1:])) / PERIOD
    return result_of(
        f"K up to 2b·ΣT_i/ΣT_i² = {expected:.1f} N/m (1 %), against {2.0 * plant.damping / PERIOD:.0f} N/m without "
        f"jitter; a steady 1 m/s is read with an rms error of {spread:.4f} m/s (1e-6), "
        "and of 0 with the samples' times (1e-9)",
        f"{low:.1f} N/m (by hand {'decays' if not sides[0] else 'grows'} at 0.999 of it, "
        f"{'grows' if sides[1] else 'decays'} at 1.001); {error:.4f} m/s, and {rounded(worst, 2)} m/s at most with "
        "times",
        "closed form for light damping; the motion over all intervals by hand; spread of the intervals over T",
        tolerance="0.1 % of the limit by hand, 1 % of the closed form; 1e-6 and 1e-9 of the velocity",
        within=[(low / expected - 1.0, 0.01), (error / spread - 1.0, 1e-6), (worst, 1e-9)],
        holds=sides == [False, True],
    )


def _grows_by_hand(plant: margins.Plant, stiffness: float, lengths: Sequence[float]) -> bool:
    """Return whether (x, v) grows over a pattern of gaps, each force held for its whole gap, in plain floats."""
    columns = []
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        for length in lengths:
            x, v = moved_by_force(plant, x, v, -stiffness * x, length * PERIOD)
        columns.append((x, v))
    (a, c), (b, d) = columns
    # Jury's conditions of the map [[a, b], [c, d]]: determinant and trace.
    return not (abs(a * d - b * c) < 1.0 and abs(a + d) < 1.0 + a * d - b * c)


def dropped_frames(quick: bool) -> CaseResult:
    """Check that lost frames with a held force lower the limit by the squares of their gaps."""
    plant = margins.Plant(5.0, 0.5)
    patterns: dict[str, tuple[int, ...]] = {
        "none": (1,), "every second": (2,), "one of three": (1, 2), "two of five": (1, 1, 3),
        "ten of a hundred": (*[1] * 90, 10),
    }  # fmt: skip
    texts, bounds, close, agree, off = [], [], True, True, 0.0
    for name, lengths in patterns.items():
        limit = margins.pattern_limit(plant, PERIOD, 0.0, spring, margins.gaps(lengths))
        bound = 2.0 * plant.damping * sum(lengths) / (PERIOD * sum(length**2 for length in lengths))
        agree &= [_grows_by_hand(plant, limit * part, lengths) for part in (1.0 - 1e-4, 1.0 + 1e-4)] == [False, True]
        off = greatest((off, abs(limit / bound - 1.0)))
        close &= abs(margins.pattern_bound(plant.damping, PERIOD, margins.gaps(lengths)) / bound - 1.0) <= 1e-12
        texts.append(f"{name} {limit:.1f}")
        bounds.append(f"{name} {bound:.1f}")
    return result_of(
        f"2b·ΣT_i/ΣT_i²: {', '.join(bounds)} N/m (0.5 %)",
        f"{', '.join(texts)} N/m; by hand decays at 1 − 1e-4 of it and grows at 1 + 1e-4: {'yes' if agree else 'no'}",
        "closed form for light damping; the motion over a pattern by hand, event after event",
        tolerance="0.5 % of the bound, 1e-4 of the limit by hand",
        within=[(off, 5e-3)],
        holds=close and agree,
    )


# Case of a torque loop with a lag: its limits of stability and passivity, and the damping that a wall then needs.

LAGS_PERIOD = 1e-3
BENCHES = ((0.4e-3, 0.3e-3), (0.16e-3, 1.2e-3), (2e-3, 0.5e-3))
"""Lag and delay [s]."""
MASS, DAMPING, VIRTUAL = 0.1, 2.0, 0.5
"""Device [kg, N·s/m], and the damper of a wall [N·s/m]."""
DASHPOT = 20.0
"""Dashpot in series with a spring [N·s/m]; without the spring it would be too large to be passive."""
ASKED = 300.0
"""Stiffness of the wall for which the required damping is computed [N/m]."""
AGREEMENT, CUT = 1e-6, 5e-4
"""Permitted relative difference of limits of stability, and of energies: motions are cut into cells."""


Force = Callable[[complex], complex]
"""Force at the samples per position, as a function of z."""


def _wall(stiffness: float) -> StateSpace:
    return region.wall(stiffness, VIRTUAL, LAGS_PERIOD, "backward-difference")


def _wall_by_hand(stiffness: float, virtual: float = VIRTUAL) -> Force:
    return lambda z: -stiffness - virtual * (1.0 - 1.0 / z) / LAGS_PERIOD


def _maxwell(stiffness: float) -> StateSpace:
    """Return a spring in series with the dashpot, by s = (1 − z⁻¹)/T: its pole moves with the stiffness."""
    whole = stiffness * LAGS_PERIOD + DASHPOT
    pole, step = DASHPOT / whole, -stiffness * DASHPOT / whole
    return system_of([[pole]], [[1.0]], [[step * (pole - 1.0)]], [[step]])


def _maxwell_by_hand(stiffness: float) -> Force:
    def force(z: complex) -> complex:
        s = (1.0 - 1.0 / z) / LAGS_PERIOD
        return -stiffness * DASHPOT * s / (stiffness + DASHPOT * s)

    return force


def _passive(lag: float, delay: float, cells: int) -> tuple[list[float], list[float]]:
    """Return the limits of passivity of spring, wall and Maxwell body [N/m], and shares that should be 1.

    The shares are those of the damping that the worst motion needs at these limits; the last one is the share for
    ASKED, relative to the computed one.
    """
    plant, drives = margins.Plant(MASS, DAMPING, torque_lag=lag), [energies.LateDrive(DAMPING, delay, lag)]
    spring_alone = margins.passive_limit(plant, LAGS_PERIOD, delay)
    wall, body = (margins.passive_limit_of(plant, LAGS_PERIOD, delay, each, math.inf) for each in (_wall, _maxwell))
    forces = (_wall_by_hand(spring_alone, 0.0), _wall_by_hand(wall), _maxwell_by_hand(body), _wall_by_hand(ASKED))
    *shares, asked = (energies.worst_share(force, drives, LAGS_PERIOD, cells) for force in forces)
    computed = margins.alone(plant, LAGS_PERIOD, delay).damping_share(_wall(ASKED))
    return [spring_alone, wall, body], [*shares, asked / computed]


def torque_lag(quick: bool) -> CaseResult:
    """Check that the lag of a torque loop counts in stability and, as energy, in each way to passivity.

    The ways are the closed form of a spring, the largest gain of a wall with a damper, the bisection for a Maxwell
    body, and the damping that a wall requires.
    """
    plants = [(margins.Plant(MASS, DAMPING, torque_lag=lag), delay) for lag, delay in BENCHES]
    stable = [margins.stiffness_limit(plant, LAGS_PERIOD, delay, _wall) for plant, delay in plants]
    motors = [(events.motor(MASS, DAMPING, lag), delay) for lag, delay in BENCHES]
    by_hand = [limit_in_contact(motor, LAGS_PERIOD, delay, VIRTUAL) for motor, delay in motors]
    apart = relative_error(stable, by_hand)
    passive, shares = zip(*(_passive(lag, delay, 24 if quick else 48) for lag, delay in BENCHES), strict=True)
    worst = greatest(abs(share - 1.0) for each in shares for share in each)
    return result_of(
        f"lags of 0.4, 0.16, 2 ms: stable to {values_text(by_hand, 6)} N/m; where passivity "
        "ends, the worst motion needs all of the device's damping",
        f"stable to {values_text(stable, 6)} N/m, apart by {rounded(apart, 1)}; passive to "
        f"{'; '.join(values_text(each, 4) for each in passive)} N/m (spring, wall, Maxwell body); needed share "
        f"of the damping off by {rounded(worst, 1)}",
        "device and torque loop from event to event; the worst of all motions in cells of constant speed",
        tolerance=f"{exactly(AGREEMENT)} of the limits of stability, {exactly(CUT)} of the energies",
        within=[(apart, AGREEMENT), (worst, CUT)],
    )
