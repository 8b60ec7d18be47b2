import json
import re
from html import escape
from pathlib import Path

import pytest

import haptic_fieldbus.cli.report as module
from haptic_fieldbus import UsageError, read_provenance
from haptic_fieldbus.numerics.integrators import METHODS
from tests.cli.command import Command

KEYS = ["work_precision", "stability_cases", "optional_parts", "host", "findings", "warnings"]
POINT = ["problem", "method", "period_s", "error_final", "error_rms", "error_max", "ns_per_step", "ns_quartiles",
         "order", "stable"]  # fmt: skip


def make(command: Command, out: Path, only: str) -> dict[str, list[dict[str, object]]]:
    finished = command("report", "--quick", "--out", str(out), "--only", only)
    assert finished.status == 0
    assert str(out / "index.html") in finished.out
    found: dict[str, list[dict[str, object]]] = json.loads((out / "report.json").read_text())
    assert list(found) == KEYS
    assert finished.err == "".join(f"warning    {told}\n" for told in found["warnings"]), "no progress bar in a pipe"
    assert all(f"- {finding}\n" in finished.out for finding in found["findings"])
    return found


@pytest.mark.thorough("measures for seconds")
def test_a_problem_is_measured_with_every_method_and_step(command: Command, tmp_path: Path) -> None:
    rows = make(command, tmp_path, "tissue")["work_precision"]
    assert {row["method"] for row in rows} == set(METHODS)
    assert all(list(row) == POINT and row["problem"] == "tissue" for row in rows)
    steps = {row["period_s"] for row in rows}
    assert len(rows) == len(steps) * len(METHODS)
    largest = max(row["period_s"] for row in rows)  # type: ignore[type-var]
    exploded = [row for row in rows if row["method"] == "forward-euler" and row["period_s"] == largest]
    assert exploded[0]["stable"] is False
    assert "failed" in (tmp_path / "index.html").read_text()


@pytest.mark.thorough("measures for seconds", quick=1)
@pytest.mark.parametrize(
    ("section", "heading", "figures"),
    [
        ("growth", "Error along the run", ["growth", "growth-force"]),
        ("sources", "Where the error comes from", ["sources"]),
        ("integrator", "Does the integrator's own stability matter in the loop?", ["integrator", "integrator-flick"]),
        ("region", "Stiffness and damping: the region that is stable", ["friction-plane", "region"]),
        ("cost", "Omitted parts of each scene, and cost of each part", ["cost"]),
    ],
)
def test_every_section_is_written(
    section: str, heading: str, figures: list[str], command: Command, tmp_path: Path
) -> None:
    found = make(command, tmp_path / "new" / "folder", section)
    page = (tmp_path / "new" / "folder" / "index.html").read_text()
    assert f"<h2>{escape(heading)}</h2>" in page
    assert bool(found["findings"])
    assert all(number in page for finding in found["findings"] for number in re.findall(r"\d+\.\d+", str(finding)))
    names = sorted(path.stem for path in (tmp_path / "new" / "folder" / "figures").iterdir())
    for path in (tmp_path / "new" / "folder" / "figures").iterdir():
        with pytest.raises(UsageError, match="shows no run that could be repeated"):
            read_provenance(path)
    assert names == sorted(figures)
    assert bool(found["optional_parts"]) is (section == "cost")
    assert all(list(row) == ["part", "ns_per_step", "ns_quartiles"] for row in found["optional_parts"])


def test_json_is_the_one_object_on_standard_output(command: Command, tmp_path: Path) -> None:
    finished = command("report", "--quick", "--json", "--out", str(tmp_path), "--only", "wall-in-hand")
    assert json.loads(finished.out) == json.loads((tmp_path / "report.json").read_text())


def test_a_name_that_nobody_knows_is_refused(command: Command, tmp_path: Path) -> None:
    finished = command("report", "--out", str(tmp_path / "report"), "--only", "grwth")
    assert finished.status == 2
    assert "nearest: growth" in finished.err
    assert not (tmp_path / "report").exists()


def test_without_matplotlib_the_report_is_refused_before_anything_is_measured(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "find_spec", lambda name: None)
    finished = command("report", "--out", str(tmp_path / "report"))
    assert finished.status == 2
    assert "pip install -e '.[plot]'" in finished.err
    assert not (tmp_path / "report").exists()
