"""When each element of an axis acted, and with which share: from the first period to the last, changes included."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.scenes.element import AnyElement

Kind = TypeVar("Kind", bound=AnyElement)


@dataclass(frozen=True)
class Handover(Generic[Kind]):
    """The elements, or couplings, of an axis that came into force after an instant, along a ramp of so many periods."""

    after_ns: int
    periods: int
    elements: tuple[Kind, ...]


@dataclass(frozen=True, eq=False)
class Span(Generic[Kind]):
    """An element while it acts: from the period `first` up to, not including, `last`."""

    element: Kind
    first: int
    last: int
    share: Array
    """Of its force in each recorded period; between them straight."""

    @property
    def before(self) -> int:
        """The period in which its ramp begins: the last in which it has no share, or the first of all."""
        return max(self.first - 1, 0)

    @property
    def rows(self) -> slice:
        return slice(self.first, self.last)


def spans(elements: Sequence[Kind], exchanges: Sequence[Handover[Kind]], times_ns: Times) -> list[Span[Kind]]:
    """Of all elements that acted, in the order in which they began; one that stays through an exchange goes on.

    What came into force before the first recorded period is taken to have been in force since ever.
    """
    periods = len(times_ns)
    current = [Span(element, 0, periods, np.ones(periods)) for element in elements]
    ended: list[Span[Kind]] = []
    for exchange in exchanges:
        first = int(np.searchsorted(times_ns, exchange.after_ns, side="right"))
        new = np.clip((np.arange(periods) - first + 1) / exchange.periods, 0.0, 1.0) if first else np.ones(periods)
        for place, element in enumerate(exchange.elements):
            old = current[place]
            if element == old.element or first == periods:
                continue
            if first:
                ended.append(replace(old, last=min(first + exchange.periods, periods), share=old.share * (1.0 - new)))
            current[place] = Span(element, first, periods, new)
    return sorted([*ended, *current], key=lambda span: span.first)
