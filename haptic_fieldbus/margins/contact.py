"""The elements of an axis in sustained contact as one discrete environment, with one stiffness that varies."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from haptic_fieldbus.numerics.linear import StateSpace, gain, parallel
from haptic_fieldbus.numerics.sampled import discretised, estimated, scaled
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Element, Graded

Kind = TypeVar("Kind", bound=AnyElement)
_fulfilled: dict[tuple[type, type], bool] = {}


def fulfils(element: AnyElement, protocol: type) -> bool:
    """Return whether an element fulfils a protocol, found once for its class: `isinstance` looks at every member."""
    key = type(element), protocol
    if key not in _fulfilled:
        _fulfilled[key] = isinstance(element, protocol)
    return _fulfilled[key]


def stiffness_of(element: AnyElement) -> float:
    """Return the element's own stiffness [N/m or N·m/rad]; 0 when it has none."""
    return float(getattr(element, "stiffness", 0.0))


def stiffest_of(elements: Iterable[Kind]) -> Kind | None:
    """Return the element with the largest stiffness; None when no element has a stiffness."""
    return max(filter(stiffness_of, elements), key=stiffness_of, default=None)


def linearised(element: AnyElement, changes: Mapping[str, float]) -> StateSpace:
    """Return the element in sustained contact, after those `changes` for which it has a parameter.

    A stiffness that follows from other parameters cannot be set; it is changed by a factor on the whole force.
    """
    known = {name: value for name, value in changes.items() if hasattr(element, name)}
    if "stiffness" in known and isinstance(element, Graded):
        factor = known.pop("stiffness") / element.stiffness
        return scaled(linearised(element, known), factor)
    varied: AnyElement = replace(element, **known) if known else element  # type: ignore[type-var]  # a dataclass
    return varied.linearised()


def with_parameters(element: Kind, changes: Mapping[str, float]) -> Kind:
    """Return the element after those `changes` for which it has a parameter."""
    known = {name: value for name, value in changes.items() if hasattr(element, name)}
    varied: Any = element
    if "stiffness" in known and isinstance(varied, Graded):
        varied = varied.with_stiffness(known.pop("stiffness"))
    kept: Kind = replace(varied, **known) if known else varied
    return kept


def damping_of(elements: Iterable[AnyElement]) -> float:
    """Return the virtual damping of all elements together [N·s/m or N·m·s/rad]."""
    return sum(float(getattr(element, "damping", 0.0)) for element in elements)


def environment_of(
    elements: tuple[Element, ...], period: float, method: str | None, estimator: str | None, **changes: float
) -> StateSpace:
    """Return the linearised elements as the loop runs them, x_k → F_k, with `changes` to the stiffest element.

    `method` applies to elements whose virtual states the loop integrates. An element with a memory of its own steps it
    exactly. Raises UsageError as `numerics.sampled.environment`.
    """
    stiffest = stiffest_of(elements)
    steps = []
    for element in elements:
        space = linearised(element, changes if element is stiffest else {})
        steps.append(discretised(space, period, method if isinstance(element, DynamicElement) else None))
    return estimated(parallel(steps) if steps else gain([[0.0, 0.0]]), period, estimator)
