"""Faults drawn from a seed, and files of faults that are written."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.errors import FaultFileError, UsageError
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.faults.drawing import ANSWER_RECIPES, MOST, RECIPES, drawn, seed_of

KINDS = (*RECIPES, *ANSWER_RECIPES)


@given(st.integers(0, 2**64 - 1))
def test_a_seed_gives_the_same_faults_each_time(seed: int) -> None:
    these = drawn(seed, 2.0)
    assert these == drawn(seed, 2.0)
    assert 1 <= len(these) <= MOST
    times = [fault.at for fault in these]  # type: ignore[union-attr]
    assert times == sorted(times)
    assert times[0] >= 0.0
    assert times[-1] <= 2.0


def test_every_kind_that_happens_at_an_instant_is_drawn() -> None:
    timed = {kind.__annotations__["kind"].__args__[0] for kind in faults.TimedFault.__args__}
    assert {*RECIPES, *ANSWER_RECIPES} == timed
    assert {fault.kind for seed in range(600) for fault in drawn(seed, 1.0)} == set(RECIPES)
    answers = tuple(ANSWER_RECIPES)
    assert {fault.kind for seed in range(100) for fault in drawn(seed, 1.0, answers)} == set(answers)


def test_what_is_drawn_reads_back_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "faults.toml"
    for seed in range(40):
        these = tuple(fault for other in range(10) for fault in drawn(10 * seed + other, 1.0, KINDS))
        path.write_text(faults.toml_of(these), encoding="utf-8")
        assert faults.load_faults(path) == these


@pytest.mark.parametrize("text", ["", "# nothing yet\n", "fault = []\n"])
def test_a_file_without_a_fault_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "faults.toml").write_text(text, encoding="utf-8")
    with pytest.raises(FaultFileError, match=r"faults\.toml: no fault in it; expected tables \[\[fault\]\]$"):
        faults.load_faults(tmp_path / "faults.toml")


def test_a_fault_of_a_bus_or_node_says_so_in_its_file() -> None:
    fault = faults.SdoRefusal("sdo_abort", 0x6060, node=3, bus="left")
    text = faults.toml_of([fault])
    assert text == '[[fault]]\nkind = "sdo_abort"\nnode = 3\nbus = "left"\nobject = 24672\n'


def test_a_seed_is_told_from_a_file() -> None:
    assert seed_of("random@18446744073709551615") == 2**64 - 1
    assert seed_of("faults.toml") is None


@pytest.mark.parametrize("text", ["random@", "random@-1", "random@x", "random@18446744073709551616"])
def test_what_is_no_seed_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="whole number"):
        seed_of(text)
