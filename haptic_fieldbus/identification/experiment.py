"""The two experiments that measure a bench, each a law of effort over position with stages.

`Probe` knows nothing of the bench, and its record gives a first model; `GuidedMotion` is led by that model:

- *rest*: no effort. The position must stay where it is: a load that falls when it is free is not measured.
- *breakaway*: the effort rises slowly until the handle moves, and then stops it; both ways, twice.
- *pulse*: an effort above the breakaway pushes the handle until it has a speed or has gone a way, and its opposite
  stops it. Pushes that are too short are repeated with less effort, too weak ones with more.
- *motion*: the handle is led to and fro through the travel, and small oscillations ride on this slow motion, so that
  friction mostly keeps its direction. The model gives the effort against friction and damping; a slow feedback keeps
  the handle on its way.
- *check*: the same with other oscillations; this part of the record is predicted and not used in the fit.

Every stage stays inside `Bounds`. A handle that is about to leave them, or is too fast, ends the experiment, and there
is no effort from then on. The limits of the run, which trip, lie where the bounds end.

All quantities are in the workspace of the axis: m, N and kg, or rad, N·m and kg·m².
"""

import cmath
import math
from collections import defaultdict
from collections.abc import Collection, Generator, Iterator
from dataclasses import dataclass

REST_TIME = 0.4
"""Time without effort [s]."""
PARTS = ("rest", "friction", "dynamics")
"""Parts that can be left out: the stage of that name, the breakaway, and everything after it."""
DIRECTIONS = {"forward": 1, "backward": -1}
RAMP_TIME = 1.5
"""Time in which the effort of the breakaway rises to its bound [s]."""
MOVED_COUNTS, FEWEST_COUNTS = 6.0, 12.0
"""Smallest way that counts as motion, and that tells an inertia [counts]."""
STILL_COUNTS, SEEN_AFTER, SEEN_LATE = 1.5, 3.0, 8
"""When a motion began, from when it was seen: the way that is no motion yet [counts]; how long it may have gone on by
then, as a multiple of the time from then until `MOVED_COUNTS`; and the delay [periods]. Under an effort that rises, the
way of an inertia grows with the cube of the time. The two ways may be as near as 2 and 5 counts, and then it took 2.8
times as long to the first as from there to the second."""
SETTLING = 0.15
"""Time without effort after a stop [s]."""
LONGEST_PUSH = 0.5
"""[s]"""
FEWEST_PERIODS = 8
"""Shortest push that tells an inertia [periods]."""
FOLLOWING, FOLLOWING_PHASE = 10.0, 0.25
"""Double pole of the feedback of the slow motion [1/s], and its largest product with the age of a speed."""
FASTEST_MOTION = 2.0 * math.pi
"""Largest angular frequency of the slow motion [1/s]."""
MOST_PULSES, GOOD_PULSES = 24, 6
"""Largest number of pulses, and number of those of a good length that are enough."""
FIRST_SHARE, UNKNOWN_SHARE = 0.01, 0.05
"""Effort of the first push beyond the breakaway, where that is known and where it is not, as shares of the bound."""
RAISED, ALIKE = 1.4, 1.1
"""Growth of an effort that was too weak, and the ratio of a strong and a weak one below which they tell nothing of each
other."""
STANDS = 3.0
"""Effort of a push that moves no count, as a multiple of that of the breakaway, at which something holds the handle, or
the encoder does not count: stronger ones would move it unseen."""
STRONGER = 1.3
"""Growth of the effort from one good push to the next; in pushes of one effort, friction may look like inertia."""
SLOW_PUSH, PUSH_SPEED, MOTION_SPEED, RIDING_SPEED = 0.12, 0.25, 0.5, 0.2
"""Least and largest speeds of a push, those of the slow motion and of the oscillations, as shares of the bound."""
RIDING_PEAK = 0.25
"""Largest speed of all oscillations together, as a share of the bound."""
PUSH_WAY, MOTION_WAY = 0.06, 0.3
"""Way of a push and amplitude of the slow motion, as shares of the travel."""
RIDING_EFFORT, MOTION_EFFORT, DAMPED_EFFORT = 0.4, 0.3, 0.4
"""Efforts of the oscillations, and of the slow motion against inertia and damping, as shares of what friction leaves of
the bound."""
AHEAD = 0.05
"""Share of the travel by which a handle may be ahead of its plan; at twice as much nothing is given against friction
and damping, since there is less of them than the first model says."""
LINES = 9
"""Number of frequencies of the oscillations."""
SLOWEST_LINE, FASTEST_LINE = 4.0, 80.0
"""Range of their frequencies [Hz]; at most a fifth of the rate."""
SAMPLES, SHORTEST_MOTION = 4000, 8.0
"""Samples of the motion, and its shortest time [s]."""
CHECK_SHARE = 0.4
"""Length of the check, as a share of that of the motion."""


