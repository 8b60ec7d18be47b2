"""A virtual tool that the handle leads through a spring and a damper, and a wall that acts on the tool only.

    handle x ──[ stiffness, damping ]── tool p (mass) ──[ wall_stiffness ]── wall

F = K·(p − x) + B·(ṗ − ẋ) on the handle, m·p̈ = −F − K_w·(p − wall) while the tool is inside the wall. The hand feels
the wall through the coupling only: however stiff the wall, the loop renders no more than K and B, whose limits are
known beforehand (Adams & Hannaford, IEEE Trans. Robotics and Automation 15(3), 1999, 465, doi:10.1109/70.768179).

In continuous time the element stores m·ṗ²/2 + K·(p − x)²/2 + K_w·(p − wall)²/2 and dissipates B·(ṗ − ẋ)²: it is
passive. The tool is stepped exactly for motion of the handle on straight lines, and its meeting with the wall is found
within T/1024 (`bind_switched`), so tool and wall make no energy of their own. The coupling, sampled and held, leaks
about half and at most all of |ΔF·Δx| in each period, where ΔF is the change of its force within the period.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, Literal

from haptic_fieldbus.numerics.linear import StateSpace, foh, system_of
from haptic_fieldbus.scenes.element import (
    STRICT,
    Damped,
    Damping,
    Law,
    Mass,
    NonNegativeStiffness,
    Place,
    Stiffness,
    below,
)


@dataclass(frozen=True)
class VirtualCoupling(Damped):
    """A tool of `mass`, coupled by `stiffness` and `damping`, and a wall of `wall_stiffness` that starts at `wall`.

    The mass is in kg or kg·m², stiffnesses are in N/m or N·m/rad, the damping in N·s/m or N·m·s/rad, the position
    `wall` in m or rad. Without `wall_stiffness` there is no wall. `side` is the side of `wall` on which its material
    lies.
    """

    axis: str
    stiffness: Stiffness
    mass: Mass
    damping: Damping = 0.0
    wall_stiffness: NonNegativeStiffness = 0.0
    wall: Place = 0.0
    side: Literal["positive", "negative"] = "positive"
    name: str = "virtual_coupling"
    __pydantic_config__: ClassVar = STRICT

    def begin(self, period: float) -> Law:
        """Return a law that remembers the tool, which starts at rest; lengths inside count from the wall into it."""
        inwards, wall = 1.0 if self.side == "positive" else -1.0, self.wall
        stiffness, damping = self.stiffness, self.damping
        free, touching = self._tool(0.0), self._tool(self.wall_stiffness)
        advance = bind_switched(free, touching, period) if self.wall_stiffness else bind_linear(free, period)
        # Where a held tool comes to rest between the coupling and the wall, as a share of the handle's depth.
        at_rest = stiffness / (stiffness + self.wall_stiffness)
        last: tuple[float, float] | None = None
        tool = speed = 0.0

        def force(position: float, velocity: float = 0.0) -> float:
            nonlocal last, tool, speed
            handle = inwards * (position - wall), inwards * velocity
            if last is None:
                # The tool starts at rest: at the handle outside of the wall, balanced between coupling and wall inside.
                tool = handle[0] if handle[0] <= 0.0 else at_rest * handle[0]
            else:
                tool, speed = advance(tool, speed, last, handle)
            last = handle
            return inwards * (stiffness * (tool - handle[0]) + damping * (speed - handle[1]))

        return force

    def penetration(self, position: float) -> float | None:
        """Return the depth of the handle in the wall [m or rad], larger than that of the tool; None without a wall."""
        return below(position, self.wall, self.side) if self.wall_stiffness else None

    def _tool(self, wall_stiffness: float) -> StateSpace:
        """States (position, velocity) of the tool, inputs those of the handle, output the force on the handle."""
        k, b, m = self.stiffness, self.damping, self.mass
        rates = [[0.0, 1.0], [-(k + wall_stiffness) / m, -b / m]]
        return system_of(rates, [[0.0, 0.0], [k / m, b / m]], [[k, b]], [[-k, -b]])

    def linearised(self) -> StateSpace:
        """Return the tool in sustained contact with the wall."""
        return self._tool(self.wall_stiffness)

    @property
    def other_regimes(self) -> tuple[StateSpace, ...]:
        """Model of the tool that does not touch the wall."""
        return (self._tool(0.0),) if self.wall_stiffness else ()


# A body of two states that is linear outside a surface and linear inside it, stepped exactly, crossings included.
# In each of its two modes a period is exact for inputs on a straight line (`exact.foh`). The body is inside when its
# first state, measured from the surface, is above 0. When the body is on the other side at the end of a period, the
# instant of crossing is searched by halving the period N times. A half in which the body stays on its side is stepped;
# a half in which it crosses is halved again. From the last of these halves on, the other mode has the rest of the
# period.
#
# Modes therefore change at most 2⁻ᴺ of a period too early. With N = 10, a spring K at the surface creates at most the
# energy K·(v·T/1024)²/2 by this. A visit that begins and ends within one period is not noticed, and creates no energy.

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
