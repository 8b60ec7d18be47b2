"""Taps against a contact, the growth of its own oscillation, and the certificate that rests on them.

Theory. A handle that is pressed into a wall of the stiffness K by a constant effort P, both of the same motor, rests
P/K inside it, where the motor gives nothing. It swings about this place as on a spring, and stays in contact while its
swing is below P/K. A tap lowers the effort until the handle turns, and restores it. The handle then swings freely.

Growth is the ratio of a swing, from one turning point to the next, to the swing one period before. Viscous damping and
delay multiply the swing, and near the onset of instability the ratio goes to 1. Coulomb friction takes the same way of
each swing, so the ratio that is seen is below that of the linear contact. Therefore the onset is not extrapolated from
the growth alone: the shaft model, with friction in it, is fitted to all taps (`fit`), and the onset is that of the
scene on the fitted shaft.

All quantities are in the workspace of the axis: m, N and kg, or rad, N·m and kg·m².
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import takewhile

from haptic_fieldbus.identification.estimates import Estimate
from haptic_fieldbus.identification.experiment import Bounds, ExperimentError, GuidedMotion, Stage
from haptic_fieldbus.identification.shaft import ShaftRecord
from haptic_fieldbus.numerals import OutputRow, in_unit, rounded, with_interval

TAPS = 2
"""Taps at each stiffness."""
LOWERED = 0.45
"""Share of the effort that a tap takes away; the swing is twice this share, so that contact stays."""
RAMP_TIME = 1.0
"""Time in which the effort rises, and falls at the end [s]."""
STILL_TIME, STILL_PERIODS, STILL_COUNTS, STILL_SHARE = 0.12, 8, 2.0, 0.25
"""A handle is at rest that moved for this time [s], or these periods, by at most so many counts, or by this share of
the smallest swing that is judged."""
LISTENING = 5.0
"""Longest time of the swings after a tap [s]."""
FIRST_COUNTS, FIRST_STEPS = 16.0, 10.0
"""Smallest swing beside which a later one is judged: in counts, and in steps of the drive's torque."""
TURN_COUNTS = 3.0
"""Way back that shows a turning point [counts]."""
GIVES_WAY = 2.0
"""Depth of the pressed handle, as a multiple of that at the stiffness, from which on the contact has given way."""
GAVE_WAY = "the contact gave way to the press: it is softer than its stiffness says, or its force has an end"
FINGER, LET_GO = 4, 2
"""Swings in a row that a tap by hand lets grow, two as it pushes and two as it lets go; and the first ones that decay,
which are beside swings with the finger."""
GENTLY = {"shortest": 0.3, "share": 0.4}
"""How the handle is led to the contact and back: shortest time [s], and share of the largest speed."""
NEAR = 0.9
"""Share of the lower end of the onset above which friction, and not damping, may have stopped the swings."""
BEFORE = "an oscillation before"
"""Which swing another one is compared with: to the same side, one period of the oscillation earlier."""
WELL_DAMPED = 0.9
"""Largest growth per period of a contact that is called well damped."""
AGREES = 0.05
"""Largest distance of the predicted onset from the interval of the onset, as a share, that is no contradiction: the
values of a rig have intervals too."""


class Swings:
    """Turning points of a motion, and the growth of its swings."""

    def __init__(self, resolution: float, least: float, begin: float | None = None) -> None:
        self.turns: list[float] = [] if begin is None else [begin]
        """Turning points; the motion may have begun at one."""
        self._turn, self._least = max(TURN_COUNTS * resolution, STILL_SHARE * least), least
        self._side, self._extreme = 0.0, math.nan

    def take(self, place: float) -> float | None:
        """Take a position; return the growth per period when it shows a turning point that completes one, else None."""
        if not self._side:
            self._extreme = place if math.isnan(self._extreme) else self._extreme
            if abs(place - self._extreme) >= self._turn:
                self._side, self._extreme = math.copysign(1.0, place - self._extreme), place
            return None
        if self._side * (self._extreme - place) < self._turn:
            self._extreme = max(self._extreme, place, key=lambda each: self._side * each)
            return None
        self.turns.append(self._extreme)
        self._side, self._extreme = -self._side, place
        if len(self.turns) < 4:
            return None
        before, after = abs(self.turns[-3] - self.turns[-4]), abs(self.turns[-1] - self.turns[-2])
        return after / before if before >= self._least else None

    @property
    def is_large(self) -> bool:
        """Whether the first swing is large enough to judge a later one."""
        return bool(self.turns) and abs([*self.turns, self._extreme][1] - self.turns[0]) >= self._least


