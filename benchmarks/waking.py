"""How late does a thread wake up that sleeps until the begin of each period, and what mends it on this computer?

Every row is a process of its own that sleeps at 1 kHz. All rows of a table run one after another, several times in
turn, so that a disturbance of the computer falls on each of them. The tables differ by what the processors do
meanwhile: nothing (an idle virtual processor is given back to its host, and wakes up later), or a busy program each, at
the lowest priority. `spinning` sleeps until 0.1 ms before the begin, and then looks at the clock without pause.
"""

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import numpy as np
from rows import machine

from haptic_fieldbus.running import rights

PERIOD_NS = 1_000_000
SPIN_NS = 100_000
ROUNDS = 4
ROWS = {
    "as it is": "",
    "timer slack 1 ns": "slack",
    "SCHED_FIFO": "slack fifo",
    "SCHED_FIFO, one processor": "slack fifo processor",
    "SCHED_FIFO, no idle states": "slack fifo awake",
    "spinning, timer slack 1 ns": "slack spin",
    "spinning, SCHED_FIFO": "slack fifo spin",
}
WISHES = {
    "slack": rights._timer_slack,
    "fifo": rights._fifo,
    "processor": rights._one_processor,
    "awake": rights._no_idle_states,
}


def main() -> None:
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("--seconds", type=float, default=20.0, help="of each row")
    seconds = asked.parse_args().seconds
    print(machine())
    for load in ("idle", "busy"):
        print(f"\n{load} computer: late by [µs] 50 %, 99 %, 99.9 %, most; processor time of the thread")
        with busy() if load == "busy" else nullcontext():
            samples: dict[str, list[str]] = {name: [] for name in ROWS}
            for _ in range(ROUNDS):
                for name, wishes in ROWS.items():
                    samples[name].append(in_a_process(wishes, seconds / ROUNDS))
        for name, texts in samples.items():
            print(f"  {name:28} {told(texts)}")


def told(texts: list[str]) -> str:
    """All rounds of a row in a line."""
    if "refused" in texts[0]:
        return texts[0]
    used, late = zip(*[text.split(maxsplit=1) for text in texts], strict=True)
    values = np.percentile(np.concatenate([np.fromstring(text, sep=" ") for text in late]), [50, 99, 99.9, 100])
    return f"{' '.join(f'{value:7.0f}' for value in values)}   {100 * np.mean([float(text) for text in used]):.1f} %"


def in_a_process(wishes: str, seconds: float) -> str:
    words = [sys.executable, __file__, "--sleep", wishes, str(seconds)]
    return subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True).stdout.strip()


def sleep(wishes: list[str], seconds: float) -> None:
    """Be one row: print the share of processor time, and the lateness of each period [µs]."""
    spin_ns = SPIN_NS if "spin" in wishes else 0
    with rights.requested(*(WISHES[wish] for wish in wishes if wish in WISHES)) as got:
        refused = [right.wished for right in got if not right.granted]
        if refused:
            print(f"refused: {', '.join(refused)}")
            return
        late = []
        used = time.process_time()
        deadline_ns = time.monotonic_ns() + PERIOD_NS
        for _ in range(round(1e9 * seconds / PERIOD_NS)):
            time.sleep(max(0, deadline_ns - spin_ns - time.monotonic_ns()) * 1e-9)
            while (now_ns := time.monotonic_ns()) < deadline_ns:
                pass
            late.append(now_ns - deadline_ns)
            deadline_ns += (1 + (now_ns - deadline_ns) // PERIOD_NS) * PERIOD_NS
        used = time.process_time() - used
    print(used / seconds, *(f"{each / 1e3:.1f}" for each in late))


@contextmanager
def busy() -> Iterator[None]:
    """A program that computes on each processor."""
    program = "import os; os.nice(19)\nwhile True: pass"
    running = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for each in running:
            each.kill()
            each.wait()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--sleep"]:
        sleep(sys.argv[2].split(), float(sys.argv[3]))
    else:
        main()
