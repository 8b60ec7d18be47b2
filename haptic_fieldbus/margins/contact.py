"""The elements of an axis in sustained contact: one discrete environment, and one stiffness to vary."""

from collections.abc import Iterable
from dataclasses import replace

from haptic_fieldbus.margins.plant import Plant
from haptic_fieldbus.margins.verdict import Stability, judge
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.numerics.sampled import environment
from haptic_fieldbus.scenes.element import Element


def stiffness_of(element: Element) -> float:
    """The element's own stiffness [N/m or N·m/rad]; 0 when it has none."""
    return float(getattr(element, "stiffness", 0.0))


def stiffest_of(elements: Iterable[Element]) -> Element | None:
    """The element whose stiffness is the largest; None when none has any."""
    return max(filter(stiffness_of, elements), key=stiffness_of, default=None)


def damping_of(elements: Iterable[Element]) -> float:
    """Virtual damping of all elements together [N·s/m or N·m·s/rad]."""
    return sum(float(getattr(element, "damping", 0.0)) for element in elements)


def environment_of(
    elements: tuple[Element, ...], period: float, method: str | None, estimator: str | None, **changes: float
) -> StateSpace:
    """The linearised elements as the loop runs them, x_k → F_k, the stiffest one changed."""
    stiffest = stiffest_of(elements)
    varied = [
        replace(element, **changes) if element is stiffest else element  # type: ignore[type-var]
        for element in elements
    ]
    space = parallel([element.linearised() for element in varied])
    return environment(space, period=period, method=method, estimator=estimator)


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
