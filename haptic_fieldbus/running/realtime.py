"""Settings of the interpreter that keep it from delaying the loop."""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Switch the garbage collector off inside the block, and restore it afterwards.

    The loop allocates nothing that grows, so nothing needs to be collected while it runs. Nor is anything collected
    before: in a large process that would take longer than all else before a short run.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


GIVE_WAY = 2e-5
"""Switch interval of the interpreter during a run [s].

The default of 5 ms would cost a loop at 1 kHz five periods each time that another thread computes.
"""


@contextmanager
def threads_give_way() -> Iterator[None]:
    """Shorten the switch interval inside the block, so that a computing thread gives way to the loop at once."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(min(before, GIVE_WAY))  # a shorter interval of the caller stays
    try:
        yield
    finally:
        sys.setswitchinterval(before)
