"""The pytest plugin: what it costs, what its marks do, and how a failing test tells the way to repeat it."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

Pytest = Callable[..., "subprocess.CompletedProcess[str]"]


@pytest.fixture
def pytest_on(tmp_path: Path) -> Pytest:
    """Run pytest, as a user has it, on a file of tests."""

    def run(text: str, *words: str) -> "subprocess.CompletedProcess[str]":
        (tmp_path / "test_it.py").write_text(text, encoding="utf-8")
        (tmp_path / "pytest.ini").write_text("[pytest]\naddopts = --strict-markers\n", encoding="utf-8")
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *words]
        return subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)

    return run


@pytest.mark.thorough("starts a process")
def test_the_arguments_of_a_mark_have_an_order(pytest_on: Pytest) -> None:
    done = pytest_on(
        "import pytest\n\n"
        "@pytest.mark.virtual_can_bus('virtual', 500_000, seed=3)\n"
        "def test_it(virtual_can_bus) -> None:\n"
        "    assert virtual_can_bus.time.value == 'virtual'\n"
        "    assert (virtual_can_bus.bitrate, virtual_can_bus.seed) == (500_000, 3)\n\n"
        "@pytest.mark.virtual_modbus_line('modbus-rtu:pty')\n"
        "def test_line(virtual_modbus_line) -> None:\n"
        "    assert virtual_modbus_line.name.startswith('modbus-rtu:/dev/')\n"
    )
    assert done.returncode == pytest.ExitCode.OK, done.stdout


def test_it_imports_nothing_for_tests_that_do_not_use_it(pytest_on: Pytest) -> None:
    done = pytest_on(
        "import sys\n\n"
        "def test_it() -> None:\n"
        "    ours = {name for name in sys.modules if name.partition('.')[0] == 'haptic_fieldbus'}\n"
        "    assert ours == {'haptic_fieldbus', 'haptic_fieldbus.pytest_plugin'}\n"
        "    assert not {'can', 'canopen', 'numpy', 'pydantic'} & set(sys.modules)\n"
    )
    assert done.returncode == pytest.ExitCode.OK, done.stdout


FAILING = """
import pytest

@pytest.mark.simulated_drive("generic_cia402", node=6)
@pytest.mark.virtual_can_bus(time="virtual", seed=4)
@pytest.mark.fault_plan("random", kinds=["silence"])
def test_it(simulated_drive):
    assert not simulated_drive
"""


@pytest.mark.thorough("starts three processes")
@pytest.mark.parametrize("distributed", [(), ("-n", "1")], ids=["one process", "pytest-xdist"])
def test_a_failure_tells_how_it_is_repeated(pytest_on: Pytest, distributed: tuple[str, ...]) -> None:
    first = pytest_on(FAILING, *distributed).stdout
    assert "node 6: generic CiA 402\nvirtual time, 1000000 bit/s, seed 4\n" in first
    _, _, rest = first.partition("# again by: --fault-plan-seed ")
    seed = rest.partition(",")[0]
    again = pytest_on(FAILING, *distributed, "--fault-plan-seed", seed).stdout
    plan = first.partition("# again by")[2].partition("\n==")[0]
    assert 'kind = "silence"' in plan
    assert plan in again


@pytest.mark.thorough("starts two processes")
def test_a_seed_is_drawn_anew_for_each_test(pytest_on: Pytest) -> None:
    text = FAILING + "\n\ntest_that = pytest.mark.skipif(False, reason='')(test_it)\n"
    said = pytest_on(text).stdout
    seeds = [line.split()[4] for line in said.splitlines() if line.startswith("# again by: ")]
    assert len(seeds) == 2
    assert seeds[0] != seeds[1]


@pytest.mark.thorough("starts a process for each", quick=1)
@pytest.mark.parametrize(
    ("mark", "said"),
    [
        ('simulated_drive("maxon_epos5")', 'no profile "maxon_epos5"; nearest: maxon_epos4'),
        ("simulated_drive(nod=5)", "unexpected keyword argument 'nod'"),
        ('virtual_can_bus(time="fast")', "'fast' is not a valid Time"),
        ("virtual_can_bus('virtual', 500_000, 3, 4)", "virtual_can_bus has 4 arguments; expected time, bitrate, seed"),
        ("virtual_can_bus('virtual', time='real')", "multiple values for keyword argument 'time'"),
        ("virtual_can_bus(bitrate=0)", "bitrate 0: expected a whole number from 10000 to 1000000 bit/s"),
        ("simulated_drive(node=0)", "node 0: expected a node-ID from 1 to 127"),
        ("simulated_drive(node=200)", "node 200: expected a node-ID from 1 to 127"),
        ("virtual_modbus_line()\n@pytest.mark.simulated_drive(node=300)", "node 300: expected a whole number from 1"),
        ("virtual_modbus_line('modbus-rtu:/dev/none')", "modbus-rtu:/dev/none: no such device"),
        ('fault_plan("none.toml")', "none.toml"),
        ('fault_plan("random", kinds=["host_late"])', "kinds of faults host_late: expected some of"),
    ],
)
def test_a_mark_that_cannot_be_fulfilled_is_told_in_a_sentence(pytest_on: Pytest, mark: str, said: str) -> None:
    done = pytest_on(f"import pytest\n\n@pytest.mark.{mark}\ndef test_it(simulated_drive):\n    pass\n")
    assert done.returncode == pytest.ExitCode.TESTS_FAILED
    assert said in done.stdout
    assert "Traceback" not in done.stdout
    assert "bench.py" not in done.stdout


@pytest.mark.thorough("starts a process")
def test_fixtures_and_marks_are_listed(pytest_on: Pytest) -> None:
    fixtures = pytest_on("", "--fixtures").stdout
    marks = pytest_on("", "--markers").stdout
    for name in ("simulated_drive", "virtual_can_bus", "fault_plan"):
        assert f"\n{name} -- " in fixtures
        assert f"@pytest.mark.{name}(" in marks
