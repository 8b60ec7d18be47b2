"""The simulated hand: a mass coupled to the handle by a spring and a damper, with a force acting on the mass.

Theory: the force consists of pieces, each a ramp or a constant (f' = g, g' = 0) or a sine (g' = −ω²·f). So hand and
handle are a linear system between the instants at which a piece begins. The hand's clock starts at each *operation
enabled*; while the drive is off, the hand holds the handle without force, or another hand moves the handle (`LEADER`).
Force is positive towards positive positions of the workspace.

On a linear mechanism, hand and handle move in metres. On a rotary one the hand holds a lever of 0.05 m, so that 1 N is
0.05 N·m: mass, damper and spring act through the same lever.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Real

from haptic_fieldbus.documents.own_parts import entry_point_names, foreign_part
from haptic_fieldbus.drive.rig import LinearMechanism, RotaryMechanism
from haptic_fieldbus.errors import UsageError

LEVER = 0.05
"""Distance between the hand and the axis of a rotary handle [m]."""


@dataclass(frozen=True)
class Piece:
    """A piece of the force, from `start` [s] on: force [N] and slope [N/s] at its start."""

    start: float
    force: float
    slope: float = 0.0


@dataclass(frozen=True)
class Hand:
    """A hand in SI units at the point where it holds the handle: N, m, kg, N·s/m, N/m."""

    name: str
    pieces: tuple[Piece, ...] = ()
    angular_frequency: float = 0.0
    """Angular frequency of a sine [rad/s]; 0: ramps and constants."""
    release: float | None = None
    """Time at which the hand lets go [s]; None: never."""
    mass: float = 0.1
    damping: float = 4.0
    stiffness: float = 300.0

    def letting_go(self, at: float) -> "Hand":
        """Return the same hand that lets go at `at` [s] at the latest."""
        return replace(self, release=at if self.release is None else min(self.release, at))

    def hitting(self, at: float, force: float, duration: float) -> "Hand":
        """Return the same hand with an additional blow of `force` [N] for `duration` [s]; a sine carries it along."""
        end = at + duration
        before = tuple(piece for piece in self.pieces if piece.start < at)
        during = tuple(replace(piece, force=piece.force + force) for piece in self.pieces if at < piece.start < end)
        after = tuple(piece for piece in self.pieces if piece.start > end)
        begun, ended = self._at(at), self._at(end)
        return replace(self, pieces=(*before, replace(begun, force=begun.force + force), *during, ended, *after))

    def _at(self, time: float) -> Piece:
        """Return the force and its slope at a time [s], as a piece that begins then."""
        piece = next((each for each in reversed(self.pieces) if each.start <= time), Piece(time, 0.0))
        passed, omega = time - piece.start, self.angular_frequency
        if not omega:
            return Piece(time, piece.force + piece.slope * passed, piece.slope)
        cosine, sine = math.cos(omega * passed), math.sin(omega * passed)
        force = piece.force * cosine + piece.slope / omega * sine
        return Piece(time, force, piece.slope * cosine - piece.force * omega * sine)

    def after(self, delay: float) -> "Hand":
        """Return the same hand with all times shifted by `delay` [s]."""
        pieces = tuple(replace(piece, start=piece.start + delay) for piece in self.pieces)
        return replace(self, pieces=pieces, release=None if self.release is None else self.release + delay)


@dataclass(frozen=True)
class Grip:
    """A hand as it acts on the motor shaft: kg·m², N·m·s/rad, N·m/rad; pieces in N·m."""

    inertia: float
    damping: float
    stiffness: float
    angular_frequency: float = 0.0
    pieces: tuple[Piece, ...] = ()
    release: float | None = None


_PUSH = (Piece(0.0, 0.0, 12.0), Piece(0.5, 6.0))
# Rounded, because sums such as 1.5 + 0.05 are not exact.
_PULSES = tuple(
    piece for start in (0.5, 1.5, 2.5) for piece in (Piece(start, 10.0), Piece(round(start + 0.05, 9), 0.0))
)
_SINE = 2 * math.pi
_STROKE, _ARM = 0.06, 1000.0
"""Stroke [m] and mass [kg] of a leading hand; the large mass keeps the handle from deflecting it."""


def _leading(name: str, frequency: float) -> Hand:
    """Return a hand that moves over its stroke and back at a frequency [Hz], x = ½·stroke·(1 − cos ωt)."""
    omega = 2 * math.pi * frequency
    # The force that moves its mass in this way: ½·mass·stroke·ω² at t = 0, a cosine from there.
    return Hand(name, (Piece(0.0, 0.5 * _ARM * _STROKE * omega**2),), angular_frequency=omega, mass=_ARM)


HANDS: dict[str, Hand | None] = {
    "push": Hand("push", _PUSH),
    "tap": Hand("tap", _PULSES),
    "sine": Hand("sine", (Piece(0.0, 0.0, 4.0 * _SINE),), angular_frequency=_SINE),
    "guide": _leading("guide", 0.25),
    "shake": _leading("shake", 1.0),
    "release": Hand("release", _PUSH, release=2.0),
    "none": None,
}


_STEADY = 1e5
"""Mass of a resting hand, large enough that friction does not move it [kg]."""


def _to_and_fro(takes: float) -> Hand:
    """Return a hand that rests, moves over its stroke, rests, and moves back; each takes the same time [s]."""
    # Half a cosine of force moves a mass from rest to rest: x = ½·stroke·(1 − cos ωt).
    omega = math.pi / takes
    force = 0.5 * _STEADY * _STROKE * omega**2
    pieces = tuple(Piece(takes * number, each) for number, each in enumerate((force, 0.0, -force, 0.0), start=1))
    return Hand("leader", pieces, angular_frequency=omega, mass=_STEADY, damping=60.0, stiffness=3000.0)


LEADER = _to_and_fro(2.0)
"""Hand that moves the handle of a drive that is off, where a person would.

