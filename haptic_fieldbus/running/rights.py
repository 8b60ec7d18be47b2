"""Rights that a run in real time requests from the operating system, so that other work does not delay it.

The system may refuse each right; the run continues with the granted ones, and reports both. Everything is restored at
the end of the block, because a run may be part of another program. A thread at SCHED_FIFO has priority over all
ordinary work of the machine. It cannot block the machine: the loop sleeps in every period and ends itself when it
misses too many periods, and the kernel leaves 5 % of each second to others (/proc/sys/kernel/sched_rt_runtime_us).

Reference: sched(7), mlockall(2), PR_SET_TIMERSLACK(2const), Documentation/power/pm_qos_interface.rst of Linux.
"""

import ctypes
import os
import struct
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from statistics import quantiles
from threading import Thread
from typing import TypeVar

from haptic_fieldbus.assessing.loop_report import LATE_SHARE
from haptic_fieldbus.assessing.result import Right
from haptic_fieldbus.buses.scan_result import Check
from haptic_fieldbus.clock import Clock, MonotonicClock
from haptic_fieldbus.numerals import rounded

PRIORITY = 49
"""Priority of SCHED_FIFO, 1 to 99: below 50, that of a real-time kernel's interrupt threads, which deliver frames."""
IDLE_STATES = Path("/dev/cpu_dma_latency")
"""While a program holds this file open with the value 0 µs, no processor enters a sleep state with a late wake-up."""
TIMER_SLACK_NS = 1
"""Time by which the kernel may delay a wake-up; 50 µs by default. At SCHED_FIFO it is 0 anyway."""

_SET_TIMER_SLACK, _GET_TIMER_SLACK = 29, 30
_LOCK_PRESENT, _LOCK_FUTURE = 1, 2
_MAY_LOCK = 1 << 14
"""CAP_IPC_LOCK (linux/capability.h)."""
LIMITS = (
    f"to get it, write two lines, `@GROUP - rtprio {PRIORITY}` and `@GROUP - memlock unlimited`, into "
    "/etc/security/limits.d/haptic.conf and log in again; a systemd unit has "
    f"LimitRTPRIO={PRIORITY} and LimitMEMLOCK=infinity; one interpreter alone: "
    f"setcap cap_sys_nice,cap_ipc_lock+ep {os.path.realpath(sys.executable)}"
)
"""Advice for SCHED_FIFO and for locked memory."""
IDLE_ADVICE = (
    'to keep processors out of deep idle states, write KERNEL=="cpu_dma_latency", GROUP="GROUP", MODE="0660" into '
    "/etc/udev/rules.d/99-haptic.rules and restart"
)

REST, LONGEST_REST = 9.0, 0.5
"""Rest of another thread after its work, as a multiple of the time of the work, and at most [s]."""

T = TypeVar("T")
Outcome = tuple[Right, Callable[[], object] | None]
"""A right that was requested, and the function that puts back what was before; None where nothing changed."""


def real_time(*, pinned: bool = True) -> AbstractContextManager[tuple[Right, ...]]:
    """Request all rights for punctual wake-ups of this thread; yield the outcome of each.

    `pinned` requests one processor too. Locked memory concerns the whole process, all other rights this thread alone.
    """
    # The slack is first, because a thread at SCHED_FIFO cannot set it.
    return requested(_timer_slack, _fifo, *((_one_processor,) if pinned else ()), _locked_memory, _no_idle_states)


@contextmanager
def requested(*wishes: Callable[[], Outcome]) -> Iterator[tuple[Right, ...]]:
    """Request rights one after another; yield the outcome of each, and put everything back after the block."""
    rights = list[Right]()
    with ExitStack() as held:
        for wish in wishes:
            right, restore = wish()
            rights.append(right)
            held.callback(restore or (lambda: None))
        yield tuple(rights)


