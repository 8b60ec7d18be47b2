"""How old the forces of a coupling are on the axes that it ties together.

Imported only where a scene has a coupling.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.scenes.element import CouplingElement


@dataclass(frozen=True)
class CouplingAges:
    """How old what a coupling answers to is when its force acts [s]; the hold's T/2 is not part of it."""

    name: str
    ages: Mapping[str, Mapping[str, float]]
    """By the axis that the force acts on, and by the axis whose motion it answers."""

    def __str__(self) -> str:
        return f"{self.name}: force {', '.join(f'on {axis} {self._behind(axis)}' for axis in self.ages)}"

    def _behind(self, axis: str) -> str:
        """The ages of both motions, or the one of both where they are the same [ms]."""
        texts = {name: f"{rounded(1e3 * age)} ms" for name, age in self.ages[axis].items()}
        if len(set(texts.values())) == 1:
            return f"{texts[axis]} behind both motions"
        return " and ".join(f"{text} behind {name}" for name, text in texts.items())


def ages(
    couplings: Sequence[CouplingElement], axes: Sequence[AxisPlan], latch: Mapping[str, float]
) -> Iterator[CouplingAges]:
    """Both axes of a coupling are latched when their bus lets them [s], which a slow bus does later."""
    known = {axis.name: axis for axis in axes}
    for coupling in couplings:
        acts = {name: latch[name] + known[name].delay.total for name in coupling.axes}
        yield CouplingAges(
            coupling.name, {on: {of: acts[on] - latch[of] for of in coupling.axes} for on in coupling.axes}
        )