So `watch` shows changing values, and the direction of an axis can be shown; the stroke is long enough for five axes one
after the other. The motion begins again with a rest when the master begins or ends an exchange, so the handle rests
while the drive is enabled.
"""
LEADING_NS = 8_000_000_000
"""Time after which that hand repeats itself."""


GROUP = "haptic_fieldbus.hands"
"""Entry points of other packages; each names a `Hand`."""


QUICKEST = 1e9
"""Largest rate of a motion that can be simulated [1/s]."""


def hand_faults(hand: Hand) -> Iterator[str]:
    """Yield each reason why a hand cannot be simulated."""
    if not isinstance(hand.name, str) or not hand.name or HANDS.get(hand.name, hand) != hand:
        yield f"name is {hand.name!r}; expected a text that no shipped hand has"
    pieces = hand.pieces if isinstance(hand.pieces, Sequence) else (hand.pieces,)
    if strange := [each for each in pieces if not isinstance(each, Piece)]:
        yield f"pieces has {strange[0]!r}; expected objects of Piece"
        return
    for part in (hand, *pieces):
        for name, value in vars(part).items():
            if name not in ("name", "pieces") and not (
                isinstance(value, Real) or (value is None and name == "release")
            ):
                yield f"{name} is {value!r}; expected a number"
                return
    for name, zero in (("mass", False), ("stiffness", False), ("damping", True), ("angular_frequency", True)):
        value = getattr(hand, name)
        if not (math.isfinite(value) and (value > 0.0 or (zero and value == 0.0))):
            yield f"{name} is {value}; expected a finite number {'from 0 up' if zero else 'above 0'}"
    if hand.mass > 0.0 and not max(hand.damping / hand.mass, math.sqrt(abs(hand.stiffness) / hand.mass)) <= QUICKEST:
        yield f"mass is {hand.mass}; expected more: with damping and stiffness it moves at more than {QUICKEST:g} 1/s"
    starts = [piece.start for piece in hand.pieces]
    if starts != sorted(set(starts)) or any(start < 0.0 for start in starts):
        yield f"its pieces start at {starts} s; expected times from 0 up, each later than the one before"
    if not all(math.isfinite(value) for piece in hand.pieces for value in vars(piece).values()):
        yield "a piece has a start, force or slope that is not a finite number"
    if hand.release is not None and not hand.release >= 0.0:
        yield f"release is {hand.release} s; expected a time from 0 up, or None"


def hand_named(name: str) -> Hand | None:
    """Return the hand of this name, None for `none`; raises UsageError for an unknown name."""
    if name in HANDS:
        return HANDS[name]
    if (own := foreign_part(GROUP, "hand", name, Hand, HANDS, hand_faults)) is None:
        raise UsageError(f'no hand "{name}"; hands are: {", ".join([*HANDS, *entry_point_names(GROUP)])}')
    return own


def grip(hand: Hand, mechanism: LinearMechanism | RotaryMechanism) -> Grip:
    """Return the hand as seen through the mechanism: forces scale with the ratio, impedances with its square."""
    lever = mechanism.ratio * (LEVER if isinstance(mechanism, RotaryMechanism) else 1.0)
    signed = lever * mechanism.sign
    return Grip(
        # Work is the same at both ends of the lever: force times lever is torque, and lengths divide by the lever.
        inertia=hand.mass * lever**2,
        damping=hand.damping * lever**2,
        stiffness=hand.stiffness * lever**2,
        angular_frequency=hand.angular_frequency,
        pieces=tuple(Piece(piece.start, piece.force * signed, piece.slope * signed) for piece in hand.pieces),
        release=hand.release,
    )
