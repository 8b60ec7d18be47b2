"""Timing of single calls on this machine."""

import gc
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np

from haptic_fieldbus.numerics.loops import Array

REPEATS = 25
"""Number of timed passes after one that only warms up.

The shortest pass counts: interruptions make a pass longer, never shorter.
"""


def ns_per_call(call: Callable[..., object], *inputs: Sequence[object], repeats: int = REPEATS) -> float:
    """Return the shortest mean time of a call [ns], with the garbage collector off.

    `inputs` has one sequence for each argument, all of the same length; a pass calls along all of them.
    """
    return ns_in_passes(call, [inputs] * (repeats + 1))


def ns_in_passes(call: Callable[..., object], passes: Sequence[Sequence[Sequence[object]]]) -> float:
    """Return the shortest mean time of a call [ns], where each pass has inputs of its own; the first only warms up."""
    spent, was_on = [], gc.isenabled()
    gc.disable()
    try:
        for inputs in passes:
            begun = perf_counter_ns()
            # The calls are driven in C, without the cost of a Python loop around them.
            deque(map(call, *inputs), maxlen=0)
            spent.append(perf_counter_ns() - begun)
    finally:
        if was_on:
            gc.enable()
    return min(spent[1:]) / len(passes[0][0])


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
