import json
from pathlib import Path

import pytest

from tests.coverage_gates import FULL, Gate, gates, main, measured, summary_line

JUNIT = '<testsuites><testsuite tests="7" failures="1" errors="1" skipped="2"/></testsuites>'


def report(files: dict[str, int]) -> dict[str, object]:
    """Coverage data of files with 80 lines and 20 branches, so many of the lines run."""
    return {
        file: {
            "summary": {"covered_lines": run, "missing_lines": 80 - run, "covered_branches": 20, "missing_branches": 0},
            "missing_lines": list(range(run, 80)),
            "missing_branches": [],
        }
        for file, run in files.items()
    }


def one_file_each(run: int) -> dict[str, int]:
    return {f"{gate.modules[0].replace('.', '/')}.py": run for gate in gates()}


def finish(tmp_path: Path, files: dict[str, int]) -> int:
    coverage, tests = tmp_path / "coverage.json", tmp_path / "tests.xml"
    coverage.write_text(json.dumps({"files": report(files)}))
    tests.write_text(JUNIT)
    return main(coverage, tests)


def test_what_decides_about_torque_is_covered_in_full_and_the_simulation_is_one_gate() -> None:
    required = {gate.name: gate.required for gate in gates()}
    assert all(required[module] == 100.0 for module in FULL)
    assert required["haptic_fieldbus.sim"] == 95.0
    assert len(required) == len(gates())


def test_a_gate_takes_modules_and_folders() -> None:
    gate = Gate("a", ("p.drive", "p.plan"), 100.0)
    assert gate.holds("p/drive/pdo.py")
    assert gate.holds("p/plan.py")
    assert not gate.holds("p/plane.py")
    assert measured(gate, {}) is None


def test_full_coverage_passes_every_gate(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path, one_file_each(80)) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "3 passed, 2 failed, 2 skipped"


def test_a_line_that_is_not_run_fails_the_full_gates_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path, one_file_each(79)) == 1
    out = capsys.readouterr().out
    assert out.count("FAIL") == len(FULL)
    assert "haptic_fieldbus/cycle.py: lines [79]" in out


def test_a_gate_without_files_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path, {}) == 1
    assert capsys.readouterr().out.count("no file") == len(gates())


def test_errors_count_as_failed_tests(tmp_path: Path) -> None:
    path = tmp_path / "tests.xml"
    path.write_text(JUNIT)
    assert summary_line(path) == "3 passed, 2 failed, 2 skipped"
    assert summary_line(path, path) == "6 passed, 4 failed, 4 skipped"
