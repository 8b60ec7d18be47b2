"""The forces of one element along a part of a run: the ideal force, and the forces with imperfect feedback.

`way` is the true motion at the instant at which the element begins or continues, then at each node. `truth` and each
part of `real` are the inputs at the samples.
"""

import sys
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import repeat, starmap
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from haptic_fieldbus.assessing.recording import Array, Times, columns_of
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import AnyElement, DynamicElement, Element
from haptic_fieldbus.signals import Signal

if TYPE_CHECKING:
    from haptic_fieldbus.assessing.virtual_states import ResponseToError


# Spans in which each element of an axis acted, and its share of the force there, changes included.

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
    """Recorded periods of a part of a run in which an element acts.

    Indices count from the first row of the part.
    """

    element: Kind
    key: tuple[int, int]
    """Index of the element, and number of elements at this index before it; the same in each part of a run."""
    first: int
    """Negative for an element that began in an earlier part."""
    last: int
    """Index after the last period; past the end of the part for an element that continues."""
    share: Array
    """Factor 0 to 1 on its force in each recorded period, `(n_periods,)`; linear in between."""

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
    an exchange keeps its span. Elements that began before the first recorded period act fully from that period on.

    For a part of a run, `skipped` counts the periods before it, and `firsts` are the first periods after the exchanges,
    counted from the beginning of the run.
    """
    firsts = first_periods([each.after_ns for each in exchanges], times_ns) if firsts is None else firsts
    periods = np.arange(skipped, skipped + len(times_ns))
    whole = np.ones(len(periods))
    current = [Span(element, (place, 0), 0, sys.maxsize, whole) for place, element in enumerate(elements)]
    ended: list[Span[Kind]] = []
    for exchange, first in zip(exchanges, firsts, strict=False):
        # The first period of the ramp already has the share 1/periods, as in `cycle.laws.blended`.
        new = np.clip((periods - first + 1) / exchange.periods, 0.0, 1.0) if first else whole
        for place, element in enumerate(exchange.elements):
            old = current[place]
            if element == old.element:
                continue
            if first:
                ended.append(replace(old, last=first + exchange.periods, share=old.share * (1.0 - new)))
            current[place] = Span(element, (place, old.key[1] + 1), first, sys.maxsize, new)
    began = sorted([*ended, *current], key=lambda span: span.first)
    return [replace(span, first=span.first - skipped, last=span.last - skipped) for span in began]


# All that the torque error takes along from one part of a run to the next.

Key = tuple[Hashable, ...]


@dataclass
class PartState:
    """Laws with their memory, virtual states, and the forces of the previous part."""

    laws: dict[Key, Any] = field(default_factory=dict)
    exact: dict[Key, Array] = field(default_factory=dict)
    """Ideal virtual states at the last node, each `(order,)`."""
    to_error: dict[Key, "ResponseToError"] = field(default_factory=dict)
    stages: dict[str, Array] = field(default_factory=dict)
    """Force of each stage in all periods of the previous part."""

    def law(self, key: Key, begin: Callable[[], Any]) -> Any:
        """Return the law of a key; it starts at the first call."""
        if key not in self.laws:
            self.laws[key] = begin()
        return self.laws[key]

    def tail(self, name: str, overlap: int) -> Array | float:
        """Return the force of a stage in the last periods of the previous part, `(overlap,)`; 0 for a new stage."""
        before = self.stages.get(name)
        return 0.0 if before is None else before[len(before) - overlap :]


def begins(span: Span[Kind], overlap: int) -> bool:
    """Return whether the element begins to act in the part of this span."""
    return span.first >= overlap


def new_rows(span: Span[Kind], overlap: int) -> slice:
    """Return the slice of periods of a span that earlier parts did not have."""
    return slice(max(span.rows.start, overlap), span.rows.stop)


def new_nodes(span: Span[Kind], overlap: int, nodes_ns: Times, times_ns: Times) -> slice:
    """Return the slice of nodes after the period in which the span's ramp begins, up to its last period.

    For a continued span, it starts after the first node, which the previous part contained too.
    """
    begin_ns = times_ns[span.before] if begins(span, overlap) else nodes_ns[0]
    first, last = nodes_ns.searchsorted([begin_ns, times_ns[span.rows.stop - 1]], side="right")
    return slice(int(first), int(last))


POINTS_PER_PERIOD = 16 / 1.001
"""Points per period at which the error is computed.

Slightly off 16, so that the points drift through all phases of the period during a run; a whole number would use the
same 16 phases in every period.
"""

Inputs = Mapping[Signal, Array]


@dataclass(frozen=True)
class ElementForces:
    """Forces before the share of the span: at the nodes `(n_nodes,)`, and of each stage at the samples `(n_rows,)`."""

    ideal: Array
    stages: Mapping[str, Array]
    states: Array | None = None
    """Ideal virtual states at the nodes, `(n_nodes, order)`; None for an element without any."""


def exact_forces(
    element: DynamicElement,
    span: Span[Element],
    way_ns: Times,
    way: Inputs,
    samples_ns: Times,
    truth: Inputs,
    real: Mapping[str, Inputs],
    carried: PartState,
    period: float,
) -> ElementForces:
    """Return the forces of a linear element with virtual states, exact between the nodes.

    The force on imperfect inputs is the exact force plus the response to the input error alone.
    """
    from haptic_fieldbus.assessing.virtual_states import ExactResponse, ResponseToError

    position, velocity = way[Signal.POSITION], way[Signal.VELOCITY]
    exact = ExactResponse(element.dynamics, way_ns, position, velocity, carried.exact.get(span.key))
    carried.exact[span.key] = exact.states[-1]
    at_samples = exact.force_at(samples_ns, truth[Signal.POSITION], truth[Signal.VELOCITY])
    stages = {}
    for name, inputs in real.items():
        to_error = carried.to_error.setdefault((*span.key, name), ResponseToError(element, period))
        stages[name] = at_samples + to_error(inputs, truth)
    return ElementForces(exact.force[1:], stages, exact.states[1:])


def stepped_forces(
    span: Span[Element], overlap: int, way: Inputs, real: Mapping[str, Inputs], carried: PartState, period: float
) -> ElementForces:
    """Return the forces of an element by calls of its law, instant by instant.

    A memory is stepped from node to node, 16 times finer than in the loop, as a substitute for continuous time.
    """
    element = span.element
    law = carried.law((*span.key, "ideal"), partial(law_of, element, period / POINTS_PER_PERIOD))
    nodes = slice(1, None)
    # A law that goes on has had the first instant of its way already.
    starts = begins(span, overlap)
    ideal = forces_of(law, element, way)[nodes] if starts else forces_of(law, element, part_of(way, nodes))
    stages = {}
    for name, inputs in real.items():
        law = carried.law((*span.key, name), partial(law_of, element, period))
        stages[name] = forces_of(law, element, inputs)
    return ElementForces(ideal, stages)


def part_of(feedback: Inputs, rows: slice) -> dict[Signal, Array]:
    """Return the feedback in these periods only."""
    return {signal: values[rows] for signal, values in feedback.items()}


def forces_of(law: Callable[..., float], element: Element, feedback: Inputs) -> Array:
    """Return the forces of a law, called once for each instant of the feedback in turn, `(n,)`."""
    needed = columns_of(element.needs, feedback)
    count = len(feedback[Signal.POSITION])
    # An element that needs no signal is called all the same, once an instant.
    rows = zip(*needed, strict=True) if needed else repeat((), count)
    return np.fromiter(starmap(law, rows), dtype=np.float64, count=count)