@dataclass(frozen=True)
class Bounds:
    """Largest motion and effort of an experiment, and the grid of its samples."""

    period: float
    """[s]"""
    resolution: float
    """One encoder count [m or rad]."""
    low: float
    high: float
    """Travel [m or rad]."""
    speed: float
    effort: float
    acceleration: float
    """Acceleration at which the run would trip; infinite without such a limit."""

    @property
    def travel(self) -> float:
        """Return the length of the travel."""
        return self.high - self.low

    @property
    def middle(self) -> float:
        """Return the middle of the travel."""
        return 0.5 * (self.low + self.high)


class ExperimentError(Exception):
    """The experiment cannot go on; the message says why. Its effort is 0."""


Stage = Iterator[float]
"""One stage: it yields the effort of each period."""


class Experiment:
    """A law: `effort(position)` once a period. `stage` is the present one, `done` after the last."""

    def __init__(self, bounds: Bounds) -> None:
        self.bounds = bounds
        self.stage = "rest"
        self.armed = False
        """Whether the law of a run may give effort (`api.identification`). An effort of a period disarms it: what
        analyses a simulated run calls its laws, too."""
        self.done = False
        self.failure = ""
        """Why the experiment ended early; empty if it did not."""
        self.mass = 0.0
        """Mass for the way to stop; 0 while it is unknown."""
        self.place = 0.0
        """Present position."""
        self._places: list[float] = []
        """Last positions, for the speed."""
        self._width = max(3, round(0.01 / bounds.period))
        self._count_speed = bounds.resolution / (self._width * bounds.period)
        """Speed that one count more or less looks like."""
        self._steps = self._all()

    def effort(self, position: float) -> float:
        """Return the effort of this period."""
        self.armed, self.place = False, position
        self._places.append(position)
        del self._places[: -self._width - 1]
        try:
            return next(self._steps)
        except StopIteration:
            self.done = True
        except ExperimentError as error:
            self.failure, self.done = str(error), True
        return 0.0

    @property
    def speed(self) -> float:
        """Return the mean speed over the last 10 ms, or three periods."""
        places = self._places
        return (places[-1] - places[0]) / (max(len(places) - 1, 1) * self.bounds.period)

    def _all(self) -> Stage:
        """Go through the stages."""
        raise NotImplementedError

    # What several stages do.

    def _wait(self, seconds: float) -> Stage:
        for _ in range(max(1, round(seconds / self.bounds.period))):
            yield 0.0

    def _check(self) -> None:
        """Raise ExperimentError when the handle is on its way out of the travel, or too fast."""
        bounds, speed = self.bounds, self.speed
        # One count more or less is no speed; the limits of the run know none of this.
        if abs(speed) > 0.9 * bounds.speed + self._count_speed:
            raise ExperimentError(f"the handle was faster than announced in the stage {self.stage}")
        # The way to stop, by the measured deceleration; before it is known, a tenth of the travel.
        stopping = 0.5 * self.mass * speed * speed / bounds.effort if self.mass else 0.0
        ahead = self.place + math.copysign(stopping, speed)
        if not bounds.low <= ahead <= bounds.high:
            raise ExperimentError(f"the handle would have left the announced travel in the stage {self.stage}")

    def _stop(self, effort: float) -> Generator[float, None, bool]:
        """Stop the handle by the opposite effort, and wait a little; return whether it was at rest meanwhile."""
        side = math.copysign(1.0, self.speed)
        for _ in range(round(LONGEST_PUSH / self.bounds.period)):
            if side * self.speed <= self._count_speed:
                break
            yield -side * effort
        yield from self._wait(0.5 * SETTLING)
        here = self.place
        yield from self._wait(0.5 * SETTLING)
        return abs(self.place - here) < 0.5 * self.bounds.resolution


