"""Keeping the interpreter from getting in the way of the loop."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """No collector pauses inside; the loop allocates nothing that grows, so nothing needs collecting."""
    was_enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if was_enabled:
            gc.enable()


GIVE_WAY = 2e-5
"""[s]; the interpreter's own 5 ms would cost the loop five periods of 1 kHz each time that another thread computes."""


@contextmanager
def threads_give_way() -> Iterator[None]:
    """Another thread of this process that computes lets the loop on at once when its wait is over."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, GIVE_WAY))
    try:
        yield
    finally:
        sys.setswitchinterval(before)
