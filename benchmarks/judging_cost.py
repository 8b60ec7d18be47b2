"""One axis judged by the matrices of several beside its own closed forms: the price, and how far the limits differ.

It is why a group of one has an algebra of its own (ADR 0013).
"""

from collections.abc import Callable
from dataclasses import dataclass

from rows import Row, cost, show

from haptic_fieldbus.margins import EnvironmentOf, Plant, alone, judge
from haptic_fieldbus.margins.closed_loop import Axis, ClosedLoop
from haptic_fieldbus.margins.coupled import CoupledAxes
from haptic_fieldbus.margins.group import Group, Member
from haptic_fieldbus.scenes.element import Element
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall

PERIOD, DELAY = 1e-3, 8e-4
BENCH = Plant(mass=0.63, damping=1.6, coulomb=0.3, resolution=1.2e-5, torque_lag=5e-4)
SCENES: dict[str, tuple[Element, str | None]] = {
    "a wall": (Wall("handle", 600.0), None),
    "a damped wall": (Wall("handle", 600.0, damping=0.5), None),
    "a sprung mass": (SprungMass("handle", 600.0, 0.5), "exact-foh"),
}


@dataclass(frozen=True)
class Case:
    """An element on the bench, by both algebras."""

    name: str
    element: Element
    method: str | None

    @property
    def environment_of(self) -> EnvironmentOf:
        member = Member("handle", BENCH, DELAY, (self.element,), self.method, "backward-difference")
        group = Group((member,), (), PERIOD)
        return lambda stiffness: group.environment(stiffness=stiffness)

    def rows(self) -> list[Row]:
        environment_of = self.environment_of
        asked = environment_of(600.0)
        return [
            self.row("growth", lambda loop: loop.growth(asked), 100),
            self.row("limit of stability", lambda loop: loop.limit(environment_of), 3),
            self.row("limit of passivity", lambda loop: loop.passive_limit(environment_of, 1e9), 3),
            self.row("verdict", lambda loop: judge(loop, environment_of, 600.0), 3),
        ]

    def row(self, what: str, ask: Callable[[ClosedLoop], object], number: int) -> Row:
        one, several = alone(BENCH, PERIOD, DELAY), CoupledAxes([Axis(BENCH, DELAY)], PERIOD)
        told, other = ask(one), ask(several)
        differs = f" ({told:.9g}, by several {other:.9g})" if isinstance(told, float) else ""
        price, reference = cost(lambda: ask(several), number, 10), cost(lambda: ask(one), number, 10)
        return Row(f"{what} of {self.name}{differs}", price, reference)


if __name__ == "__main__":
    show([row for name, scene in SCENES.items() for row in Case(name, *scene).rows()])
