"""Adding one thing is one file, tried: in a copy of this checkout, by the steps that a person takes.

After each step the tests must say what is missing; after the last one, and the generators, the contract of the kind
must hold, and no other file may have changed.
"""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.new_things import MAKE_DOCS, THINGS, NewThing, Step

PROJECT = Path(__file__).resolve().parents[1]
INHERITED = ("COV_", "COVERAGE_", "PYTEST_", "GIT_")
"""Variables that belong to the tests around this one."""
BY_HAND = {"profile": 1, "scene": 1, "element": 3, "integrator": 3, "estimator": 2}
"""Files that a person touches; of an element and an integrator, one is the sheet that they are held to."""
CHANGED = {"profile": 2}
"""The most files that may differ at the end, where few are promised."""


@dataclass(frozen=True)
class Checkout:
    """A copy that programs run in, by its own code."""

    folder: Path

    def call(self, *command: str) -> subprocess.CompletedProcess[str]:
        own = {name: value for name, value in os.environ.items() if not name.startswith(INHERITED)}
        own["PYTHONPATH"] = str(self.folder)
        return subprocess.run(command, cwd=self.folder, env=own, capture_output=True, text=True)

    def take(self, step: Step) -> None:
        path = self.folder / step.path
        path.write_text(step.edit(path.read_text(encoding="utf-8") if path.exists() else ""), encoding="utf-8")

    def test(self, *words: str) -> subprocess.CompletedProcess[str]:
        return self.call(sys.executable, "-m", "pytest", "-q", "--lane", "quick", "-p", "no:cacheprovider", *words)

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


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=PROJECT, capture_output=True, text=True)
    if listed.returncode != 0:
        pytest.skip("this is no checkout of git, which says what belongs to it")
    copy = Checkout(tmp_path / "copy")
    for name in filter(None, listed.stdout.split("\0")):
        if (PROJECT / name).is_file():
            (copy.folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(PROJECT / name, copy.folder / name)
    for words in (("init", "-q"), ("add", "-A"), ("-c", "user.name=t", "-c", "user.email=t@t", "commit", "-qm", "t")):
        done = copy.call("git", *words)
        assert done.returncode == 0, done.stderr
    return copy


@pytest.mark.thorough("runs the tests of a kind and its generators in a copy", quick=("estimator",))
@pytest.mark.parametrize("kind", THINGS)
def test_one_thing_is_added_by_what_the_tests_say(kind: str, checkout: Checkout) -> None:
    thing = THINGS[kind]
    for step in thing.steps:
        checkout.take(step)
        failed = checkout.test(*thing.complete)
        assert failed.returncode == 1, failed.stdout + failed.stderr
        assert step.says in failed.stdout
    by_hand = checkout.changed()
    assert by_hand == {step.path for step in thing.steps}
    assert len(by_hand) <= BY_HAND[kind]
    for generator in thing.generators:
        checkout.generate(generator)
    assert checkout.changed() - by_hand == set(thing.generated)
    assert len(checkout.changed()) <= CHANGED.get(kind, len(checkout.changed()))
    hold(checkout, thing)


def hold(checkout: Checkout, thing: NewThing) -> None:
    """The thing is complete, tests of its kind chose it by its name, and it passes them."""
    asked = [thing.name, *(test.partition("::")[2] for test in thing.complete)]
    held = checkout.test(*thing.complete, *thing.contract, "-k", " or ".join(filter(None, asked)), "-rA")
    assert held.returncode == 0, held.stdout
    assert any(line.startswith("PASSED") and thing.name in line for line in held.stdout.splitlines())
