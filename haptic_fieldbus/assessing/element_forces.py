"""The forces of one element along a part of a run: the ideal one, and those on imperfect feedback.

`way` is the true motion from the instant at which the element begins or goes on, then at each node; `truth` and each
part of `real` are the inputs at the samples.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import repeat, starmap

import numpy as np

from haptic_fieldbus.assessing.carried import Carried, begins
from haptic_fieldbus.assessing.recording import Array, Times, columns_of
from haptic_fieldbus.assessing.spans import Span
from haptic_fieldbus.cycle.laws import law_of
from haptic_fieldbus.scenes.element import DynamicElement, Element
from haptic_fieldbus.signals import Signal

POINTS_PER_PERIOD = 16 / 1.001
"""Points per period at which the error is taken.

Slightly off 16, so that the points drift through all phases of the period in the course of a run; with a whole number,
the same 16 phases would be taken in every period.
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
    carried: Carried,
    period: float,
) -> ElementForces:
    """Return the forces of a linear element with virtual states, exact between the nodes.

    Its answer to imperfect inputs is the exact one plus that to their error alone.
    """
    from haptic_fieldbus.assessing.virtual_states import ResponseToError, exact_response

    exact = exact_response(element, way_ns, way, carried.exact.get(span.key))
    carried.exact[span.key] = exact.states[-1]
    at_samples = exact.force_at(samples_ns, truth[Signal.POSITION], truth[Signal.VELOCITY])
    stages = {}
    for name, inputs in real.items():
        to_error = carried.to_error.setdefault((*span.key, name), ResponseToError(element, period))
        stages[name] = at_samples + to_error(inputs, truth)
    return ElementForces(exact.force[1:], stages, exact.states[1:])


def stepped_forces(
    span: Span[Element], overlap: int, way: Inputs, real: Mapping[str, Inputs], carried: Carried, period: float
) -> ElementForces:
    """Return the forces of an element whose law is called in turn.

    A memory is stepped from node to node, 16 times finer than in the loop, in place of continuous time.
    """
    element = span.element
    law = carried.law((*span.key, "ideal"), partial(law_of, element, period / POINTS_PER_PERIOD))
    # A law that goes on has had the first instant of its way already.
    if begins(span, overlap):
        ideal = forces_of(law, element, way)[1:]
    else:
        ideal = forces_of(law, element, part_of(way, slice(1, None)))
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
