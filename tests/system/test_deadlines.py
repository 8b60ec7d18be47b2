"""Zero torque at the motor within the time that the plan states, for every cause, at every rate, on every profile."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.planning.explain import milliseconds
from tests.system.zero_torque import MEASURED, PHASES, PROFILES, RATES, measured, planned

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "deadlines.md"


OF_MODBUS = {EndCause.OTHER_MASTER}
"""Causes that are measured in `test_modbus_somebody_else`: on CAN another master is heard."""


def stated(profile: str, rate: float) -> dict[EndCause, float]:
    """Of each cause [s]."""
    return {each.cause: each.seconds for each in planned(profile, rate).deadlines}


def test_every_cause_is_measured_on_a_drive_of_the_standard_and_on_one_of_a_vendor() -> None:
    assert {"generic_cia402", "maxon_epos4"} <= {name for name, rates in PROFILES.items() if rates == RATES}
    assert set(stated("generic_cia402", RATES[0])) == set(EndCause) - OF_MODBUS
    assert set(MEASURED) == set(EndCause) - OF_MODBUS


@pytest.mark.thorough("160 rows of a table", quick=1)
@pytest.mark.parametrize(("profile", "rate"), [(name, rate) for name, rates in PROFILES.items() for rate in rates])
@pytest.mark.parametrize("cause", MEASURED, ids=lambda cause: cause.name.lower())
def test_torque_is_zero_within_the_stated_time(cause: EndCause, rate: float, profile: str) -> None:
    longest = measured(profile, rate, cause, PHASES)
    assert 0.0 < longest < stated(profile, rate)[cause]


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("cause", [EndCause.DISCONNECTED, EndCause.KILLED, EndCause.STOPPED])
def test_the_guard_alone_leaves_little_to_spare(cause: EndCause) -> None:
    """The stated time is the guard and what comes after it, not a guess far above."""
    at = stated("generic_cia402", 1000.0)[cause]
    assert 0.9 * at < measured("generic_cia402", 1000.0, cause, PHASES[:1]) < at


def test_the_times_grow_with_the_period_by_a_stated_number_of_periods() -> None:
    slow, slower = stated("generic_cia402", 25.0), stated("generic_cia402", 20.0)
    periods = {cause: (slower[cause] - slow[cause]) / (1 / 20.0 - 1 / 25.0) for cause in slow}
    del periods[EndCause.NO_EFFECT]
    assert {cause: round(value, 3) for cause, value in periods.items()} == {
        EndCause.TRIP: 1,
        EndCause.FEEDBACK: 3,
        EndCause.FAULT: 1,
        EndCause.RESET: 3,
        EndCause.HEARTBEAT: 2,
        EndCause.NOT_OPERATIONAL: 10,  # the guard is five periods, the age limit three
        EndCause.DISCONNECTED: 5,
        EndCause.KILLED: 5,
        EndCause.STOPPED: 5,
        EndCause.END: 1,
    }


def page_rows() -> dict[tuple[str, float, str], tuple[str, str]]:
    """Stated and measured time in words, by profile, rate [Hz] and cause."""
    rows, profile, rates = {}, "", list[float]()
    for line in PAGE.read_text(encoding="utf-8").partition("## Stated and measured")[2].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[0] in PROFILES:
            profile, rates = cells[0], [float(cell.removesuffix(" Hz")) for cell in cells[1:]]
        elif line.startswith("|") and not line.startswith("|---"):
            for rate, cell in zip(rates, cells[1:], strict=True):
                rows[profile, rate, cells[0]] = cell.partition(" / ")[::2]
    return rows


def test_the_page_states_what_the_plans_state_and_more_than_was_measured() -> None:
    """Written anew by `python -m benchmarks.deadlines`."""
    rows = page_rows()
    measured = {profile for profile, _, _ in rows}  # a drive that is added is there once the page is written anew
    assert {at: said for at, (said, _) in rows.items()} == {
        (profile, rate, cause.value): milliseconds(seconds)
        for profile, rates in PROFILES.items()
        if profile in measured
        for rate in rates
        for cause, seconds in stated(profile, rate).items()
    }
    for said, longest in rows.values():
        assert float(longest.removesuffix(" ms")) < float(said.removesuffix(" ms"))


def test_the_page_tells_of_every_cause_and_of_no_other() -> None:
    ways = PAGE.read_text(encoding="utf-8").partition("## Causes and reactions")[2].partition("\n## ")[0]
    assert re.findall(r"^\| ([^|]+?) \|", ways, re.MULTILINE)[1:] == [cause.value for cause in EndCause]
