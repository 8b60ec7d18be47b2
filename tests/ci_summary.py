"""The end of `.ci/run`: `python -m tests.ci_summary TIMES JUNIT …`.

Prints how long each step took, which tests took longest, and, as the last line, how many passed and failed in all runs.
Processor time is told in units of a fixed computation that is measured beside it, so that machines can be compared.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from xml.etree import ElementTree

from tests.coverage_gates import summary_line

SLOWEST = 10
REPEATS = 5


@dataclass(frozen=True)
class Step:
    """One command of `.ci/run`."""

    seconds: int
    processor: float
    """Processor time of all its processes [s]."""
    status: int
    command: str

    @classmethod
    def read(cls, line: str) -> "Step":
        seconds, hundredths, status, command = line.split("\t", 3)
        return cls(int(seconds), int(hundredths) / 100, int(status), command)

    def line(self, unit: float) -> str:
        """Return what is printed of it; `unit` is the processor time of the fixed computation [s]."""
        outcome = "ok" if self.status == 0 else f"FAILED with {self.status}"
        return f"{self.seconds:5d} s {self.processor:6.0f} s {self.processor / unit:8.0f}  {self.command}: {outcome}"


def counted() -> int:
    """A fixed piece of work for the interpreter."""
    total = 0
    for number in range(500_000):
        total += number * number % 7
    return total


def best_ms(work: Callable[[], object]) -> float:
    """The shortest of several repetitions [ms]: what disturbs only makes it longer."""
    times = []
    for _ in range(REPEATS):
        begin = process_time()
        work()
        times.append(1e3 * (process_time() - begin))
    return min(times)


def slowest(files: list[Path]) -> Iterator[tuple[float, str]]:
    """The tests that took longest, and how long [s]."""
    cases = [case for file in files for case in ElementTree.parse(file).getroot().iter("testcase")]
    timed = [(float(case.get("time", "0")), f"{case.get('classname')}::{case.get('name')}") for case in cases]
    yield from sorted(timed, reverse=True)[:SLOWEST]


def main(times: Path, files: list[Path]) -> int:
    there = [file for file in files if file.exists()]
    steps = [Step.read(line) for line in times.read_text().splitlines()]
    print("\nthe slowest tests")
    for seconds, name in slowest(there):
        print(f"{seconds:7.2f} s  {name}")
    unit = best_ms(counted)
    print("\ntime, processor time, and that in units of a fixed computation")
    for step in steps:
        print(step.line(1e-3 * unit))
    print(f"{sum(step.seconds for step in steps):5d} s {sum(step.processor for step in steps):6.0f} s in all")
    print(f"the fixed computation on this machine: {unit:.0f} ms")
    for file in set(files) - set(there):
        print(f"FAILED: {file} was not written")
    print(summary_line(*there))
    return 0 if len(there) == len(files) and all(step.status == 0 for step in steps) else 1


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), [Path(word) for word in sys.argv[2:]]))
