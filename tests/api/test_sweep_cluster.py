"""A sweep on a real Dask cluster: a scheduler and two workers as processes, one of which is killed midway."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import Sweep, UsageError, sweep

POINTS = {"sprung_mass.mass": np.linspace(0.05, 2.0, 15), "sprung_mass.stiffness": np.linspace(50.0, 400.0, 10)}
PROGRAM = """
import sys
import numpy as np
from haptic_fieldbus import sweep
points = {"sprung_mass.mass": np.linspace(0.05, 2.0, 15), "sprung_mass.stiffness": np.linspace(50.0, 400.0, 10)}
sweep("sprung_mass", points, out=sys.argv[1], scheduler=sys.argv[2])
"""


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[tuple[str, list["subprocess.Popen[bytes]"]]]:
    """Address of a scheduler, and its two workers."""
    file = tmp_path / "scheduler.json"
    start = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}
    begun = [subprocess.Popen([*start, "--no-dashboard", "--scheduler-file", str(file)], **quiet)]  # type: ignore[call-overload]
    try:
        waited(file.exists)
        work = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(file), "--nthreads", "1"]
        work += ["--no-nanny", "--no-dashboard"]
        begun += [subprocess.Popen(work, **quiet) for _ in range(2)]  # type: ignore[call-overload]
        yield json.loads(file.read_text())["address"], begun[1:]
    finally:
        for process in reversed(begun):
            process.kill()
            process.wait()


def waited(condition: Callable[[], object], within: float = 600.0) -> None:
    for _ in range(round(within / 0.05)):
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError(condition)


@pytest.mark.thorough("starts a cluster")
def test_a_cluster_that_loses_a_worker_gives_the_rows_of_one_computer(
    cluster: tuple[str, list["subprocess.Popen[bytes]"]], tmp_path: Path
) -> None:
    address, workers = cluster
    out = tmp_path / "rows"
    command = [sys.executable, "-c", PROGRAM, str(out), address]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            waited(lambda: len(list(out.glob("*.parquet"))) >= 3)
            workers[0].kill()
            assert not Sweep.read(out).complete
            _, told = process.communicate(timeout=600.0)
        finally:
            process.kill()
    assert process.returncode == 0, told
    assert Sweep.read(out).complete
    assert Sweep.read(out).to_arrow().equals(sweep("sprung_mass", POINTS).to_arrow())


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haptic_fieldbus.api.sweeping.CONNECTING", 0.3)
    with pytest.raises(UsageError, match=r"scheduler tcp://127\.0\.0\.1:9: no Dask scheduler answers"):
        sweep("wall", {"rate": [500.0]}, scheduler="tcp://127.0.0.1:9")


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None if name == "distributed" else find_spec(name))
    with pytest.raises(UsageError, match=r"this needs distributed; .*'\.\[cluster\]'"):
        sweep("wall", {"rate": [500.0]}, scheduler="tcp://127.0.0.1:8786")


def test_one_place_does_the_work() -> None:
    with pytest.raises(UsageError, match="workers, executor, scheduler: expected one of them"):
        sweep("wall", {"rate": [500.0]}, scheduler="tcp://127.0.0.1:8786", workers=3)
