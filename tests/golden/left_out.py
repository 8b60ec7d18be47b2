"""Parts that a scene truly uses, seen from outside, and the golden text of it.

A text has public names only: modules that a fresh interpreter imports, mapped objects, steps of the plan, and modules
whose functions run in a period. The plain wall is the scene that all others are told beside: its text lists every
imported module, and theirs list those that they have beyond it (+) and do without (-).
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FOLDER = Path(__file__).parent / "left_out"
PROJECT = Path(__file__).resolve().parents[2]
PLAIN = "wall"


@dataclass(frozen=True)
class Observed:
    """One scene in an interpreter of its own; modules without the name of the package."""

    imported: Sequence[str]
    mapped: Sequence[str]
    steps: Sequence[str]
    called: Sequence[str]
    """Modules whose functions run in a period."""
    most_calls: int
    """The largest number of calls of functions of the package in one period."""


@cache
def observed(scene: str) -> Observed:
    """Watch a scene; RuntimeError with the interpreter's own words when that fails."""
    command = [sys.executable, "-m", "tests.golden.observer", scene]
    done = subprocess.run(command, cwd=PROJECT, check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{scene}: {done.stderr}")
    return Observed(**json.loads(done.stdout))


def text_of(scene: str) -> str:
    """The golden text of a scene."""
    found = observed(scene)
    parts = (_imported(scene), ("mapped", found.mapped), ("steps", found.steps), ("called in a period", found.called))
    return "".join("\n".join([title, *(f"  {line}" for line in lines)]) + "\n" for title, lines in parts)


def _imported(scene: str) -> tuple[str, Sequence[str]]:
    """The title and the lines of the modules that are imported."""
    if scene == PLAIN:
        return "imported", observed(scene).imported
    ours, plain = set(observed(scene).imported), set(observed(PLAIN).imported)
    lines = [f"+ {name}" for name in sorted(ours - plain)] + [f"- {name}" for name in sorted(plain - ours)]
    return f"imported, beside the {PLAIN}", lines