@dataclass
class _PushEffort:
    """Effort of the pushes in one direction, between one that was too weak and one that was too strong."""

    effort: float
    most: float
    weak: float = 0.0
    strong: float = math.inf

    def lower(self, effort: float) -> None:
        """Take less, after a push that was too strong."""
        self.strong = self.effort
        if ALIKE * self.weak > self.effort:  # friction is another one at another place
            self.weak = 0.0
        self.effort = max(effort, math.sqrt(self.effort * self.weak))

    def increase(self, factor: float) -> None:
        """Take more, after a push that was too weak."""
        self.weak = self.effort
        if self.strong < ALIKE * self.effort:
            self.strong = math.inf
        self.effort = min(self.most, factor * self.effort, math.sqrt(self.effort * self.strong))


class Probe(Experiment):
    """Rest, breakaway and pulses; nothing of the bench is known before. `skipped` names `PARTS` that are left out."""

    def __init__(self, bounds: Bounds, skipped: Collection[str] = ()) -> None:
        super().__init__(bounds)
        self._skipped = skipped
        self.friction = 0.0
        """From the breakaway [N or N·m]; 0 where that is skipped, and the pulses find an effort that moves it."""
        self.breakaway: dict[str, tuple[float, float]] = {}
        """Bounds of the effort at which the handle began to move from rest, by the direction [N or N·m]."""

    def _all(self) -> Stage:
        stages = {"rest": self._rest, "breakaway": self._breakaway, "pulse": self._pulses}
        for part, (stage, steps) in zip(PARTS, stages.items(), strict=True):
            if part not in self._skipped:
                self.stage = stage
                yield from steps()

    def _rest(self) -> Stage:
        here = self.place
        for effort in self._wait(REST_TIME):
            yield effort
            if abs(self.place - here) > max(4.0 * self.bounds.resolution, 0.005 * self.bounds.travel):
                raise ExperimentError(
                    "the handle moves while no effort acts on it: a weight that falls is not measured. Balance it, or "
                    "take the hand away"
                )

    def _breakaway(self) -> Stage:
        efforts, seen = defaultdict[str, list[float]](list), defaultdict[str, list[tuple[float, float]]](list)
        rate, count, at_rest = self.bounds.effort / RAMP_TIME * self.bounds.period, self.bounds.resolution, True
        for name, side in (*DIRECTIONS.items(), *DIRECTIONS.items()):
            here, effort, moved = self.place, 0.0, 0
            while (way := side * (self.place - here)) < MOVED_COUNTS * count:
                moved += way > STILL_COUNTS * count
                effort += rate
                if effort > self.bounds.effort:
                    raise ExperimentError(
                        "nothing moved up to the announced effort: release the handle or the brake, or raise --effort"
                    )
                yield side * effort
                self._check()
            efforts[name].append(effort)
            if at_rest:
                seen[name].append((max(effort - rate * ((1.0 + SEEN_AFTER) * moved + SEEN_LATE), 0.0), effort))
            at_rest = yield from self._stop(effort)
        self.friction = 0.5 * sum(min(each) for each in efforts.values())
        for name, intervals in seen.items():
            lows, highs = zip(*intervals, strict=True)
            # What holds for both pushes, or for one of them where friction has changed meanwhile.
            agreed = max(lows) <= min(highs)
            self.breakaway[name] = (max(lows), min(highs)) if agreed else (min(lows), max(highs))

    def _pulses(self) -> Stage:
        """Push and stop the handle both ways, with efforts that give pushes of a good length.

        The first effort is near that of the breakaway: how fast a stronger push would be, weaker ones tell.
        """
        bounds, good = self.bounds, 0
        beyond = FIRST_SHARE if self.friction else UNKNOWN_SHARE
        first = min(0.5 * bounds.effort, self.friction + beyond * bounds.effort)
        slowest = 1.05 * self.friction or math.inf  # of an unknown friction, less effort moves nothing
        ways = {side: _PushEffort(first, 0.8 * bounds.effort) for side in (1, -1)}
        for _ in range(MOST_PULSES):
            begin, side = self.place, 1 if self.place < bounds.middle else -1
            way = ways[side]
            pushed, fastest = yield from self._push(side, way.effort)
            if self.place == begin and pushed >= LONGEST_PUSH and 0.0 < STANDS * self.friction < way.effort:
                raise ExperimentError(
                    "the encoder did not move under a push much above the effort that moved the handle before: keep "
                    "hands off, and check encoder and brake"
                )
            is_short = abs(self.place - begin) < FEWEST_COUNTS * bounds.resolution
            if pushed < FEWEST_PERIODS * bounds.period:
                way.lower(way.effort / RAISED)
            elif pushed >= LONGEST_PUSH and (is_short or fastest < SLOW_PUSH * bounds.speed) and way.effort < way.most:
                way.increase(RAISED)
            elif pushed < LONGEST_PUSH and is_short and way.effort > slowest:
                way.lower(max(0.8 * way.effort, slowest))
            else:
                good += 1
                if pushed >= 2 * FEWEST_PERIODS * bounds.period and STRONGER * way.effort < way.strong:
                    way.effort = min(way.most, STRONGER * way.effort)
            if good == GOOD_PULSES:
                return
        raise ExperimentError("no push was of a length that tells an inertia: the handle moved too little or too fast")

    def _push(self, side: int, effort: float) -> Generator[float, None, tuple[float, float]]:
        """Push and stop; return the time of the push [s], and the largest speed in it."""
        bounds, here, pushed, fastest = self.bounds, self.place, 0, 0.0
        while (
            side * (self.place - here) < PUSH_WAY * bounds.travel
            and fastest < PUSH_SPEED * bounds.speed
            and pushed * bounds.period < LONGEST_PUSH
        ):
            yield side * effort
            pushed, fastest = pushed + 1, max(fastest, side * self.speed)
            self._check()
        yield from self._stop(effort)
        return pushed * bounds.period, fastest


