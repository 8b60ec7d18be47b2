"""Two states of a body that is linear outside a surface and linear inside it, stepped exactly, crossings included.

In each of its two modes a period is exact for inputs on a straight line (`exact.foh`). The body is inside while its
first state, measured from the surface, is above 0. A period at whose end it is on the other side is halved again and
again: a half in which it stays is stepped, the one in which it crosses is not, and from the last of them on the other
mode has the rest of the period. So modes change at most 2⁻ᴺ of a period too early: with N = 10 the energy that a spring
of K at the surface makes of nothing there is at most K·(v·T/1024)²/2. A visit that begins and ends within one period
is not seen, and makes none.
"""

from collections.abc import Callable

from haptic_fieldbus.numerics.exact import foh
from haptic_fieldbus.numerics.linear import StateSpace

HALVINGS = 10

Pair = tuple[float, float]
Advance = Callable[[float, float, Pair, Pair], Pair]
"""(first state, second state, inputs of the last sample, inputs of this one) → the states at this one."""
_Rows = tuple[tuple[float, ...], tuple[float, ...]]
_SIZES = [0.5**number for number in range(1, HALVINGS + 1)]


def bind_switched(outside: StateSpace, inside: StateSpace, period: float) -> Advance:
    """One period [s] of two systems of two states and two inputs; where the surface is crossed, of both."""
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
        for number in (*left, HALVINGS - 1):
            end = time + _SIZES[number]
            inputs = (*_between(before, now, time), *_between(before, now, end))
            (first, second), time = _moved(parts[not mode][number], (first, second, *inputs)), end
        return first, second

    return advance


def bind_linear(space: StateSpace, period: float) -> Advance:
    """The same of one system, where there is no surface."""
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
