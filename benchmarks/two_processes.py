"""Do `simulate` and `run` live side by side at 1 kHz on this computer, and is the loop as punctual as a bare timer?

Each start is two real processes over UDP multicast, `simulate --hand push` and `run wall --rate 1000`, and a third one
that only sleeps and looks at the clock, in the scheduling class of the loop and at the same time. What delays all three
is the computer. Printed for each start: how it ended, the time stolen by other virtual machines (/proc/stat), and both
latenesses.

With the right to SCHED_FIFO two things must hold. No start ends because feedback was too old or periods were late,
unless the timer itself was later than the age that trips less 5 ms, or its own gaps, rated as the loop rates its own
(`cycle.gaps`: what they cost at their worst timing), were as bad as those that ended the run; such a start is told and
not counted. And the lateness of the loop, of all starts together, is at most 1.5 times that of the timer (99.9 %). Exit
status 1 otherwise.
"""

import argparse
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rows import machine

PROJECT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(PROJECT))

GROUP, NODE, RATE = "239.74.163.2", 5, 1000
PERIOD_NS = 1_000_000_000 // RATE
TRIP_AGE, TO_SPARE = 0.030, 0.005
"""[s]; 0.6 of the guard of 50 ms, and what of it the timer must leave for a start to count."""
LATE_ENDS = re.compile(r"feedback.*(old|lost)|loop (missed|slept)|position|acceleration|speed")
"""Words by which a run tells that it ended on the age of data or on late periods, or on what these do to the wall: on a
bench that nothing else disturbs, a handle that leaves it went through a wall that was not there."""
CAPPED = re.compile(r"stayed limited to its value\s+before\s+the\s+gap, in (\d+) %")
"""Words by which a run tells that gaps took the force of the wall until contact is left, and for how long."""
BESIDE = re.compile(r"the scene was displaced by up\s+to\s+([\d.]+) mm")
"""Words by which a run tells how far short gaps moved the wall until contact is left."""
STRETCHED = re.compile(r"divides\s+the\s+stiffness\s+limit\s+by\s+([\d.]*\d)")
"""Words by which a run tells that it ended on many gaps within a second, each of them short."""
ALIKE = 0.95
"""Share of what ended the run that the timer must show to excuse it."""
WORST = 1.5
"""Largest lateness of the loop, as a multiple of the timer's."""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """One start: exit status and last words of `run`, stolen time as a share, and both latenesses [µs]."""

    status: int
    words: str
    stolen: float
    loop: Array
    timer: Array
    age: dict[str, float]
    missed: int
    rights: tuple[str, ...]
    force_age: float
    """Mean age of the force in the run, in periods; gaps cost less stiffness where it is larger."""
    capped: int = 0
    """Periods in which a cap after a gap in the feedback cut the force [%]."""
    beside: float = 0.0
    """Farthest that short gaps moved the wall [mm]."""

    @property
    def late(self) -> bool:
        """Whether the run ended on the age of data or on late periods."""
        return self.status != 0 and LATE_ENDS.search(self.words) is not None

    @property
    def counted(self) -> bool:
        """Whether the timer itself was in time."""
        ended = STRETCHED.search(self.words)
        stretched = ended is not None and worst_stretch(self.timer, self.force_age) >= ALIKE * float(ended.group(1))
        return not stretched and float(self.timer.max(initial=0.0)) <= 1e6 * (TRIP_AGE - TO_SPARE)


def main() -> int:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--starts", type=int, default=5)
    asked.add_argument("--seconds", type=float, default=10.0)
    options = asked.parse_args()
    print(machine())
    print(f"{options.starts} starts of {options.seconds:g} s at {RATE} Hz, UDP multicast; lateness in µs", flush=True)
    starts = []
    with TemporaryDirectory() as folder:
        for number in range(1, options.starts + 1):
            starts.append(start(Path(folder), options.seconds))
            print(f"{number:3}  {told(starts[-1])}", flush=True)
    return judged(starts)


