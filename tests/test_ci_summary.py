"""The end of `.ci/run`: times, speed, slowest tests, and one line for all runs."""

import re
from pathlib import Path

import pytest

from tests.ci_summary import SLOWEST, main

JUNIT = """<testsuites>
<testsuite tests="12" failures="{failures}" errors="0" skipped="1">{cases}</testsuite>
</testsuites>"""
CASES = "".join(f'<testcase classname="tests.test_a" name="test_{number}" time="{number}.5"/>' for number in range(12))
STEPS = "31\t2500\t0\tmake check\n170\t32010\t{status}\tmake test\n"


def finish(folder: Path, failures: int = 0, runs: int = 2) -> int:
    times, files = folder / "times.txt", [folder / "tests.xml", folder / "part.xml"]
    times.write_text(STEPS.format(status=2 if failures else 0))
    for file in files[:runs]:
        file.write_text(JUNIT.format(failures=failures, cases=CASES))
    return main(times, files)


def test_it_ends_with_what_passed_and_failed_in_all_runs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == "22 passed, 0 failed, 2 skipped"
    unit = float(re.fullmatch(r"the fixed computation on this machine: (\d+) ms", lines[-2])[1])  # type: ignore[index]
    assert "  201 s    345 s in all" in lines
    told = re.fullmatch(r"  170 s    320 s +(\d+)  make test: ok", lines[-4])
    assert told is not None
    assert float(told[1]) == pytest.approx(320.1e3 / unit, rel=0.5 / unit + 0.01)
    first = lines.index("the slowest tests") + 1
    assert lines[first : first + 3] == 2 * ["  11.50 s  tests.test_a::test_11"] + ["  10.50 s  tests.test_a::test_10"]
    assert sum("tests.test_a" in line for line in lines) == SLOWEST


def test_a_step_that_failed_is_named_and_fails_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path, failures=3) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("  170 s ") and line.endswith("make test: FAILED with 2") for line in lines)
    assert lines[-1] == "16 passed, 6 failed, 2 skipped"


def test_a_run_that_wrote_nothing_fails_it_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert finish(tmp_path, runs=1) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any("part.xml was not written" in line for line in lines)
    assert lines[-1] == "11 passed, 0 failed, 1 skipped"
