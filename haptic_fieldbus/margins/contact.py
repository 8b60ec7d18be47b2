"""The elements of an axis in sustained contact: one discrete environment, and one stiffness to vary."""

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeVar

from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.margins.verdict import Stability, judge
from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.numerics.sampled import discretised, estimated, scaled
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Element, Graded

Kind = TypeVar("Kind", bound=AnyElement)


def stiffness_of(element: AnyElement) -> float:
    """The element's own stiffness [N/m or N·m/rad]; 0 when it has none."""
    return float(getattr(element, "stiffness", 0.0))


def stiffest_of(elements: Iterable[Kind]) -> Kind | None:
    """The element whose stiffness is the largest; None when none has any."""
    return max(filter(stiffness_of, elements), key=stiffness_of, default=None)


def linearised(element: AnyElement, changes: dict[str, float]) -> StateSpace:
    """The element in sustained contact, changed; a stiffness that follows from other parameters scales all force."""
    if not isinstance(element, Graded) or "stiffness" not in changes:
        varied: AnyElement = replace(element, **changes)  # type: ignore[type-var]  # elements are dataclasses
        return varied.linearised()
    others = {name: value for name, value in changes.items() if name != "stiffness"}
    return scaled(linearised(element, others), changes["stiffness"] / element.stiffness)


def damping_of(elements: Iterable[AnyElement]) -> float:
    """Virtual damping of all elements together [N·s/m or N·m·s/rad]."""
    return sum(float(getattr(element, "damping", 0.0)) for element in elements)


def environment_of(
    elements: tuple[Element, ...], period: float, method: str | None, estimator: str | None, **changes: float
) -> StateSpace:
    """The linearised elements as the loop runs them, x_k → F_k, the stiffest one changed.

    An element with a memory of its own steps it exactly, whatever the method of virtual states.
    """
    stiffest = stiffest_of(elements)
    steps = []
    for element in elements:
        space = linearised(element, changes) if element is stiffest else element.linearised()
        steps.append(discretised(space, period, method if isinstance(element, DynamicElement) else None))
    return estimated(parallel(steps) if steps else gain([[0.0, 0.0]]), period, estimator)


def judge_contact(
    plant: Plant,
    period: float,
    delay: float,
    elements: tuple[Element, ...],
    method: str | None,
    estimator: str | None,
) -> Stability:
    """The verdict on one axis; its limits are those of the stiffest element, all else kept."""
    stiffest = stiffest_of(elements)
    return judge(
        plant,
        period,
        delay,
        lambda stiffness: environment_of(elements, period, method, estimator, stiffness=stiffness),
        stiffness=stiffness_of(stiffest) if stiffest is not None else None,
        damping=damping_of(elements),
    )
