"""Signals that end a run: Ctrl-C, SIGTERM (`kill`, a service manager) and SIGHUP (a terminal that is closed).

While the drives are configured, the first signal raises KeyboardInterrupt, since no torque is there to be taken away.
From `hold` on signals are only noted: the loop sees the note between two periods, and nothing interrupts the way to
zero torque, however often Ctrl-C is pressed.
"""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
OURS_TO_TAKE = (signal.SIG_DFL, signal.default_int_handler)
"""Handlers that nobody has chosen; others, as those of `nohup` or of a program around ours, stay."""


class EndSignals:
    """What has asked for the end of the run."""

    def __init__(self) -> None:
        self.signal: int | None = None
        """Number of the first signal; None while there was none."""
        self._held = False

    def hold(self) -> None:
        """Only note signals from now on."""
        self._held = True

    def receive(self, number: int, frame: FrameType | None = None) -> None:
        """Note a signal; raises KeyboardInterrupt for the first one, before `hold`."""
        first, self.signal = self.signal is None, self.signal or number
        if first and not self._held:
            raise KeyboardInterrupt


@contextmanager
def ended_by_signals() -> Iterator[EndSignals]:
    """Yield an `EndSignals` that signals reach inside the block; outside the main thread none do."""
    ending = EndSignals()
    main = threading.current_thread() is threading.main_thread()
    taken = [each for each in SIGNALS if main and signal.getsignal(each) in OURS_TO_TAKE]
    before = [(each, signal.signal(each, ending.receive)) for each in taken]
    try:
        yield ending
    finally:
        for each, handler in before:
            signal.signal(each, handler)