class GuidedMotion(Experiment):
    """Slow motion with oscillations on it, led by a first model of the bench in its workspace."""

    def __init__(
        self, bounds: Bounds, mass: float, friction: float, load: float, delay: float, damping: float = 0.0
    ) -> None:
        super().__init__(bounds)
        self.stage, self.mass, self._friction, self._load, self._damping = "middle", mass, friction, load, damping
        self._planned = (0.0, 0.0)
        """Planned position and speed of the last period."""
        # The mean speed is half its width old; the loop keeps a phase margin of 60° for all of it.
        late = delay + (0.5 + 0.5 * self._width) * bounds.period
        self._following = min(FOLLOWING, FOLLOWING_PHASE / late)
        self._time = max(SHORTEST_MOTION, SAMPLES * bounds.period)
        self._riding = self._lines(0), self._lines(1)

    def _all(self) -> Stage:
        for effort in self._course():
            yield effort
            self._check()

    def _course(self) -> Stage:
        """Go through the stages; what stands after a `yield` has a position that was checked."""
        yield from self._lead(self.bounds.middle, shortest=0.5, share=0.5)
        self.stage = "motion"
        yield from self._motion(0, self._time)
        self.stage = "check"
        yield from self._motion(1, CHECK_SHARE * self._time)
        self.stage = "stop"
        yield from self._halt()

    def _lead(self, goal: float, shortest: float, share: float) -> Stage:
        """Lead the handle to a place and stop there: in `shortest` [s] at least, by a `share` of the largest speed."""
        begin, way, bounds = self.place, goal - self.place, self.bounds
        fastest = math.pi * abs(way) / (share * bounds.speed)
        time = max(shortest, fastest, 5.0 * math.sqrt(abs(way) / self._acceleration))
        half, rate, count = 0.5 * way, math.pi / time, round(time / bounds.period)
        for k in range(count):
            sine, cosine = math.sin(math.pi * k / count), math.cos(math.pi * k / count)
            yield self._led(begin + half * (1.0 - cosine), half * rate * sine, half * rate * rate * cosine)

    def _halt(self) -> Stage:
        """Bring the handle to rest where it is going, from its planned motion: the speed of few counts is unsure."""
        (begin, speed), time = self._planned, 0.3
        for k in range(round(time / self.bounds.period)):
            left = 1.0 - k * self.bounds.period / time
            yield self._led(begin + 0.5 * speed * time * (1.0 - left * left), speed * left, -speed / time)

    @property
    def _free(self) -> float:
        """Return the effort that friction and load leave."""
        return max(self.bounds.effort - self._friction - abs(self._load), 0.1 * self.bounds.effort)

    @property
    def _acceleration(self) -> float:
        """Return the largest acceleration that is planned."""
        return min(self._free / self.mass, 0.4 * self.bounds.acceleration)

    def _led(self, place: float, speed: float, acceleration: float, riding: float = 0.0) -> float:
        """Return the effort that leads the handle along, within the bound."""
        bounds, self._planned = self.bounds, (place, speed)
        rate = self._following
        behind = rate * rate * (place - self.place) + 2.0 * rate * (speed - self.speed)
        against = self._friction * max(-1.0, min(1.0, speed / (0.02 * bounds.speed)))
        ahead = math.copysign(1.0, speed) * (self.place - place) / (AHEAD * bounds.travel)
        pushed = max(0.0, min(1.0, 2.0 - ahead)) * (against + self._damping * speed)
        effort = self.mass * (acceleration + behind) + pushed - self._load + riding
        return max(-bounds.effort, min(bounds.effort, effort))

    def _motion(self, number: int, time: float) -> Stage:
        """Lead the handle to and fro, with oscillations on it; `number` chooses their phases."""
        bounds, begin, (amplitude, rate) = self.bounds, self.place, self._slow_motion()
        for k in range(round(time / bounds.period)):
            t = k * bounds.period
            rise = min(1.0, t * rate / math.pi)  # it begins gently, where the handle is
            sine, cosine = rise * amplitude * math.sin(rate * t), rise * amplitude * math.cos(rate * t)
            place = bounds.middle + (begin - bounds.middle) * (1.0 - rise) + sine
            riding = sum(effort * math.sin(turning * t + phase) for turning, effort, phase in self._riding[number])
            yield self._led(place, rate * cosine, -rate * rate * sine, rise * riding)

    def _slow_motion(self) -> tuple[float, float]:
        """Return amplitude and angular frequency of the slow motion."""
        amplitude, strongest = MOTION_WAY * self.bounds.travel, MOTION_EFFORT * self._acceleration
        damped = DAMPED_EFFORT * self._free / self._damping if self._damping else math.inf
        fastest = min(MOTION_SPEED * self.bounds.speed, damped) / amplitude
        return amplitude, min(fastest, math.sqrt(strongest / amplitude), FASTEST_MOTION)

    def _lines(self, number: int) -> list[tuple[float, float, float]]:
        """Return angular frequency [1/s], effort and phase of each oscillation."""
        bounds, (amplitude, rate) = self.bounds, self._slow_motion()
        fastest = min(FASTEST_LINE, 0.2 / bounds.period)
        slowest = min(SLOWEST_LINE, 0.3 * fastest)
        effort = RIDING_EFFORT * self._acceleration * self.mass / math.sqrt(LINES)
        # Together slower than the slow motion, so that friction mostly keeps its direction.
        most = min(RIDING_SPEED * bounds.speed, 0.7 * amplitude * rate) / math.sqrt(LINES)
        lines, moved = [], []
        for line in range(LINES):
            turning = math.tau * slowest * (fastest / slowest) ** (line / (LINES - 1))
            phase = math.pi * line * (line + number) / LINES  # of Schroeder
            opposing = complex(self._damping, self.mass * turning)
            size = min(effort, most * abs(opposing))
            lines.append((turning, size, phase))
            moved.append((turning, size / abs(opposing), phase - cmath.phase(opposing)))
        # How far the oscillations agree is known from their sum alone.
        times = [step / (8.0 * fastest) for step in range(round(8.0 * fastest * self._time))]
        speeds = [sum(size * math.sin(turning * t + phase) for turning, size, phase in moved) for t in times]
        calm = min(1.0, RIDING_PEAK * bounds.speed / max(map(abs, speeds)))
        return [(turning, calm * size, phase) for turning, size, phase in lines]
