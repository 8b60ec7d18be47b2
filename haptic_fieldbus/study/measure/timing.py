"""Timing of calls on this machine: costs with their spread over repeats, and ratios of calls that took turns.

A clock rate that rises, or a neighbour on the same core, makes one minute of a machine faster than the next. So calls
that are compared take turns: each pass runs all of them, one after another, and a ratio is that of two passes side by
side.
"""

import gc
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter_ns, thread_time_ns

import numpy as np

from haptic_fieldbus.numerics.loops import Array

REPEATS = 25
"""Number of timed passes after one that only warms up."""
Quartiles = tuple[float, float, float]
"""Values below which a quarter, a half and three quarters of the passes lie."""


@dataclass(frozen=True)
class Timed:
    """A call to be timed; `inputs` is asked before each pass, and returns one sequence for each argument."""

    call: Callable[..., object]
    inputs: Callable[[], Sequence[Sequence[object]]]


@dataclass(frozen=True, eq=False)
class Cost:
    """Times of a call, and what disturbed them."""

    passes: Array
    """Mean time of a call in each pass [ns], `(n_passes,)`."""
    lasted_ns: int
    """Time that all passes took together."""
    ran_ns: int
    """Part of it in which this thread had a processor."""

    @property
    def ns(self) -> float:
        """Mean time of a call in the median pass [ns], which is between the quartiles that are told beside it."""
        return self.quartiles[1]

    @property
    def quartiles(self) -> Quartiles:
        """Quartiles over the passes [ns]."""
        return quartiles(self.passes)

    @property
    def spread(self) -> float:
        """Distance of the outer quartiles, as a share of the median."""
        low, middle, high = self.quartiles
        return (high - low) / middle

    def ratio(self, other: "Cost") -> Quartiles:
        """Return the quartiles of this cost over another, pass by pass; both must have been timed in turn."""
        return quartiles(self.passes / other.passes)

    def excess(self, other: "Cost") -> Array:
        """Return this cost minus another, pass by pass [ns]; both must have been timed in turn."""
        return self.passes - other.passes


def quartiles(values: Array) -> Quartiles:
    """Return the quartiles of values of shape `(n,)`."""
    low, middle, high = np.percentile(values, [25, 50, 75]).tolist()
    return low, middle, high


def in_turn(calls: Mapping[str, Timed], repeats: int = REPEATS) -> dict[str, Cost]:
    """Return the costs of calls that take turns, pass by pass, with the garbage collector off."""
    spent = {name: np.empty(repeats) for name in calls}
    lasted, ran = dict.fromkeys(calls, 0), dict.fromkeys(calls, 0)
    for number in range(-1, repeats):
        for name, timed in calls.items():
            inputs = timed.inputs()
            wall_ns, thread_ns = _pass(timed.call, inputs)
            if number >= 0:  # the first pass only warms up
                spent[name][number] = wall_ns / len(inputs[0])
                lasted[name] += wall_ns
                ran[name] += thread_ns
    return {name: Cost(spent[name], lasted[name], ran[name]) for name in calls}


def _pass(call: Callable[..., object], inputs: Sequence[Sequence[object]]) -> tuple[int, int]:
    """Return the time that calls along all inputs take, and the time of it in which this thread ran [ns]."""
    with _without_collector():
        thread, begun = thread_time_ns(), perf_counter_ns()
        # The calls are driven in C, without the cost of a Python loop around them.
        deque(map(call, *inputs), maxlen=0)
        return perf_counter_ns() - begun, thread_time_ns() - thread


@contextmanager
def _without_collector() -> Iterator[None]:
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@dataclass(frozen=True)
class Spread:
    """Distribution of the times of single calls [ns], without the time of reading the clock."""

    p50: float
    p999: float
    largest: float


def spread(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Spread:
    """Return the distribution of calls that are timed one by one; `inputs` has the arguments of each."""
    empty = min(-perf_counter_ns() + perf_counter_ns() for _ in range(1000))  # time between two readings of the clock
    p50, p999, largest = np.percentile(np.maximum(ns_of_each(call, inputs) - empty, 0.0), [50, 99.9, 100])
    return Spread(float(p50), float(p999), float(largest))


def ns_of_each(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Array:
    """Return the time of each call [ns], reading the clock included, `(n_calls,)`."""
    clock, spent = perf_counter_ns, np.empty(len(inputs))
    for number, arguments in enumerate(inputs):
        begun = clock()
        call(*arguments)
        spent[number] = clock() - begun
    return spent
