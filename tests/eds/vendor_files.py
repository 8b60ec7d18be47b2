"""The vendors' EDS and DCF files that the tests read where they are, and what an independent reader found in them.

They may not be distributed, so they are looked for beside the checkout and tests that need them are skipped visibly.
"""

import os
import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from haptic_fieldbus.eds import Eds, load_eds

CHECKOUT = Path(__file__).resolve().parents[2]
FOLDER = Path(os.environ.get("HAPTIC_FIELDBUS_SHARED", CHECKOUT.parent / "shared")) / "eds"
FILES = sorted(path.name for path in FOLDER.glob("*.[ed][dc][sf]"))
SOURCES = FOLDER / "SOURCES.md"

needs_files = pytest.mark.skipif(
    not FILES, reason="no vendor EDS files: put them in HAPTIC_FIELDBUS_SHARED/eds, or into ../shared/eds"
)


@cache
def vendor_eds(name: str) -> Eds:
    return load_eds(FOLDER / name)


@dataclass(frozen=True)
class Facts:
    """One entry of SOURCES.md: its lines by their first word."""

    lines: dict[str, str]

    def line(self, head: str) -> str:
        return next(text for text in self.lines.values() if text.startswith(head))


@cache
def facts() -> dict[str, Facts]:
    """What SOURCES.md says of each file; another program read that out of the files."""
    found: dict[str, Facts] = {}
    for block in SOURCES.read_text(encoding="utf-8").split("### `")[1:]:
        name, _, text = block.partition("`")
        lines = [line.removeprefix("- ") for line in text.splitlines() if line.startswith("- ")]
        found[name] = Facts({re.split(r"[ :]", line)[0]: line for line in lines})
    return found