def _fifo() -> Outcome:
    """Request SCHED_FIFO; an existing real-time class of this thread stays."""
    wished = f"SCHED_FIFO {PRIORITY}"
    if not hasattr(os, "sched_setscheduler"):
        return Right("scheduling", wished, "system default", False), None
    before, priority = os.sched_getscheduler(0), os.sched_getparam(0)
    if before in REAL_TIME:
        return Right("scheduling", wished, f"{REAL_TIME[before]} {priority.sched_priority}", True), None
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError:
        return Right("scheduling", wished, "normal scheduling", False, LIMITS), None
    return Right("scheduling", wished, wished, True), partial(os.sched_setscheduler, 0, before, priority)


REAL_TIME = {getattr(os, name): name for name in ("SCHED_FIFO", "SCHED_RR", "SCHED_DEADLINE") if hasattr(os, name)}
"""Scheduling classes with priority over ordinary work, by number."""


def make_as_urgent(threads: Iterable[Thread]) -> None:
    """Give threads the real-time class of this one, if it has one, one priority below it.

    A thread that computes holds the interpreter, also while it waits for a processor behind ordinary work.
    """
    policy = os.sched_getscheduler(0) if hasattr(os, "sched_getscheduler") else -1
    if policy in REAL_TIME:
        below = os.sched_param(max(1, os.sched_getparam(0).sched_priority - 1))
        for thread in threads:
            with suppress(OSError):
                os.sched_setscheduler(thread.native_id or 0, policy, below)


class WorkAside:
    """Work of another thread beside a loop in real time; it rests between, so that the loop has the interpreter."""

    def __init__(self) -> None:
        self._rested = 0.0
        """Time from which the next work may begin [s]."""

    def do(self, work: Callable[[], T]) -> T:
        """Rest from the work before, do this one, and return its result."""
        time.sleep(max(0.0, self._rested - time.monotonic()))
        began = time.monotonic()
        try:
            return work()
        finally:
            ended = time.monotonic()
            self._rested = ended + min(LONGEST_REST, REST * (ended - began))


def _one_processor() -> Outcome:
    """Request one processor, if a thread at SCHED_FIFO could run on many."""
    if not hasattr(os, "sched_setaffinity"):
        return Right("processor", "one processor", "any", False), None
    before = os.sched_getaffinity(0)
    chosen = processor_of(before, os.cpu_count() or 1) if os.sched_getscheduler(0) in REAL_TIME else None
    if chosen is None:
        allowed = f"processor {max(before)}" if len(before) == 1 else f"any of {len(before)} processors"
        return Right("processor", allowed, allowed, True), None
    wished = f"processor {chosen}"
    try:
        os.sched_setaffinity(0, {chosen})
    except OSError:
        return Right("processor", wished, "any", False), None

    def restore() -> None:
        with suppress(OSError):  # a processor may have gone meanwhile
            os.sched_setaffinity(0, before)

    return Right("processor", wished, wished, True), restore


MANY = 4
"""Least number of processors to reserve one for the loop; with fewer, threads of higher priority may delay it."""


def processor_of(allowed: set[int], count: int) -> int | None:
    """Return the processor for a loop that may run on these of `count`; None: leave it free to move.

    It is the last one, because the first ones serve most interrupts. An earlier choice of processors stays.
    """
    return max(allowed) if len(allowed) == count >= MANY else None


def _locked_memory() -> Outcome:
    """Request locked memory; memory that the calling program had locked stays locked."""
    wished = "memory locked"
    if not sys.platform.startswith("linux"):
        return Right("memory", wished, "not locked", False), None
    locked = _status("VmLck", 10)
    limit = _memory_limit()
    # Under a limit, memory that is locked as soon as it is asked for would be refused in the middle of the run.
    flags = _LOCK_PRESENT | (_LOCK_FUTURE if limit is None else 0)
    if _libc().mlockall(flags):
        return Right("memory", wished, f"at most {(limit or 0) >> 20} MiB", False, LIMITS), None
    return Right("memory", wished, wished, True), None if locked else _libc().munlockall


