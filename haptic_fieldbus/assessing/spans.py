"""Spans in which each element of an axis acted, and its share of the force there, changes included."""

import sys
from collections.abc import Iterable, Sequence
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
    """Periods in which an element acts, as far as they are recorded in a part of a run.

    Indices count from the first row of the part.
    """

    element: Kind
    key: tuple[int, int]
    """Its place among the elements, and how many stood there before: the same in each part of a run."""
    first: int
    """Negative for an element that began in an earlier part."""
    last: int
    """Index after the last period; past the end of the part for an element that acts on."""
    share: Array
    """Factor 0 to 1 on its force in each recorded period, `(n_periods,)`; straight lines in between."""

    @property
    def before(self) -> int:
        """Index of the period in which its ramp begins: the last one with share 0, or the first period of all."""
        return max(self.first - 1, 0)

    @property
    def rows(self) -> slice:
        """Slice of the recorded periods in which the element acts."""
        return slice(max(self.first, 0), max(0, min(self.last, len(self.share))))


def first_periods(exchanges: Iterable[int], times_ns: Times) -> list[int]:
    """Return the index of the first period after each instant [ns]; without instants after the last period."""
    found = [int(np.searchsorted(times_ns, after_ns, side="right")) for after_ns in exchanges]
    return [first for first in found if first < len(times_ns)]


def spans(
    elements: Sequence[Kind],
    exchanges: Sequence[Handover[Kind]],
    times_ns: Times,
    firsts: Sequence[int] | None = None,
    skipped: int = 0,
) -> list[Span[Kind]]:
    """Return a span for each element that acted, in the order in which they began.

    `times_ns` are the latch instants of the recorded periods, `(n_periods,)`. An element that is equal before and after
    an exchange keeps its span. Elements that came into force before the first recorded period are taken to act fully
    from that period on.

    For a part of a run, `skipped` counts the periods before it, and `firsts` are the first periods after the exchanges,
    counted from the begin of the run.
    """
    firsts = first_periods([each.after_ns for each in exchanges], times_ns) if firsts is None else firsts
    periods = np.arange(skipped, skipped + len(times_ns))
    current = [
        Span(element, (place, 0), 0, sys.maxsize, np.ones(len(periods))) for place, element in enumerate(elements)
    ]
    ended: list[Span[Kind]] = []
    for exchange, first in zip(exchanges, firsts, strict=False):
        # The first period of the ramp already has the share 1/periods, as in `cycle.laws.blended`.
        new = np.clip((periods - first + 1) / exchange.periods, 0.0, 1.0) if first else np.ones(len(periods))
        for place, element in enumerate(exchange.elements):
            old = current[place]
            if element == old.element:
                continue
            if first:
                ended.append(replace(old, last=first + exchange.periods, share=old.share * (1.0 - new)))
            current[place] = Span(element, (place, old.key[1] + 1), first, sys.maxsize, new)
    began = sorted([*ended, *current], key=lambda span: span.first)
    return [replace(span, first=span.first - skipped, last=span.last - skipped) for span in began]