class Tapping(GuidedMotion):
    """Press the handle into the contact of a scene, tap it, and lead it back to where it was."""

    growth: float | None = None
    """Largest growth per period so far; None while no swing was large enough."""
    rests = False
    """Whether the handle is at rest."""
    periods = 0
    """Periods since the press began."""

    def __init__(
        self, bounds: Bounds, mass: float, friction: float, delay: float, *, surface: float, press: float,
        stiffness: float, least: float, by_hand: bool = False,
    ) -> None:  # fmt: skip
        """Begin; a positive `press` [N or N·m] pushes towards positive positions, from the place `surface` on.

        `stiffness` [N/m or N·m/rad] is that against a constant push. `least` is the smallest swing beside which a later
        one is judged. A person who taps `by_hand` has the time of all taps.
        """
        super().__init__(bounds, mass, friction, 0.0, delay)
        self.surface, self.press, self.least, self.by_hand = surface, press, least, by_hand
        self._deepest = GIVES_WAY * (abs(press) + friction) / stiffness + STILL_COUNTS * bounds.resolution
        self.stage, self._present = "surface", 0.0

    def effort(self, position: float) -> float:
        """Return the present effort, however often it is asked for."""
        return self._present

    def advance(self, position: float) -> None:
        """Go on to the next period."""
        self.periods += self.stage != "surface"
        self._present, self.armed = super().effort(position), True

    def _course(self) -> Stage:
        begin = self.place
        yield from self._lead(self.surface, **GENTLY)
        self.stage = "press"
        yield from self._ramp(0.0, self.press)
        yield from self._listen()
        if math.copysign(1.0, self.press) * (self.place - self.surface) > self._deepest:
            raise ExperimentError(GAVE_WAY)
        self.stage = "tap"
        if self.by_hand:
            yield from self._listen(TAPS * LISTENING)
        for _ in range(0 if self.by_hand else TAPS):
            if self.rests:  # one that still swings tells enough
                yield from self._tap()
        self.stage = "back"
        yield from self._ramp(self.press, 0.0)
        yield from self._lead(begin, **GENTLY)

    @property
    def grew(self) -> bool:
        """Whether a swing was as large as the one a period before."""
        return self.growth is not None and self.growth >= 1.0

    def _ramp(self, begin: float, end: float) -> Stage:
        for k in range(count := max(1, round(RAMP_TIME / self.bounds.period))):
            yield begin + 0.5 * (end - begin) * (1.0 - math.cos(math.pi * k / count))

    def _tap(self) -> Stage:
        """Lower the effort until the handle turns or rests, restore it, and listen."""
        lowered = Swings(self.bounds.resolution, self.least)
        for _ in self._until_rest():
            lowered.take(self.place)
            if lowered.turns:
                break
            yield (1.0 - LOWERED) * self.press
        yield from self._listen(begin=[*lowered.turns, self.place][0])

    def _listen(self, least: float = 0.0, begin: float | None = None) -> Stage:
        """Press until the handle is at rest, for `least` [s] at least; raises ExperimentError when a swing grows.

        The motion may have begun at the turning point `begin`.
        """
        swings, grown, decays = Swings(self.bounds.resolution, self.least, begin), 0, list[float]()
        for _ in self._until_rest(least):
            growth = swings.take(self.place)
            if growth is not None:
                grown, decays = (grown + 1, []) if growth >= 1.0 else (0, [*decays, growth])
                if grown > (FINGER if self.by_hand else 0):
                    self.growth = growth
                    raise ExperimentError(f"a swing was {rounded(growth)} times as large as the one a period before")
            if self.rests:  # the next tap by hand has swings of its own
                self._keep(swings, decays)
                swings.turns.clear()
                grown, decays = 0, []
            yield self.press
        self._keep(swings, decays)

    def _keep(self, swings: Swings, decays: list[float]) -> None:
        """Keep the largest growth of the swings of a tap; of one by hand, those after the finger has gone."""
        free = decays[LET_GO:] or decays[-1:] if self.by_hand else decays
        if free or swings.is_large:
            self.growth = max([self.growth or 0.0, *free])

    def _until_rest(self, least: float = 0.0) -> Iterator[None]:
        """Yield once a period until the handle is at rest, for `least` [s] at least."""
        period, still, anchor = self.bounds.period, 0, self.place
        moved = max(STILL_COUNTS * self.bounds.resolution, STILL_SHARE * self.least)
        self.rests, resting = False, max(STILL_PERIODS, round(STILL_TIME / period))
        for number in range(round(max(LISTENING, least) / period)):
            still += 1
            if abs(self.place - anchor) > moved:
                still, anchor = 0, self.place
            self.rests = still >= resting
            if self.rests and number >= round(least / period):
                return
            yield


