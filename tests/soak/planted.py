"""Ten bugs in master and safety that the soak must find: `python -m tests.soak.planted`.

Each stands alone in a copy of the project. There seeds are run from 0 on until an invariant breaks, and the faults of
that run are shrunk. What was found is kept in planted.json; the thorough lane replays it (`test_planted`).
"""

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parents[2]
FOUND = Path(__file__).with_name("planted.json")
MOST_RUNS = 2000
MOST_FAULTS = 2
PROCESSES = 2
COPIED = ("haptic_fieldbus", "profiles", "tests")


@dataclass(frozen=True)
class Planted:
    """A change of one place of the source, and the law that it breaks in the end."""

    name: str
    file: str
    old: str
    new: str

    def apply(self, tree: Path) -> None:
        """Plant the bug in a copy; raises ValueError when its place is not there once."""
        path = tree / self.file
        text = path.read_text(encoding="utf-8")
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.file} has its place {text.count(self.old)} times")
        path.write_text(text.replace(self.old, self.new), encoding="utf-8")


PLANTED = (
    Planted(
        "no slew limit",
        "haptic_fieldbus/cycle/safety.py",
        "largest_change = whole_steps(limits.effort, least), limits.slew * period",
        "largest_change = whole_steps(limits.effort, least), math.inf",
    ),
    Planted(
        "no fade-in",
        "haptic_fieldbus/cycle/safety.py",
        "growth, fading = period / limits.fade_in,",
        "growth, fading = 1.0,",
    ),
    Planted(
        "no force limit",
        "haptic_fieldbus/cycle/safety.py",
        "effort, largest_change = whole_steps(limits.effort, least), limits.slew * period",
        "effort, largest_change = 3.0 * limits.effort, limits.slew * period",
    ),
    Planted(
        "held torque does not fade",
        "haptic_fieldbus/cycle/safety.py",
        "share = max(0.0, 1.0 - (missing - 1) / fading)",
        "share = 1.0",
    ),
    Planted(
        "emergencies are ignored",
        "haptic_fieldbus/cycle/safety.py",
        "    LinkFlag.EMERGENCY: TripKind.EMERGENCY,\n",
        "",
    ),
    Planted(
        "enables again by itself",
        "haptic_fieldbus/cycle/axis.py",
        "elif WAY.get(state.power, 0) < WAY.get(before, 0):",
        "elif before is PowerState.OPERATION_ENABLED is not state.power and not statusword:",
    ),
    Planted(
        "jumps of the encoder are ignored",
        "haptic_fieldbus/cycle/axis.py",
        "limits, state = self._limits, self._state\n        passed",
        "return\n        limits, state = self._limits, self._state\n        passed",
    ),
    Planted(
        "set-points without effect are ignored",
        "haptic_fieldbus/cycle/plausibility.py",
        "if waited_ns > self._deadline_ns:",
        "if waited_ns > 1000 * self._deadline_ns:",
    ),
    Planted(
        "another master is ignored",
        "haptic_fieldbus/buses/canopen/other_master.py",
        "if weight is Severity.COMMAND and self.cob_id is None:",
        "if weight is Severity.COMMAND and can_id == NMT_COB_ID and self.cob_id is None:",
    ),
    Planted(
        "drives that confirm nothing pass for free",
        "haptic_fieldbus/buses/release.py",
        "return all(drive.free for drive in self._drives)",
        "return any(drive.free for drive in self._drives) or self._end_ns > 0",
    ),
)


def copy_of(project: Path, tree: Path) -> Path:
    """A copy of what a run needs."""
    for name in COPIED:
        shutil.copytree(project / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True)
    return tree


def called(tree: Path, *arguments: str) -> str:
    """Output of `python -m tests.soak.find` in a tree; raises CalledProcessError."""
    command = [sys.executable, "-m", "tests.soak.find", *arguments]
    environment = os.environ | {"PYTHONPATH": str(tree)}
    return subprocess.run(
        command, cwd=tree, env=environment, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL
    ).stdout


def kept() -> list[dict[str, Any]]:
    """Findings about each bug: seed, law, sentence, and the text of the shrunk faults."""
    found: list[dict[str, Any]] = json.loads(FOUND.read_text(encoding="utf-8")) if FOUND.exists() else []
    return found


def search(bug: Planted) -> dict[str, Any] | None:
    """Plant a bug in a copy and look for it; None when it is not found."""
    tree = PROJECT / "build" / "soak" / "planted" / bug.name.replace(" ", "-")
    shutil.rmtree(tree, ignore_errors=True)
    bug.apply(copy_of(PROJECT, tree))
    case: dict[str, Any] | None = json.loads(called(tree, "search", str(MOST_RUNS)))
    shutil.rmtree(tree)
    good = case is not None and case["faults"].count("[[fault]]") <= MOST_FAULTS
    said = "not found" if case is None else f"run {case['runs']}, {case['law']}: {case['sentence']}"
    print(f"{'' if good else 'MISSED '}{bug.name}: {said}", flush=True)
    return case if good else None


def main(names: list[str]) -> int:
    """Look for the bugs of these names, for all without one; the others stay as they were found."""
    wanted = [bug for bug in PLANTED if not names or bug.name in names]
    with ThreadPoolExecutor(PROCESSES) as pool:
        cases = dict(zip([bug.name for bug in wanted], pool.map(search, wanted), strict=True))
    known = {each["bug"]: each for each in kept()} | {
        name: {"bug": name, **case} for name, case in cases.items() if case is not None
    }
    found = [known[bug.name] for bug in PLANTED if bug.name in known]
    FOUND.write_text(json.dumps(found, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return sum(case is None for case in cases.values())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
