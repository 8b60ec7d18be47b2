"""What one call costs on this machine."""

import gc
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from time import perf_counter_ns

import numpy as np

REPEATS = 25
"""Passes whose shortest counts, after one that only warms up; what interrupts a pass makes it longer, never shorter."""


@contextmanager
def undisturbed() -> Iterator[None]:
    """Without the garbage collector."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def ns_per_call(call: Callable[..., object], *inputs: Sequence[object], repeats: int = REPEATS) -> float:
    """Shortest mean time of a call along `inputs` [ns]; at least 20 repeats after a warm-up."""
    shortest = float("inf")
    with undisturbed():
        for attempt in range(repeats + 1):
            begun = perf_counter_ns()
            deque(map(call, *inputs), maxlen=0)
            spent = perf_counter_ns() - begun
            if attempt:
                shortest = min(shortest, spent)
    return shortest / len(inputs[0])


@dataclass(frozen=True)
class Spread:
    """How single calls are distributed [ns], the clock's own cost taken off."""

    p50: float
    p999: float
    largest: float


def spread(call: Callable[..., object], inputs: Sequence[tuple[object, ...]]) -> Spread:
    """Each call timed by itself."""
    clock, spent = perf_counter_ns, np.empty(len(inputs))
    empty = min(_empty(clock) for _ in range(1000))
    for number, arguments in enumerate(inputs):
        begun = clock()
        call(*arguments)
        spent[number] = clock() - begun
    p50, p999, largest = np.percentile(np.maximum(spent - empty, 0.0), [50, 99.9, 100])
    return Spread(float(p50), float(p999), float(largest))


def _empty(clock: Callable[[], int]) -> int:
    begun = clock()
    return clock() - begun
