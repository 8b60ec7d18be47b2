"""Real vendors' EDS and DCF files, and what an independent reader found in them.

They may not be distributed. So `make test-vendor` alone reads them, from the folder that the environment variable
HAPTIC_FIELDBUS_VENDOR_FILES names. All other lanes read `tests/eds/peculiar.py`, where what is peculiar in vendors'
files is written again. Where another reader described the files, `SOURCES.md` in the same folder says what it found.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from haptic_fieldbus.eds import Eds, load_eds
from tests.eds.peculiar import SHEETS, sheet_eds, sheet_path
from tests.lanes import vendor_files

PATHS = {path.name: path for path in vendor_files()}
FILES = sorted(PATHS)

needs_files = pytest.mark.vendor("reads vendors' EDS files")


def both(own: Iterable[str], vendors: Iterable[str]) -> list[Any]:
    """Parametrise a test over files of our own, and in the lane of vendors' files over those of vendors."""
    return [*own, *(pytest.param(name, marks=needs_files) for name in vendors)]


def path_of(name: str) -> Path:
    """Return where a file of our own or of a vendor stands; skips the test where a vendor's file is not there."""
    if name in SHEETS:
        return sheet_path(name)
    if name not in PATHS:
        pytest.skip(f"the folder of vendors' files has no {name}")
    return PATHS[name]


@cache
def eds_of(name: str) -> Eds:
    """Return a file of our own or of a vendor, as the reader takes it."""
    return sheet_eds(name) if name in SHEETS else load_eds(path_of(name))


@dataclass(frozen=True)
class Facts:
    """One entry of SOURCES.md: its lines by their first word."""

    lines: dict[str, str]

    def line(self, head: str) -> str:
        return next(text for text in self.lines.values() if text.startswith(head))


def facts_of(name: str) -> Facts:
    """Return what another program read out of a file, as SOURCES.md has it; skips the test where it says nothing."""
    found = _facts(path_of(name).with_name("SOURCES.md"))
    if name not in found:
        pytest.skip(f"no SOURCES.md beside {name} describes it")
    return found[name]


@cache
def _facts(sources: Path) -> dict[str, Facts]:
    found: dict[str, Facts] = {}
    blocks = sources.read_text(encoding="utf-8").split("### `")[1:] if sources.exists() else []
    for block in blocks:
        name, _, text = block.partition("`")
        lines = [line.removeprefix("- ") for line in text.splitlines() if line.startswith("- ")]
        found[name] = Facts({re.split(r"[ :]", line)[0]: line for line in lines})
    return found
