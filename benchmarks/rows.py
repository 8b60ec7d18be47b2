"""Figures beside a reference of the same run."""

import os
import platform
import timeit
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from haptic_fieldbus.numerals import exactly


@dataclass(frozen=True)
class Row:
    """Ours and the reference [s]; `allowed` is the largest ratio that is promised anywhere."""

    name: str
    ours: float
    reference: float
    allowed: float | None = None

    @property
    def ratio(self) -> float:
        return self.ours / self.reference


class NotHereError(Exception):
    """A figure needs what this computer does not have; its text says what."""


Pair = Callable[[], tuple[float, float]]
"""Measures ours and the reference [s], one right after the other."""


@dataclass(frozen=True)
class Figure:
    """One figure of `bench.py`; `pair` sets up what it needs on the stack, which ends it, or raises NotHereError."""

    name: str
    reference: str
    """Name of what it stands beside."""
    bound: float
    """Largest ratio that is promised."""
    pair: Callable[[ExitStack], Pair]


PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "performance.md"
"""Page of a checkout; `haptic-fieldbus bench` has none."""


def put_on_page(command: str, text: str) -> None:
    """Put a table into the page, between the line that names its command and the next end."""
    begin, end = f"<!-- written by python benchmarks/{command} -->\n", "<!-- end -->\n"
    before, rest = PAGE.read_text(encoding="utf-8").split(begin)
    _, after = rest.split(end, 1)
    PAGE.write_text(f"{before}{begin}\n{text}\n{end}{after}", encoding="utf-8")


def cost(call: Callable[[], object], number: int, repeat: int = 30) -> float:
    """Shortest time of one call [s]."""
    return min(timeit.repeat(call, number=number, repeat=repeat)) / number


def show(rows: list[Row]) -> None:
    print(machine())
    for row in rows:
        promise = "" if row.allowed is None else f", at most {exactly(row.allowed)} promised"
        print(
            f"{row.name}: {row.ours * 1e6:.2f} µs beside {row.reference * 1e6:.2f} µs, ratio {row.ratio:.2f}{promise}"
        )


def machine() -> str:
    """Processor and interpreter."""
    return (
        f"{_processor()}, {os.cpu_count()} processors, Linux {platform.release()}, Python {platform.python_version()}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