@dataclass(frozen=True)
class TappedContact:
    """One stiffness of a certificate, and how the contact swung."""

    stiffness: float
    """[N/m or N·m/rad]"""
    growth: float | None
    """Largest growth per period that was seen; 0: no second swing; None: no swing was large enough."""
    by_hand: bool
    record: ShaftRecord = field(repr=False)

    def text(self, unit: str) -> str:
        """Return the stiffness and its growth in words."""
        none = "no swing was large enough" if self.growth is None else "no second swing"
        growth = f"each swing at most {rounded(self.growth)} of the one {BEFORE}" if self.growth else none
        return f"{in_unit(self.stiffness, unit)}: {growth}, {'taps by hand' if self.by_hand else f'{TAPS} pulses'}"

    @property
    def is_well_damped(self) -> bool:
        """Whether swings were seen, and each was well below the one a period before."""
        return self.growth is not None and self.growth <= WELL_DAMPED


@dataclass(frozen=True)
class Certificate:
    """Result of taps on a scene and its bench."""

    scene: str
    element: str
    """Element whose stiffness was raised."""
    unit: str
    """Of the stiffness."""
    limit: float
    predicted: float
    """Onset of instability at the values of rig and profile; infinite for a contact that is always stable."""
    contacts: tuple[TappedContact, ...]
    onset: Estimate | None
    """Onset that follows from the taps; None when no pulse told it."""
    ended: str
    """Why no higher stiffness was tried."""
    bench: dict[str, object]
    """Rig, drive and bus, as in JSON."""
    date: str

    @property
    def seen(self) -> float | None:
        """Largest stiffness that was well damped, as all below it that swung; None when there is none."""
        swung = (each for each in self.contacts if each.growth is not None)
        return max((each.stiffness for each in takewhile(lambda each: each.is_well_damped, swung)), default=None)

    @property
    def contradiction(self) -> str:
        """Sentence about a predicted onset outside of the interval by more than `AGREES`; empty without one."""
        found, share = self.onset, AGREES * self.predicted
        if found is None or found.low - share <= self.predicted <= found.high + share:
            return ""
        side = "below" if found.high < self.predicted else "above"
        bench = "the bench is not the one that the rig describes; measure it with haptic-fieldbus identify"
        return f"the onset is {side} the predicted {in_unit(self.predicted, self.unit)}: {bench}"

    @property
    def nearness(self) -> str:
        """Sentence about a stiffness that was seen damped and is near the onset or above it; empty without one."""
        if self.onset is None or self.seen is None or self.seen <= NEAR * self.onset.low:
            return ""
        seen, low = (in_unit(each, self.unit) for each in (self.seen, self.onset.low))
        return f"{seen} is near or above an onset of {low}: friction stopped its swings, and larger ones may grow"

    def rows(self) -> Iterator[OutputRow]:
        """Yield what text, JSON and picture show."""
        found, unit, told, seen = self.onset, self.unit, self.bench, self.seen
        numbers = "".join(f", {key} {told[key]}" for key in ("serial", "firmware") if told[key] is not None)
        yield OutputRow("drive", [f"{told['drive']}{numbers}, {told['bus']} at {told['rate_hz']:g} Hz"])
        yield OutputRow("rig", [f"{told['rig'] or 'shipped bench'}, values {told['basis']}"], "bench", told)
        yield OutputRow("date", [self.date], "date", self.date)
        yield OutputRow("contact", [f"{self.element} of the scene {self.scene}"], "scene", self.scene)
        yield OutputRow("tapped", [each.text(unit) for each in self.contacts], detail=True)
        text = "no stiffness" if seen is None else in_unit(seen, unit)
        damped = f"each swing at most {WELL_DAMPED} of the one {BEFORE}"
        yield OutputRow("seen", [f"{text} well damped ({damped})"], "seen", seen)
        text, onset = "not told by these taps", None
        if found is not None:
            ends = {"value": found.value, "low": found.low, "high": found.high}
            onset = {key: value if math.isfinite(value) else None for key, value in ends.items()}
            interval = with_interval(found.value, found.low, found.high, unit)
            text = "; ".join(filter(None, [f"{interval}, extrapolated", found.reason]))
        yield OutputRow("onset", [text], "onset", onset)
        yield OutputRow("predicted", [f"onset {in_unit(self.predicted, unit)}"], "predicted", self.predicted)
        yield OutputRow("limit", [in_unit(self.limit, unit)], "limit", self.limit)
        yield OutputRow("ended by", [self.ended], "ended", self.ended)
        yield OutputRow("warning", filter(None, [self.contradiction, self.nearness]), "unit", unit)
        keys = ("stiffness", "growth", "by_hand")
        tapped = [{key: getattr(each, key) for key in keys} for each in self.contacts]
        yield OutputRow(key="contacts", value=tapped)
