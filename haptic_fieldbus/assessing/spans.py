"""Spans in which each element of an axis acted, and its share of the force there, changes included."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times
from haptic_fieldbus.scenes.element import AnyElement

Kind = TypeVar("Kind", bound=AnyElement)


@dataclass(frozen=True)
class Handover(Generic[Kind]):
    """Replacement of the elements, or of the couplings, of an axis while the loop runs."""

    after_ns: int
    """Latch instant of the last period with the old elements alone."""
    periods: int
    """Length of the ramp from the old elements to the new ones."""
    elements: tuple[Kind, ...]
    """New elements; each takes the place of the old one at the same index."""


@dataclass(frozen=True, eq=False)
class Span(Generic[Kind]):
    """Periods in which an element acts: from `first` up to, not including, `last`."""

    element: Kind
    first: int
    last: int
    share: Array
    """Factor 0 to 1 on its force in each recorded period, `(n_periods,)`; straight lines in between."""

    @property
    def before(self) -> int:
        """Index of the period in which its ramp begins: the last one with share 0, or the first period of all."""
        return max(self.first - 1, 0)

    @property
    def rows(self) -> slice:
        """Slice of the recorded periods in which the element acts."""
        return slice(self.first, self.last)


def spans(elements: Sequence[Kind], exchanges: Sequence[Handover[Kind]], times_ns: Times) -> list[Span[Kind]]:
    """Return a span for each element that acted, in the order in which they began.

    `times_ns` are the latch instants of the recorded periods, `(n_periods,)`. An element that is equal before and after
    an exchange keeps its span. Elements that came into force before the first recorded period are taken to act fully
    from that period on.
    """
    periods = len(times_ns)
    current = [Span(element, 0, periods, np.ones(periods)) for element in elements]
    ended: list[Span[Kind]] = []
    for exchange in exchanges:
        first = int(np.searchsorted(times_ns, exchange.after_ns, side="right"))
        # The first period of the ramp already has the share 1/periods, as in `cycle.laws.blended`.
        new = np.clip((np.arange(periods) - first + 1) / exchange.periods, 0.0, 1.0) if first else np.ones(periods)
        for place, element in enumerate(exchange.elements):
            old = current[place]
            if element == old.element or first == periods:  # the same, or a change after the last recorded period
                continue
            if first:
                ended.append(replace(old, last=min(first + exchange.periods, periods), share=old.share * (1.0 - new)))
            current[place] = Span(element, first, periods, new)
    return sorted([*ended, *current], key=lambda span: span.first)
