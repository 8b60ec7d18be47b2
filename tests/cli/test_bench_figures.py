"""Command `bench` and the figures behind it."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path
from statistics import median

import pytest

PROJECT = Path(__file__).resolve().parents[2]
FOLDER = PROJECT / "benchmarks"
PLANTED = """
import sys
import bench
from rows import Figure
bench.FIGURES = (
    Figure("as fast as promised", "itself", 1.0, lambda stack: lambda: (1.0, 1.0)),
    Figure("too slow", "a fast one", 2.0, lambda stack: lambda: (2.4, 1.0)),
)
if "--disturbed" in sys.argv:
    sys.argv.remove("--disturbed")
    times = iter([(9.0, 1.0)] * 3 + [(2.0, 1.0)] * 15)
    bench.FIGURES = (Figure("disturbed at first", "a fast one", 2.0, lambda stack: lambda: next(times)),)
sys.argv = ["bench", *sys.argv[1:]]
sys.exit(bench.main())
"""


def planted(*words: str) -> "subprocess.CompletedProcess[str]":
    """Run the figures of `PLANTED`, one of which is 1.2 times its bound."""
    return subprocess.run([sys.executable, "-c", PLANTED, *words], cwd=FOLDER, capture_output=True, text=True)


@pytest.mark.thorough("starts processes that measure", quick=1)
@pytest.mark.parametrize("word", ["exact-foh", "cycle of a wall", "Modbus TCP master", "`--help`"])
def test_the_command_tells_ratios_of_what_it_measured(word: str) -> None:
    program = [sys.executable, "-m", "haptic_fieldbus", "bench", "--short", "--json", "--only", word]
    finished = subprocess.run(program, capture_output=True, text=True, check=False)
    (figure,) = json.loads(finished.stdout)["figures"]
    ratios = [ours / reference for ours, reference in zip(figure["ours_s"], figure["reference_s"], strict=True)]
    assert len(ratios) in (3, 15)  # 15 where the first three were above the bound
    assert figure["ratio"] == pytest.approx(median(ratios))
    assert min(ratios) > 0.0
    assert finished.returncode == (figure["ratio"] > 1.25 * figure["bound"]), finished.stderr


@pytest.mark.thorough("starts the command for each", quick=1)
@pytest.mark.parametrize(("words", "status"), [((), 1), (("--short",), 0), (("--only", "as fast"), 0)])
def test_a_ratio_above_its_bound_is_named_and_ends_with_1(words: tuple[str, ...], status: int) -> None:
    finished = planted(*words)
    assert finished.returncode == status
    assert finished.stderr == ("above its bound: too slow\n" if status else "")


def test_what_was_disturbed_in_the_short_form_is_measured_again() -> None:
    finished = planted("--short", "--json", "--disturbed")
    assert finished.returncode == 0, finished.stderr
    (figure,) = json.loads(finished.stdout)["figures"]
    assert (figure["ratio"], len(figure["ours_s"])) == (2.0, 15)


def test_a_word_of_no_figure_is_refused_with_their_names() -> None:
    finished = planted("--only", "slowest")
    assert finished.returncode == 2
    assert "as fast as promised; too slow" in finished.stderr


def test_a_wheel_carries_what_the_command_imports() -> None:
    build = tomllib.loads((PROJECT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    carried = {Path(each).stem for each in build["include"] if each.startswith("/benchmarks/")}
    needed, new = set[str](), {"bench"}
    while new:
        needed |= new
        trees = [ast.parse((FOLDER / f"{name}.py").read_text()) for name in new]
        imported = {
            name
            for tree in trees
            for node in ast.walk(tree)
            if isinstance(node, ast.Import | ast.ImportFrom)
            for name in ([node.module] if isinstance(node, ast.ImportFrom) else [each.name for each in node.names])
        }
        new = {str(name) for name in imported if (FOLDER / f"{name}.py").is_file()} - needed
    assert carried == needed
