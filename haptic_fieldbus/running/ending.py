"""Signals that end a run: Ctrl-C, SIGTERM (`kill`, a service manager) and SIGHUP (a terminal that is closed).

During the configuration of the drives, a signal raises KeyboardInterrupt, because there is no torque to switch off.
From `hold` on signals are only noted: the loop sees the note between two periods. However often Ctrl-C is pressed, it
interrupts neither the way to zero torque nor the computation of the result. Once all drives have confirmed that they
are off, `freed` limits this: a signal more than `RESULT_TIME` later raises again and abandons the result.

A nested block, such as a run inside a command, shares the signals of the outer one.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
from time import monotonic
from types import CodeType, FrameType
from typing import TYPE_CHECKING, Any

from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:  # a command without a run never loads it, and numpy with it
    from haptic_fieldbus.assessing.loop_report import LoopReport
    from haptic_fieldbus.assessing.result import Stopped

SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)  # Windows has no SIGHUP
OURS_TO_TAKE = (signal.SIG_DFL, signal.default_int_handler)
"""Default handlers, which are replaced; others, such as those of `nohup` or of the calling program, stay."""
EARLY = " before enabling: no torque was applied"
"""Time of the stop in a sentence, for a run without enabled drives."""
SWALLOWED = (("_weakrefset", "_remove"), ("weakref", "remove"))
"""Module and name of callbacks in which an exception is lost: CPython prints it and goes on."""
AGAIN = 1.0
"""Time after a KeyboardInterrupt in which further signals are only noted, because the run already ends [s]."""
RESULT_TIME = 10.0
"""Time for which signals are held after the drives have confirmed that they are off [s]."""


class EndSignals:
    """Signals that requested the end of a run; `now` is a clock [s]."""

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self.signal: int | None = None
        """Number of the first signal; None before the first."""
        self.when = ""
        """Time of the stop in words, as the end of `sentence`."""
        self.last = False
        """True if the process ends with the block: signals are ignored after it, so that they kill no interpreter."""
        self.unbroken: CodeType | None = None
        """Function that no signal interrupts, whatever it calls: by it the caller of a session ends its run."""
        self.over = False
        """True after the block."""
        self.before: dict[int, Any] = {}
        """Handlers of the signals that were taken."""
        self._now = now
        self._raises_from = -inf
        """Time from which on signals raise [s]."""

    @property
    def leaving(self) -> bool:
        """True while signals are held, and after the first signal: no output may wait for its reader."""
        return self._raises_from > -inf

    @property
    def name(self) -> str:
        """Name of the first signal; the name of Ctrl-C for a KeyboardInterrupt of another origin."""
        return signal.Signals(self.signal or signal.SIGINT).name

    @property
    def sentence(self) -> str:
        """Return the sentence that names the signal that stopped the run, and the time."""
        return f"stopped by {'you' if self.name == 'SIGINT' else self.name}{self.when}"

    def stopped(self, report: "LoopReport", duration: float) -> "Stopped | None":
        """Return the stop of a run of `duration` [s] by a signal, as `sentence` describes it; None without a signal."""
        self.when = " after the end of the run; its result is complete"
        if not report.interrupted:
            return None
        from haptic_fieldbus.assessing.result import Stopped
        from haptic_fieldbus.planning.request import LONGEST

        time = None if report.enabled_at_ns is None else report.duration
        whole = f" of {exactly(duration)} s" if duration < LONGEST else ""  # a session without a duration has none
        self.when = EARLY if time is None else f" at {time:.1f} s{whole}"
        return Stopped(self.name, time, duration, self.sentence)

    def hold(self) -> None:
        """Only note signals from now on."""
        self._raises_from = inf

    def freed(self) -> None:
        """Hold signals for `RESULT_TIME` more: every drive has confirmed that it is off."""
        self._raises_from = self._now() + RESULT_TIME

    def resume(self) -> None:
        """Let signals raise again; raises KeyboardInterrupt when one was noted."""
        self._raises_from = -inf
        if self.signal is not None:
            raise KeyboardInterrupt

    def receive(self, number: int, frame: FrameType | None = None) -> None:
        """Note a signal; raises KeyboardInterrupt unless signals are held, or an exception would be lost here."""
        if self.over:
            self.put_back()
            signal.raise_signal(number)
            return
        self.signal = self.signal or number
        while frame is not None:
            named = frame.f_globals.get("__name__"), frame.f_code.co_name
            if frame.f_code is self.unbroken or named in SWALLOWED or named[1] == "__del__":
                return
            frame = frame.f_back
        now = self._now()
        if now >= self._raises_from:
            self._raises_from = now + AGAIN
            raise KeyboardInterrupt

    def put_back(self) -> None:
        """Put the earlier handlers back.

        Only the main thread can do so. When another one ends the block, the next signal or the next block does.
        """
        self.over = True
        if _is_main():
            for number, handler in self.before.items():
                if signal.getsignal(number) == self.receive:
                    signal.signal(number, signal.SIG_IGN if self.last else handler)


def _is_main() -> bool:
    return threading.current_thread() is threading.main_thread()


@contextmanager
def ended_by_signals(now: Callable[[], float] = monotonic) -> Iterator[EndSignals]:
    """Yield an `EndSignals` that signals reach inside the block; outside the main thread none do."""
    handlers = {each: signal.getsignal(each) for each in SIGNALS if _is_main()}
    owners = [owner for each in handlers.values() if isinstance(owner := getattr(each, "__self__", None), EndSignals)]
    if owners and not owners[0].over:
        yield owners[0]
        return
    for owner in owners:
        owner.put_back()
    ending = EndSignals(now)
    for each in handlers:
        if signal.getsignal(each) in OURS_TO_TAKE:
            ending.before[each] = signal.signal(each, ending.receive)
    try:
        yield ending
    finally:
        ending.put_back()
