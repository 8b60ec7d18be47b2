"""What drives that are hosted in real time need, on any bus."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager

LONGEST_REMEMBERED = 1000
"""Least number of latest motion segments that are kept; no caller needs more."""
NAP_NS = 100_000_000
"""Longest wait, so that a request to stop is noticed soon."""


@contextmanager
def frozen() -> Iterator[None]:
    """Keep what exists now out of garbage collection inside the block, so that a collection has little to do.

    Where the program around it had frozen something, all stays frozen: what is whose cannot be told apart.
    """
    theirs = gc.get_freeze_count()
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        if not theirs:
            gc.unfreeze()
