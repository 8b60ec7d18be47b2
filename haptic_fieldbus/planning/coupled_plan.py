"""Age of the feedback behind the forces of a coupling, when they act on its two axes.

Imported only when a scene has a coupling.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from haptic_fieldbus.numerals import rounded
from haptic_fieldbus.planning.axis_plan import AxisPlan
from haptic_fieldbus.scenes.element import CouplingElement


@dataclass(frozen=True)
class CouplingAges:
    """Age of the motions to which a coupling reacts, at the time its forces act [s]; without the T/2 of the hold."""

    name: str
    ages: Mapping[str, Mapping[str, float]]
    """Axis on which the force acts → axis of the motion → age [s]."""

    def __str__(self) -> str:
        return f"{self.name}: force {', '.join(f'on {axis} {self._behind(axis)}' for axis in self.ages)}"

    def _behind(self, axis: str) -> str:
        """Return the ages of both motions in words, as one number [ms] when they are equal."""
        texts = {name: f"{rounded(1e3 * age)} ms" for name, age in self.ages[axis].items()}
        if len(set(texts.values())) == 1:
            return f"{texts[axis]} after both motions"
        return " and ".join(f"{text} after {name}" for name, text in texts.items())


def ages(
    couplings: Sequence[CouplingElement], axes: Sequence[AxisPlan], latch: Mapping[str, float]
) -> Iterator[CouplingAges]:
    """Yield the ages for each coupling; `latch` is the latch instant of each axis [s], later on a slower bus."""
    known = {axis.name: axis for axis in axes}
    for coupling in couplings:
        acts = {name: latch[name] + known[name].delay.total for name in coupling.axes}
        yield CouplingAges(
            coupling.name, {on: {of: acts[on] - latch[of] for of in coupling.axes} for on in coupling.axes}
        )
