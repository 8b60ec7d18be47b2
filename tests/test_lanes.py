"""Rules that make a lane, and that every kind of test is in the quick one."""

import itertools
import subprocess
import sys
from argparse import ArgumentTypeError
from collections.abc import Iterator
from types import SimpleNamespace

import pytest
from hypothesis import HealthCheck, settings

from tests.conftest import FileScheduling, pytest_configure
from tests.coverage_gates import PROJECT
from tests.lanes import VENDOR_FILES, Part, examples
from tests.vcan.plugin import node_id

pytest_plugins = ["pytester"]

MODULE = """
import pytest
from hypothesis import given, strategies as st

def test_quick(): pass

@given(st.integers())
def test_property(n): pass

@pytest.mark.thorough("simulates an hour")
def test_long(): pass

@pytest.mark.soak("runs over night")
def test_endless(): pass

@pytest.mark.vendor("reads a vendor's file")
def test_file(): pass

@pytest.mark.thorough("every file", quick=("own",))
@pytest.mark.parametrize("name", ["own", "other", pytest.param("bought", marks=pytest.mark.vendor("reads a file"))])
def test_files(name): pass

@pytest.mark.vendor("reads a vendor's file")
@pytest.mark.parametrize("name", [])
def test_no_files(name): pass

@pytest.mark.thorough("compares 10 seeds", quick=3)
@pytest.mark.parametrize("seed", range(10))
def test_seeds(seed): pass

@pytest.mark.thorough("every scene", quick=("wall",))
@pytest.mark.parametrize("scene", ["spring", "wall", pytest.param("mass", marks=pytest.mark.soak("forgets slowly"))])
def test_scene(scene): pass

@pytest.mark.thorough("both hands", quick=3)
@pytest.mark.parametrize("hand", ["left", pytest.param("right", marks=pytest.mark.thorough("as the left"))])
def test_hand(hand): pass

@pytest.mark.thorough("renders for seconds")
class TestRun:
    def test_one(self): pass

    @pytest.mark.thorough("renders for seconds", quick=1)
    @pytest.mark.parametrize("n", [1, 2])
    def test_some(self, n): pass
"""
EXPECTED = {
    "quick": "quick property files[own] seeds[0] seeds[3] seeds[6] scene[wall] hand[left] some[1]",
    "thorough": "property long files[other] seeds[1] seeds[2] seeds[4] seeds[5] seeds[7] seeds[8] seeds[9] "
    "scene[spring] hand[right] one some[2]",
    "soak": "endless scene[mass]",
    "vendor": "file files[bought] no_files[NOTSET]",
}
KINDS = {
    "the wheel": ("tests/system/test_wheel.py", "test_a_wall_is_rendered_from_the_wheel"),
    "a foreign CANopen master": ("tests/peers/test_canopen_node.py", ""),
    "a foreign CANopen master of drives": ("tests/peers/test_canopen_402.py", ""),
    "a foreign reader of frames": ("tests/system/test_tshark.py", ""),
    "commands in documents": ("tests/test_project.py", "test_every_command_in_the_documents"),
    "a page of the documents": ("tests/system/test_live_changes_guide.py", ""),
    "golden plans": ("tests/golden/test_plan_texts.py", "test_the_plan_reads_as_before"),
    "golden texts of what is left out": ("tests/golden/test_left_out.py", "[wall]"),
    "properties": ("tests/scenes/test_element_contract.py", "test_gives_no_more_energy"),
    "a run of the whole system": ("tests/system/test_run.py", ""),
    "a figure of the report": ("tests/cli/test_report.py", "test_every_section_is_written"),
}


def names(pytester: pytest.Pytester, *options: str) -> list[str]:
    """The tests of `MODULE` that a run takes, without `test_`."""
    pytester.makepyfile(MODULE)
    command = ["--collect-only", "-q", "-p", "tests.conftest", f"--rootdir={pytester.path}", *options]
    lines = pytester.runpytest_inprocess(*command).outlines
    return [line.rpartition("::test_")[2] for line in lines if "::" in line]


