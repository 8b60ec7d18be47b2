"""Copies of this checkout, in which programs run by the code of the copy."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.new_things import MAKE_DOCS, Step

PROJECT = Path(__file__).resolve().parents[1]
INHERITED = ("COV_", "COVERAGE_", "PYTEST_", "GIT_")
"""Variables that belong to the tests around this one."""


@dataclass(frozen=True)
class Checkout:
    """A copy that programs run in, by its own code."""

    folder: Path

    def call(self, *command: str) -> subprocess.CompletedProcess[str]:
        own = {name: value for name, value in os.environ.items() if not name.startswith(INHERITED)}
        own["PYTHONPATH"] = str(self.folder)
        return subprocess.run(command, cwd=self.folder, env=own, capture_output=True, text=True)

    def take(self, step: "Step") -> None:
        path = self.folder / step.path
        path.write_text(step.edit(path.read_text(encoding="utf-8") if path.exists() else ""), encoding="utf-8")

    def test(self, *words: str) -> subprocess.CompletedProcess[str]:
        """Run quick tests of the copy, without differences of long values: their computation may take hours."""
        plain = ("--assert=plain", "-p", "no:cacheprovider")
        return self.call(sys.executable, "-m", "pytest", "-q", "--lane", "quick", *plain, *words)

    def generate(self, generator: str) -> None:
        """With the programs of the environment around this test: nothing is installed."""
        if generator == MAKE_DOCS:
            done = self.call("make", "--old-file=setup", "docs", f"BIN={Path(sys.executable).parent}")
        else:
            done = self.call(sys.executable, *generator.split()[1:])
        assert done.returncode == 0, done.stdout + done.stderr

    def changed(self) -> set[str]:
        status = self.call("git", "status", "--porcelain", "--untracked-files=all").stdout
        return {line[3:] for line in status.splitlines()}


def copied(folder: Path) -> Checkout:
    """Copy all files that git does not ignore, as they are now; skips where this is no checkout."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("this is no checkout of git, which says what belongs to it")
    for name in filter(None, listed.stdout.split("\0")):
        if (PROJECT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(PROJECT / name, folder / name)
    return Checkout(folder)
