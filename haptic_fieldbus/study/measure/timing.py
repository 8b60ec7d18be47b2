"""What one call costs on this machine."""

import gc
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np

from haptic_fieldbus.numerics.loops import Array

REPEATS = 25
"""Passes whose shortest counts, after one that only warms up; what interrupts a pass makes it longer, never shorter."""


def ns_per_call(call: Callable[..., object], *inputs: Sequence[object], repeats: int = REPEATS) -> float:
    """Shortest mean time of a call along `inputs` [ns], without the garbage collector."""
    spent, was_on = [], gc.isenabled()
    gc.disable()
    try:
        for _ in range(repeats + 1):
            begun = perf_counter_ns()
            deque(map(call, *inputs), maxlen=0)
            spent.append(perf_counter_ns() - begun)
    finally:
        if was_on:
            gc.enable()
    return min(spent[1:]) / len(inputs[0])


@dataclass(frozen=True)
class Spread:
    """How single calls are distributed [ns], the clock's own cost taken off."""

    p50: float
    p999: float
    largest: float


def spread(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Spread:
    """Each call timed by itself."""
    empty = min(-perf_counter_ns() + perf_counter_ns() for _ in range(1000))  # between two looks at the clock
    p50, p999, largest = np.percentile(np.maximum(ns_of_each(call, inputs) - empty, 0.0), [50, 99.9, 100])
    return Spread(float(p50), float(p999), float(largest))


def ns_of_each(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Array:
    """Time of each call [ns], the clock's own cost included, shape (n,)."""
    clock, spent = perf_counter_ns, np.empty(len(inputs))
    for number, arguments in enumerate(inputs):
        begun = clock()
        call(*arguments)
        spent[number] = clock() - begun
    return spent
