"""The soak itself: its parts scale, each works, and a soak that was ended goes on."""

import json
import os
import subprocess
import sys

import pytest

from tests.soak import files
from tests.soak.active import AGE, PERMITTED, active_case, excesses, rendered, wrong_with
from tests.soak.page import page
from tests.soak.parts import PARTS, WHOLE, chunks, worked
from tests.soak.planted import PROJECT


@pytest.mark.parametrize("runs", [1, 137, WHOLE])
def test_all_parts_scale_with_the_number_of_runs(runs: int) -> None:
    for name, part in PARTS.items():
        own = [chunk for chunk in chunks(runs) if chunk.part == name]
        assert sum(chunk.count for chunk in own) == max(1, round(part.whole * runs / WHOLE))
        assert [chunk.first for chunk in own] == [part.chunk * place for place in range(len(own))]


def test_a_whole_soak_is_as_large_as_was_promised() -> None:
    sums = {name: sum(chunk.count for chunk in chunks(WHOLE) if chunk.part == name) for name in PARTS}
    assert sums["seeded runs"] == 10_000
    assert sums["frames into the drive"] + sums["frames into the master"] == 1_000_000
    assert sums["an hour"] == 3600
    assert sums["active elements under gaps"] == 500
    assert sums["rigs with slips"] == 2000
    for reader in ("scene", "rig", "profile", "faults", "eds"):
        assert (sums[f"small files: {reader}"], sums[f"large files: {reader}"]) == (10_000, 1_000)


@pytest.mark.thorough("frames and files", quick=("active", "slips", "into_drive"))
@pytest.mark.parametrize(
    ("work", "count"),
    [
        pytest.param("active elements under gaps", 2, id="active"),
        pytest.param("rigs with slips", 2, id="slips"),
        pytest.param("drives without serial number", 2, id="serial"),
        pytest.param("frames into the drive", 1000, id="into_drive"),
        pytest.param("frames into the master", 2000, id="into_master"),
        *(pytest.param(f"small files: {name}", 30, id=f"into_reader-{name}") for name in files.READERS),
        *(pytest.param(f"large files: {name}", 3, id=f"into_reader-large-{name}") for name in files.READERS),
    ],
)
def test_a_little_of_each_part_breaks_nothing(work: str, count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "bounded", lambda: None)  # it would bound the process of the tests
    assert PARTS[work].work(7, count)["broken"] == []


@pytest.mark.thorough("a whole run")
def test_an_element_that_states_no_energy_may_give_back_what_it_took_before() -> None:
    case = active_case(232)  # it took 0.5 J in its first contacts, and then gives 12 mJ in each
    result = rendered(case)
    assert result is not None
    assert not result.trips
    given = [excess for _, excess in excesses(result.traces[0], case, AGE / case.rate)]
    assert sum(excess > PERMITTED for excess in given) >= 6
    assert sum(given) < 0.0
    assert wrong_with(case) == []


@pytest.mark.thorough("a small soak, twice")
def test_a_soak_goes_on_where_it_was_ended() -> None:
    folder = PROJECT / "build" / "soak"
    before = set(folder.glob("*-3.jsonl")) if folder.exists() else set()
    for old in before:
        old.unlink()

    def soaked() -> list[str]:
        command = [sys.executable, "-m", "tests.soak"]
        done = subprocess.run(command, cwd=PROJECT, env=os.environ | {"SOAK_RUNS": "3"}, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        (file,) = folder.glob("*-3.jsonl")
        return file.read_text(encoding="utf-8").splitlines()

    lines = soaked()
    assert len(lines) == len(PARTS)
    (file,) = folder.glob("*-3.jsonl")
    file.write_text("\n".join([*lines[:-1], lines[-1][:20]]) + "\n", encoding="utf-8")
    again = soaked()
    assert again[: len(lines) - 1] == lines[:-1], "what was done is not done again"
    assert json.loads(again[-1])["part"] == json.loads(lines[-1])["part"]


def test_the_page_tells_what_was_done() -> None:
    found = [worked(chunk) for chunk in chunks(1) if chunk.part == "frames into the drive"]
    times = {"times": {"emergency|drive fault or emergency|1000": 1.4e-3}, "counts": {}, "virtual_s": 3600.0}
    times["counts"] = dict.fromkeys(times["times"], 3)  # type: ignore[call-overload]
    found.append({"part": "seeded runs", "first": 0, "count": 1, "broken": ["seed 0: a law"], "cpu_s": 60.0} | times)
    text = page(found, 1, "abc", 120.0)
    assert "1 seeded runs, commit abc: **1 invariants broken**" in text
    assert "| `emergency` | drive fault or emergency | 1.4 ms (3) |" in text
    assert "| frames into the drive | 50 | 0 |" in text
