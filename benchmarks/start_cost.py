"""Processor time of commands from start to end, beside a Python that imports the libraries that they need."""

import os
import subprocess
import sys
from contextlib import ExitStack
from functools import partial

from rows import Figure, Pair, Row, show

# As on users' machines, where bytecode is written once.
ENVIRONMENT = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
TYPER, ALL = "import typer", "import numpy, typer, pydantic, can, canopen"


def used(*words: str) -> float:
    """Return the processor time of a Python with these arguments [s]."""
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.DEVNULL, env=ENVIRONMENT) as process:
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise SystemExit(f"python {' '.join(words)} ended with {process.returncode}")
    return usage.ru_utime + usage.ru_stime


def pair(command: str, reference: str, _: ExitStack) -> Pair:
    words = ("-m", "haptic_fieldbus", *command.split())
    used(*words)  # bytecode is written once
    return lambda: (min(used(*words) for _ in range(2)), min(used("-c", reference) for _ in range(2)))


FIGURES = (
    Figure("`--help`", "importing typer", 2.5, partial(pair, "--help", TYPER)),
    Figure("`plan wall`", "importing numpy, typer, pydantic, can and canopen", 1.5, partial(pair, "plan wall", ALL)),
    Figure(
        "`run wall` of two periods, with its result",
        "importing numpy, typer, pydantic, can and canopen",
        2.0,
        partial(pair, "run wall --duration 0.002", ALL),
    ),
)


if __name__ == "__main__":
    show([Row(each.name, *each.pair(ExitStack())(), each.bound) for each in FIGURES])