@pytest.fixture
def _beside(
    request: pytest.FixtureRequest, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """A project beside ours, run in this process; what it told hypothesis is taken back."""
    pytester.path.joinpath("drive.EDS").touch()
    monkeypatch.setenv(VENDOR_FILES, str(pytester.path))
    pytester.makeini("[pytest]\nmarkers =\n    thorough(reason)\n    soak(reason)\n    vendor(reason)\n")
    yield
    pytest_configure(request.config)


@pytest.mark.usefixtures("_beside")
class TestLanes:
    @pytest.mark.parametrize("lane", EXPECTED)
    def test_takes_its_tests(self, pytester: pytest.Pytester, lane: str) -> None:
        assert names(pytester, "--lane", lane) == EXPECTED[lane].split()

    def test_all_takes_everything_but_the_soak_and_vendors_files(self, pytester: pytest.Pytester) -> None:
        assert set(names(pytester)) == {*EXPECTED["quick"].split(), *EXPECTED["thorough"].split()}

    def test_the_lane_of_vendors_files_says_what_to_set_where_there_are_none(
        self, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        pytester.makepyfile(MODULE)
        for folder in ("", "/nowhere", str(pytester.mkdir("empty"))):
            monkeypatch.setenv(VENDOR_FILES, folder)
            result = pytester.runpytest_inprocess("-p", "tests.conftest", f"--rootdir={pytester.path}", "--lane=vendor")
            assert result.ret == pytest.ExitCode.USAGE_ERROR
            result.stderr.fnmatch_lines([f"*no vendors' files: set {VENDOR_FILES} to a folder with EDS or DCF files*"])

    def test_parts_are_disjoint_and_everything_together(self, pytester: pytest.Pytester) -> None:
        parts = [names(pytester, "--part", f"{number}/3") for number in range(3)]
        assert sorted(itertools.chain(*parts)) == sorted(names(pytester))
        assert parts[1] == names(pytester, "--part", "7/3")
        assert all(parts)

    @pytest.mark.parametrize("marker", ["thorough", 'thorough("")', "thorough(3)", "soak()", 'soak("s", quik=2)'])
    def test_a_marker_without_a_reason_is_refused_in_a_sentence(self, pytester: pytest.Pytester, marker: str) -> None:
        pytester.makepyfile(f"import pytest\n@pytest.mark.{marker}\ndef test_it(): pass")
        result = pytester.runpytest_inprocess("-p", "tests.conftest", f"--rootdir={pytester.path}")
        assert result.ret == pytest.ExitCode.USAGE_ERROR
        result.stderr.fnmatch_lines(["*::test_it: say why this test is not in the quick lane, as in @pytest.mark.*"])


@pytest.mark.usefixtures("_beside")
def test_each_missing_package_is_named_once_at_the_end(pytester: pytest.Pytester) -> None:
    reasons = ("no tshark: apt-get install tshark", "apt-get install ip tshark: not found", "no network")
    pytester.makepyfile("import pytest" + "".join(f"\ndef test_{n}(): pytest.skip({reasons[n]!r})" for n in range(3)))
    result = pytester.runpytest_inprocess("-p", "tests.conftest", f"--rootdir={pytester.path}", "-n", "1")
    result.stdout.fnmatch_lines(["packages are missing for 2 skipped tests: apt-get install ip tshark"])


@pytest.mark.parametrize("text", ["", "1", "1/0", "a/2", "-1/2", "1/"])
def test_a_part_that_is_none_is_refused(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="expected a number and a count, as in 2/4"):
        Part.read(text)


def test_a_lane_never_has_more_examples_than_asked_for_nor_fewer_than_three() -> None:
    assert [examples(count) <= count for count in (1, 5, 15, 100, 300)] == [True] * 5
    assert all(examples(count) >= 3 for count in (5, 15, 300))


def test_no_example_is_judged_by_its_time() -> None:
    assert settings().deadline is None
    assert HealthCheck.too_slow in settings().suppress_health_check


@pytest.mark.thorough("collects the tests of many files in a process")
def test_every_kind_of_test_is_in_the_quick_lane() -> None:
    """A newcomer sees each of them once; a marker too many would take it away unnoticed."""
    files = sorted({file for file, _ in KINDS.values()})
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", "--lane", "quick", *files]
    lines = subprocess.run(command, cwd=PROJECT, capture_output=True, text=True, check=True).stdout.splitlines()
    missing = [
        kind
        for kind, (file, name) in KINDS.items()
        if not any(line.startswith(f"{file}::") and name in line for line in lines)
    ]
    assert missing == []


@pytest.mark.xdist_group("source")
def test_workers_know_the_groups_of_tests(request: pytest.FixtureRequest) -> None:
    """With a pytest that takes node-IDs from elsewhere, the tests of a group are given to several workers."""
    if getattr(request.config.option, "loadgroup", False):  # in a worker, as make starts them
        assert request.node.nodeid.endswith("::test_workers_know_the_groups_of_tests@source")


@pytest.mark.parametrize(
    ("written", "scope", "name"),
    [
        ("a.py::test[x@y]", "a.py", "a.py::test[x@y]"),
        ("a.py::test_beside_vcan_too", "a.py", "a.py::test_beside_vcan_too"),
        ("tests/view/a.py::test@peers", "peers", "tests/view/a.py::test"),
        ("tests/cycle/a.py::test@source", "source, pure", "tests/cycle/a.py::test"),
        ("a.py::test[x@y]@vcan", "vcan", "a.py::test[x@y]"),
        ("a.py::test[x]@peers_vcan", "vcan", "a.py::test[x]"),
    ],
)
def test_one_worker_runs_all_tests_of_a_file_of_a_group_and_of_the_guest_kernel(
    written: str, scope: str, name: str
) -> None:
    assert FileScheduling._split_scope(object.__new__(FileScheduling), written) == scope
    assert node_id(SimpleNamespace(nodeid=written)) == name  # type: ignore[arg-type]