def worst_stretch(lateness: Array, force_age: float) -> float:
    """Return the largest stretch that the loop would see, of a thread that begins so late [µs] and skips the missed."""
    from haptic_fieldbus.cycle.gaps import Gaps

    gaps, worst, t_ns = Gaps(1.0 / RATE, force_age, math.inf), 1.0, 0
    for steps in (1 + (lateness // (1e6 / RATE)).astype(int)).tolist():
        t_ns += steps * PERIOD_NS
        if steps > 1:
            gaps.note(t_ns, steps)
            worst = max(worst, gaps.stretch)
    return worst


def told(start: Start) -> str:
    """One start in a line."""
    end = "went to its end" if start.status == 0 else f"exit {start.status}: {start.words}"
    end += f", without its wall for {start.capped} % of the time after a gap" if start.capped else ""
    end += f", with its place off by up to {start.beside:g} mm after short gaps" if start.beside else ""
    not_counted = "" if start.counted else " (not counted: the timer was late itself)"
    return (
        f"stolen {100 * start.stolen:.1f} %, loop {spread(start.loop)}, timer {spread(start.timer)}, "
        f"{start.missed} periods missed, age at most {start.age.get('max', 0.0):.0f}; {end}{not_counted}"
    )


def spread(lateness: Array) -> str:
    if not len(lateness):
        return "none"
    return "/".join(f"{value:.0f}" for value in np.percentile(lateness, [50, 99, 99.9, 100]))


def judged(starts: list[Start]) -> int:
    """Print what all starts together show; 0 when what is promised holds, or cannot be asked for."""
    loop, timer = (np.concatenate([getattr(start, name) for start in starts]) for name in ("loop", "timer"))
    print(f"all  loop {spread(loop)}, timer {spread(timer)} (50, 99, 99.9 %, most)")
    for text in starts[0].rights:
        print(f"     {text}")
    ended = [start for start in starts if start.late and start.counted]
    whole = sum(start.status == 0 for start in starts)
    walls = sum(start.status == 0 and not start.capped for start in starts)
    print(
        f"     {whole} of {len(starts)} went to their end, {walls} with their wall all the time; {len(ended)} ended "
        "late, with the timer in time"
    )
    if not len(loop):
        return 1
    ratio = float(np.percentile(loop, 99.9) / np.percentile(timer, 99.9))
    print(f"     lateness of the loop is {ratio:.2f} times the timer's at 99.9 % (at most {WORST})")
    if not os.access("/proc/self", os.R_OK) or not fifo_allowed():
        print("     without the right to SCHED_FIFO nothing is promised: any other program may go before the loop")
        return 0
    return int(bool(ended) or ratio > WORST)


def fifo_allowed() -> bool:
    """Whether this process, and so those that it starts, may have SCHED_FIFO."""
    from haptic_fieldbus.running.rights import real_time

    with real_time() as rights:
        return next(right.granted for right in rights if right.name == "scheduling")


def start(folder: Path, seconds: float) -> Start:
    """Run the three processes once."""
    from tests.peers.hosts import free_port

    port = free_port()
    rig, kept, slept = (folder / name for name in ("rig.toml", "loop.npy", "timer.npy"))
    for path in (kept, slept):
        path.unlink(missing_ok=True)
    bus = f"udp_multicast:{GROUP}@1000000"
    # Written once: what the first start proves of the drive is kept in it.
    written = () if rig.exists() else ("--write-rig", str(rig))
    simulated = ("simulate", "--drive", f"generic_cia402@{NODE}", "--bus", bus, "--hand", "push", *written)
    with process(*simulated, port=port) as drive:
        assert drive.stdout is not None
        drive.stdout.readline()
        words = (
            "run",
            "wall",
            "--set",
            "wall.stiffness=max/2",
            "--rig",
            str(rig),
            "--yes",
            "--rate",
            str(RATE),
            "--duration",
            str(seconds),
            "--json",
        )
        with (
            process("--keep", str(kept), *words, port=port, program=[__file__]) as loop,
            process("--sleep", str(slept), port=port, program=[__file__]) as timer,
        ):
            before = stolen_and_all()
            said, complaint = loop.communicate()
            after = stolen_and_all()
            timer.send_signal(signal.SIGINT)
            timer.communicate()
        drive.send_signal(signal.SIGINT)
        drive.communicate()
    return outcome(loop.returncode, said, complaint, _loaded(kept), _loaded(slept), share(before, after))


def outcome(status: int, said: str, complaint: str, loop: Array, timer: Array, stolen: float) -> Start:
    from haptic_fieldbus.assessing.result import Right, refused_texts

    figures = json.loads(said) if said.strip() else {}
    rights = [Right(**{**each, "advice": each["advice"] or ""}) for each in figures.get("host") or []]
    last = complaint.strip().splitlines()[-1] if complaint.strip() else ""
    age = (figures.get("timing") or {}).get("age_us") or {}
    missed = figures.get("missed_cycles") or 0
    words = " ".join(complaint.split())
    lost, beside = (
        0.0 if (found := each.search(words)) is None else float(found.group(1)) for each in (CAPPED, BESIDE)
    )
    granted = ", ".join(right.got for right in rights if right.granted)
    rights_told = tuple(filter(None, [granted, *refused_texts(rights)]))
    words = " ".join(last.split())
    return Start(status, words, stolen, loop, timer, age, missed, rights_told, force_age(figures), int(lost), beside)


def force_age(figures: dict[str, Any]) -> float:
    """Return the mean age of the force in periods, by the stability that a run tells; ½ where it tells none."""
    told = figures.get("stability") or {"delay_s": 0.0, "period_s": 1.0, "plant": {"torque_lag": 0.0}}
    return 0.5 + float(told["delay_s"] + told["plant"]["torque_lag"]) / float(told["period_s"])


def _loaded(path: Path) -> Array:
    return np.load(path) if path.exists() else np.empty(0)


@contextmanager
def process(
    *words: str, port: int, program: list[str] | tuple[str, ...] = ("-m", "haptic_fieldbus")
) -> Iterator["subprocess.Popen[str]"]:
    """A process on a port of its own, ended with the block."""
    running = subprocess.Popen(
        [sys.executable, *program, *words],
        cwd=PROJECT,
        env={**os.environ, "CAN_CONFIG": f'{{"port": {port}}}'},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs this in the background has Ctrl-C ignored, which children would inherit.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL) and None,
    )
    try:
        yield running
    finally:
        running.kill()
        running.communicate()


def stolen_and_all() -> tuple[int, int]:
    """Time stolen from all processors since the computer was started, and all time, in ticks; zeros where unknown."""
    try:
        ticks = [int(text) for text in Path("/proc/stat").read_text(encoding="utf-8").splitlines()[0].split()[1:]]
    except OSError:
        return 0, 0
    return ticks[7], sum(ticks[:8])


def share(before: tuple[int, int], after: tuple[int, int]) -> float:
    return (after[0] - before[0]) / max(1, after[1] - before[1])


def keep(path: Path, words: list[str]) -> None:
    """Be the command line, and keep the lateness of every period, of which it tells percentiles only."""
    from haptic_fieldbus import api, cli
    from haptic_fieldbus.assessing.result import Result
    from haptic_fieldbus.errors import HapticFieldbusError
    from haptic_fieldbus.planning.request import Task
    from haptic_fieldbus.recordings.provenance import Provenance

    def kept(result: Result | None) -> None:
        if result is not None and result.periods is not None:
            np.save(path, 1e6 * result.periods.lateness)

    run = api.run_task

    def noted(task: Task, trial: api.Trial, repeats: Provenance | None = None) -> Result:
        try:
            result = run(task, trial, repeats)
        except HapticFieldbusError as error:
            kept(getattr(error, "result", None))
            raise
        kept(result)
        return result

    api.run_task = noted
    cli.main(words)


def sleep(path: Path) -> None:
    """Be the bare timer, until SIGINT: every period sleep until its begin, and look how late it is."""
    from haptic_fieldbus.running.rights import real_time

    ended: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: ended.append(number))
    lateness = []
    with real_time(pinned=False):
        deadline_ns = time.monotonic_ns() + PERIOD_NS
        while not ended:
            time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
            late_ns = time.monotonic_ns() - deadline_ns
            lateness.append(late_ns)
            deadline_ns += (1 + late_ns // PERIOD_NS) * PERIOD_NS
    np.save(path, np.array(lateness) / 1e3)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--keep"]:
        keep(Path(sys.argv[2]), sys.argv[3:])
    elif sys.argv[1:2] == ["--sleep"]:
        sleep(Path(sys.argv[2]))
    else:
        sys.exit(main())