def _timer_slack() -> Outcome:
    """Request wake-ups without delay."""
    wished = f"timer slack {TIMER_SLACK_NS} ns"
    before = _libc().prctl(_GET_TIMER_SLACK, 0, 0, 0, 0) if sys.platform.startswith("linux") else -1
    if before < 0 or _libc().prctl(_SET_TIMER_SLACK, TIMER_SLACK_NS, 0, 0, 0):
        return Right("timer_slack", wished, "system default", False), None
    return Right("timer_slack", wished, wished, True), partial(_libc().prctl, _SET_TIMER_SLACK, before, 0, 0, 0)


def _no_idle_states() -> Outcome:
    """Request processors without deep sleep; most systems grant it to root alone, and many virtual machines lack it."""
    wished = "no deep idle states"
    try:
        held = os.open(IDLE_STATES, os.O_WRONLY)
    except OSError as error:
        advice = "" if isinstance(error, FileNotFoundError) else IDLE_ADVICE
        return Right("idle_states", wished, "chosen by the kernel", False, advice), None
    os.write(held, struct.pack("i", 0))
    return Right("idle_states", wished, wished, True), partial(os.close, held)


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _memory_limit() -> int | None:
    """Return the limit of locked memory [octets]; None without a limit."""
    from resource import RLIM_INFINITY, RLIMIT_MEMLOCK, getrlimit  # Windows has none

    limit = getrlimit(RLIMIT_MEMLOCK)[0]
    return None if limit == RLIM_INFINITY or _status("CapEff", 16) & _MAY_LOCK else limit


def _status(name: str, base: int) -> int:
    """Return a number of /proc/self/status; 0 if it is missing."""
    with suppress(OSError):
        for line in Path("/proc/self/status").read_text(encoding="utf-8").splitlines():
            key, _, text = line.partition(":")
            if key == name:
                return int(text.split()[0], base)
    return 0


# Checks of this computer for a loop in real time: its clock, how late it wakes up, and the rights that it gives.

MEASURED = 1.0
"""Duration of the measurement of wake-ups [s]."""
RESOLUTION = 1e-6
"""Coarsest clock resolution that still separates periods [s]."""


def examine(of_the_buses: Callable[[], Iterable[Check]], rate: float) -> list[Check]:
    """Return the checks of buses and computer for a run of `rate` [Hz], made with the rights of such a run."""
    with real_time() as rights:
        buses = list(of_the_buses())
        return [*buses, clock_check(), wake_up_check(lateness(MonotonicClock(), rate), rate), *map(right_check, rights)]


def right_check(right: Right) -> Check:
    """Return a right as a check."""
    return Check(right.name, right.granted, right.got, right.advice)


def clock_check() -> Check:
    """Check the resolution of the clock of the loop."""
    info = time.get_clock_info("monotonic")
    fine = info.monotonic and info.resolution <= RESOLUTION
    measured = f"{info.implementation}, steps of {rounded(1e9 * info.resolution)} ns"
    return Check(
        "clock", fine, measured, "" if fine else "use Linux: the clock of this system is too coarse for the loop"
    )


def lateness(clock: Clock, rate: float, measured: float = MEASURED) -> list[float]:
    """Wait for the periods of `rate` [Hz] for a time [s], and return the lateness of each [s]."""
    period_ns, began_ns = round(1e9 / rate), clock.now_ns()
    number = max(2, round(measured * rate))
    return [clock.sleep_until(began_ns + at * period_ns) * 1e-9 for at in range(1, number + 1)]


def wake_up_check(late: Sequence[float], rate: float) -> Check:
    """Check that 99 of 100 periods of `rate` [Hz] begin late by no more than a tenth of the period."""
    cuts = quantiles(late, n=100, method="inclusive")
    punctual = cuts[98] <= LATE_SHARE / rate
    measured = (
        f"late by {rounded(1e6 * cuts[49])} µs (median), {rounded(1e6 * cuts[98])} µs (p99), "
        f"{rounded(1e6 * max(late))} µs (max) at {rounded(rate)} Hz"
    )
    advice = (
        "reduce the load of this computer, give the program real-time rights (scheduling, memory), or lower --rate: a "
        f"period should start at most {rounded(1e6 * LATE_SHARE / rate)} µs late"
    )
    return Check("wake_up", punctual, measured, "" if punctual else advice)
