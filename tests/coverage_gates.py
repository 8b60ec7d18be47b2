"""How much of the pure half the tests must cover: `python tests/coverage_gates.py COVERAGE.json TESTS.xml`.

What decides about torque is covered in full, branches included; the rest of the pure half to 95 %. Which modules are
pure is read from the import contract, so the two cannot drift apart. Only tests of the pure rooms are counted (see
tracing.py): a line is covered by a test of its own, not by a simulation that happens to pass it. Ends with a line that
says how many tests passed.
"""

import json
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

PROJECT = Path(__file__).resolve().parents[1]
PURE_CONTRACT = "pure half"
"""Part of the name of the import contract that lists the pure half."""
FULL = ("haptic_fieldbus.drive", "haptic_fieldbus.protocols", "haptic_fieldbus.planning", "haptic_fieldbus.cycle")
FULL_PERCENT, PURE_PERCENT = 100.0, 95.0


def pure_modules() -> list[str]:
    """As the import contract lists them."""
    contracts = tomllib.loads((PROJECT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    modules: list[str] = next(each for each in contracts if PURE_CONTRACT in each["name"])["source_modules"]
    return modules


def pure_rooms() -> set[str]:
    """Folders of tests whose tests alone must cover the pure half: each mirrors the package's room of the same name."""
    return {module.split(".")[1] for module in pure_modules()}


@dataclass(frozen=True)
class Gate:
    """Modules or folders that are looked at together, and how much of their lines and branches must be run [%]."""

    name: str
    modules: tuple[str, ...]
    required: float

    def holds(self, file: str) -> bool:
        paths = [module.replace(".", "/") for module in self.modules]
        return any(file == f"{path}.py" or file.startswith(f"{path}/") for path in paths)


def gates() -> list[Gate]:
    """Of all pure modules, those of `FULL` first; modules of one folder together."""
    folders: dict[str, list[str]] = {}
    for module in pure_modules():
        if module not in FULL:
            folders.setdefault(".".join(module.split(".")[:2]), []).append(module)
    full = [Gate(module, (module,), FULL_PERCENT) for module in FULL]
    return full + [Gate(folder, tuple(modules), PURE_PERCENT) for folder, modules in folders.items()]


def measured(gate: Gate, files: dict[str, dict[str, dict[str, int]]]) -> float | None:
    """Share of the gate's lines and branches that were run [%]; None when it has no files."""
    summaries = [report["summary"] for file, report in files.items() if gate.holds(file)]
    if not summaries:
        return None
    run = sum(summary["covered_lines"] + summary["covered_branches"] for summary in summaries)
    total = run + sum(summary["missing_lines"] + summary["missing_branches"] for summary in summaries)
    return 100.0 * run / total if total else 100.0


def missing(gate: Gate, files: dict[str, dict[str, list[object]]]) -> Iterator[str]:
    """Where the gate's uncovered lines and branches are."""
    for file, report in files.items():
        if gate.holds(file) and (report["missing_lines"] or report["missing_branches"]):
            yield f"  {file}: lines {report['missing_lines']}, branches {report['missing_branches']}"


def summary_line(*paths: Path) -> str:
    """`N passed, N failed, N skipped` of JUnit files."""
    suites = [suite for path in paths for suite in ElementTree.parse(path).getroot().iter("testsuite")]
    total, failures, errors, skipped = (
        sum(int(suite.get(key, "0")) for suite in suites) for key in ("tests", "failures", "errors", "skipped")
    )
    return f"{total - failures - errors - skipped} passed, {failures + errors} failed, {skipped} skipped"


def main(coverage: Path, tests: Path) -> int:
    files = json.loads(coverage.read_text())["files"]
    failed = 0
    print("\ncoverage of lines and branches")
    for gate in gates():
        percent = measured(gate, files)
        good = percent is not None and percent >= gate.required - 1e-9
        shown = "no file" if percent is None else f"{percent:6.2f} %"
        print(f"{'ok  ' if good else 'FAIL'} {gate.name:36} {shown}, at least {gate.required:.0f} %")
        if not good:
            failed += 1
            print("\n".join(missing(gate, files)))
    print(f"{failed} of the coverage gates failed" if failed else "all coverage gates hold")
    print(summary_line(tests))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
