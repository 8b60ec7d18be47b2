"""A body of two states that is linear outside a surface and linear inside it, stepped exactly, crossings included.

In each of its two modes a period is exact for inputs on a straight line (`exact.foh`). The body is inside when its
first state, measured from the surface, is above 0. When the body is on the other side at the end of a period, the
instant of crossing is searched by halving the period N times. A half in which the body stays on its side is stepped; a
half in which it crosses is halved again. From the last of these halves on, the other mode has the rest of the period.

Modes therefore change at most 2⁻ᴺ of a period too early. With N = 10, a spring K at the surface creates at most the
energy K·(v·T/1024)²/2 by this. A visit that begins and ends within one period is not noticed, and creates no energy.
"""

from collections.abc import Callable

from haptic_fieldbus.numerics.linear import StateSpace, foh

HALVINGS = 10
"""Number N of halvings."""

Pair = tuple[float, float]
Advance = Callable[[float, float, Pair, Pair], Pair]
"""Step from (first state, second state, inputs of the last sample, inputs of this sample) to the states now."""
_Rows = tuple[tuple[float, ...], tuple[float, ...]]
_SIZES = [0.5**number for number in range(1, HALVINGS + 1)]


def bind_switched(outside: StateSpace, inside: StateSpace, period: float) -> Advance:
    """Return a step of one period [s] that switches between two systems, each of two states and two inputs."""
    # Maps for a whole period and for each of its halves are made once; the mode, False or True, is their index.
    whole = [_rows(space, period) for space in (outside, inside)]
    parts = [[_rows(space, period * size) for size in _SIZES] for space in (outside, inside)]

    def advance(first: float, second: float, before: Pair, now: Pair) -> Pair:
        mode = first > 0.0
        end = _moved(whole[mode], (first, second, *before, *now))
        return end if (end[0] > 0.0) == mode else cross(first, second, before, now)

    def cross(first: float, second: float, before: Pair, now: Pair) -> Pair:
        mode, time, left = first > 0.0, 0.0, []
        for number, size in enumerate(_SIZES):
            inputs = (*_between(before, now, time), *_between(before, now, time + size))
            tried = _moved(parts[mode][number], (first, second, *inputs))
            if (tried[0] > 0.0) == mode:
                (first, second), time = tried, time + size
            else:
                left.append(number)
        # The parts in which the body would have crossed, and the smallest part again: together the rest of the period.
        for number in (*left, HALVINGS - 1):
            end = time + _SIZES[number]
            inputs = (*_between(before, now, time), *_between(before, now, end))
            (first, second), time = _moved(parts[not mode][number], (first, second, *inputs)), end
        return first, second

    return advance


def bind_linear(space: StateSpace, period: float) -> Advance:
    """Return a step of one period [s] of a single system of two states and two inputs, without a surface."""
    rows = _rows(space, period)
    return lambda first, second, before, now: _moved(rows, (first, second, *before, *now))


def _rows(space: StateSpace, step: float) -> _Rows:
    decay, early, late = foh(space.a, space.b, step)
    first, second = ([*decay[row], *early[row], *late[row]] for row in (0, 1))
    return tuple(map(float, first)), tuple(map(float, second))


def _moved(rows: _Rows, known: tuple[float, ...]) -> Pair:
    first, second = rows
    return sum(map(float.__mul__, first, known)), sum(map(float.__mul__, second, known))


def _between(before: Pair, now: Pair, time: float) -> Pair:
    return before[0] + time * (now[0] - before[0]), before[1] + time * (now[1] - before[1])
