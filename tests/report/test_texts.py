from dataclasses import replace

import numpy as np
import pytest

from haptic_fieldbus.api import plan
from haptic_fieldbus.api.stability_limits import judge_scene
from haptic_fieldbus.assessing.loop_report import Percentiles, PeriodTimes, Timing
from haptic_fieldbus.assessing.result import Result, Right, TorqueError, TripRecord, energy_text, length, travel_text
from haptic_fieldbus.assessing.run_verdict import FeltError, real_verdict, run_verdict
from haptic_fieldbus.assessing.travel import Travel
from haptic_fieldbus.drive.rig import Rig, default_axis
from haptic_fieldbus.numerals import percent
from haptic_fieldbus.planning.explain import explain, limit_text
from haptic_fieldbus.planning.request import Task
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.report.analysis_texts import stability_lines
from haptic_fieldbus.report.texts import announcement, axis_text, bench_text, key_figures, outcome
from haptic_fieldbus.scenes.spring import Spring
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.builders import scene_of
from tests.several_buses import rig_on

RUN = Result(
    scene="wall",
    drive="maxon_epos4",
    bus="sim",
    rate=1000.0,
    clock="virtual",
    cycles=10_000,
    missed_cycles=0,
    duration=10.0,
    bus_load=0.272,
    torque_error=TorqueError(
        0.09, 0.412, "N", {"encoder": 0.171, "sampling and delay": 0.612, "torque loop": 0.001}, 0.02, 0.4
    ),
    energy_generated=3e-4,
    verdict="Feels like a wall.",
    elapsed=0.5,
)


def test_an_outcome_names_the_sources_of_error_by_size() -> None:
    assert outcome(RUN, verbose=True) == [
        ("result", "10000 periods, none missed; no trip"),
        ("", "bus load 27 %; 10 s simulated in 0.5 s"),
        ("", "force error 0.09 N rms, 0.412 N max (sampling and delay 61 %, encoder 17 %); 0.4 s of moving contact"),
        ("", "the loop added 0.3 mJ"),
        ("verdict", "Feels like a wall."),
    ]


@pytest.mark.parametrize(
    ("lowest", "highest", "depth", "told"),
    [
        (-1.2e-6, 0.029912, {"wall": 0.0099123}, "handle from 0 to 29.9 mm, 9.91 mm deep in wall"),
        (-0.0304, 0.1011, {"a": 0.08111, "b": 3e-5}, "handle from -30 to 101 mm, 81.1 mm deep in a, 0.03 mm deep in b"),
        (0.0, 0.0, {"wall": 0.0}, "handle stayed at 0 mm"),
        (2e-9, 4.3e-6, {}, "handle from 0 to 0.0043 mm"),
    ],
)
def test_a_way_is_told_in_steps_of_the_whole_and_a_depth_where_there_is_one(
    lowest: float, highest: float, depth: dict[str, float], told: str
) -> None:
    assert travel_text(Travel("handle", lowest, highest, depth)) == told
    assert ("", told) in outcome(replace(RUN, travel=(Travel("handle", lowest, highest, depth),)), verbose=True)


def test_a_turn_is_told_in_radians() -> None:
    assert travel_text(Travel("knob", -0.5, 2.0123, {}, Workspace.ROTARY)) == "knob from -0.5 to 2.01 rad"


def test_of_a_run_that_never_began_nothing_is_told() -> None:
    assert outcome(Result("wall", "maxon_epos4", "sim", 1000.0)) == []
    assert outcome(Result("wall", "maxon_epos4", "sim", 1000.0, cycles=0, missed_cycles=0, bus_load=0.3)) == []


def test_missed_periods_are_told_and_a_trip_is_left_to_its_error() -> None:
    tripped = replace(
        RUN, missed_cycles=3, trips=(TripRecord("speed limit", 1.0, "too fast"),), clock="monotonic", verdict=None
    )
    assert outcome(tripped) == [("result", "10000 periods, 3 missed")]


def test_what_other_devices_add_to_the_load_of_the_bus_is_told() -> None:
    compiled = plan("wall")
    crowded = replace(RUN, plan=compiled, bus_load=compiled.bus_load + 0.2)
    load = f"bus load {percent(compiled.bus_load + 0.2)}, 20 % by other devices"
    assert load in outcome(crowded, verbose=True)[1][1]
    assert "other devices" not in outcome(replace(crowded, bus_load=compiled.bus_load), verbose=True)[1][1]


def test_periods_that_began_late_are_told_with_by_how_much() -> None:
    # One in a hundred begins 5 ms late, all others 0.02 ms.
    lateness = Percentiles.of(np.where(np.arange(10_000) % 100 == 0, 5_000_000, 20_000))
    late = replace(RUN, clock="monotonic", timing=Timing(None, None, None, lateness, late=100))
    told = "10000 periods, none missed, 100 late (max 5 ms); no trip"
    assert outcome(late)[0] == ("result", told)
    assert "late" not in outcome(replace(late, timing=Timing(None, None, None, lateness)))[0][1]


def test_a_run_in_real_time_tells_its_times_and_what_the_computer_granted() -> None:
    # Of 10000 periods 200 begin 1 ms late and 20 of them 5 ms; feedback is 0.2 ms old.
    number = np.arange(10_000)
    late_ns = np.select([number % 500 == 0, number % 50 == 0], [5_000_000, 1_000_000], 20_000)
    timing = Timing(None, Percentiles.of(np.full(10_000, 200_000)), None, Percentiles.of(late_ns), late=200)
    periods = PeriodTimes(np.zeros(10_000), np.zeros(10_000), np.zeros(10_000))
    rights = (
        Right("scheduling", "SCHED_FIFO 49", "normal scheduling", False, "write two lines"),
        Right("memory", "memory locked", "at most 8 MiB", False, "write two lines"),
        Right("timer_slack", "timer slack 1 ns", "timer slack 1 ns", True),
    )
    real = replace(RUN, clock="monotonic", timing=timing, periods=periods, host=rights)
    told = outcome(real, verbose=True)
    assert told[2] == (
        "",
        "late by 0.1 ms (median), 1 ms (p99), 5 ms (p99.9), 5 ms (max); "
        "feedback age 0.2 ms (median), 0.2 ms (p99), 0.2 ms (p99.9), 0.2 ms (max)",
    )
    assert told[-4:] == [
        ("host", "timer slack 1 ns"),
        ("warning", "this computer refused SCHED_FIFO 49 (got normal scheduling), memory locked (got at most 8 MiB)"),
        ("", "write two lines"),
        ("verdict", "Feels like a wall."),
    ]
    assert outcome(real)[1:] == [told[-3], ("warning", "write two lines"), told[-1]]


def test_an_announcement_has_each_key_once() -> None:
    assert [key for key, _ in announcement(plan("wall"))] == ["scene", "bench", "sends", "limit"]
    keys = [key for key, _ in announcement(plan("wall"), verbose=True) if key]
    assert keys == ["scene", "bench", "sends", "left out", "delay", "assumed", "deadlines", "limit", "stability"]


def test_of_several_elements_each_is_named() -> None:
    wall, spring = Wall("handle", 600.0, position=0.02), Spring("handle", 10.0, position=0.01)
    for elements, shown in (
        ((wall,), "test: stiffness 600 N/m at 20 mm"),
        ((wall, spring), "test: wall stiffness 600 N/m at 20 mm; spring stiffness 10 N/m at 10 mm"),
    ):
        assert dict(announcement(plan(scene_of(*elements))))["scene"] == shown


@pytest.mark.parametrize(("share", "shown"), [(0.0123, "1.2 %"), (0.5, "50 %"), (1.53, "153 %"), (20.0, "2000 %")])
def test_a_verdict_tells_its_error_in_plain_digits(share: float, shown: str) -> None:
    felt = FeltError(share, share, 0.001, 0.4)
    told = run_verdict(scene="wall", effort="force", hand="push", stable=True, inside=True, felt=felt, ripple=None)
    assert f"force error {shown} (people notice from 8 %)" in told


@pytest.mark.parametrize(
    ("felt", "told"),
    [
        (FeltError(0.02, 0.02, 0.001, 0.4), 'Feels right: force error 2 % (people notice from 8 %), hand "push"'),
        (
            FeltError(0.5, 0.02, 0.0007, 0.4, by_event=True),
            "Feels right, 0.7 ms late: force error 2 % without the delay (people notice from 5.5 ms and 8 %)",
        ),
        (
            FeltError(0.5, 0.02, 0.0056, 0.4, by_event=True),
            "Feels different: force error 50 %, 2 % without the delay of 5.6 ms (people notice from 8 %)",
        ),
        (
            FeltError(0.12, 0.022, 0.0107, 0.4),
            "Feels different: force error 12 %, 2.2 % without the delay of 10.7 ms (people notice from 8 %)",
        ),
        (
            FeltError(0.12, 0.022, 0.0107, 0.4, energy=0.0751),
            "Feels different: force error 12 %, 2.2 % without the delay of 10.7 ms, which added 75.1 mJ",
        ),
        (FeltError(0.12, 0.022, 0.0007, 0.4), "Feels different: force error 12 %"),
        (
            FeltError(0.5, 0.2, 0.0007, 0.4, by_event=True),
            'Feels different: force error 50 % (people notice from 8 %), hand "push"',
        ),
        (FeltError(None, 0.0, 0.0, 0.0), 'Not judged: the handle did not move during contact (hand "push")'),
        (None, 'No contact in this run: the handle touched nothing (hand "push")'),
    ],
)
def test_a_verdict_says_what_was_felt_and_by_which_hand(felt: FeltError | None, told: str) -> None:
    said = run_verdict(scene="wall", effort="force", hand="push", stable=True, inside=True, felt=felt, ripple=None)
    assert said.startswith(told)


@pytest.mark.parametrize(
    ("cut", "behind", "told"),
    [
        (0.0, None, "torque never limited"),
        (0.5, 0.03, "torque limited in 50 % of periods; motor torque 3 % off target"),
    ],
)
def test_a_real_run_is_judged_by_what_loop_and_drive_tell(cut: float, behind: float | None, told: str) -> None:
    said = real_verdict(effort="torque", cut=cut, behind=behind)
    assert said == f"Real drive, error unknown: {told}"


def test_a_force_that_was_limited_until_the_direction_is_confirmed_is_not_called_unlimited() -> None:
    said = real_verdict(effort="force", cut=0.0, behind=0.2, confirmed=False)
    assert said == "Real drive, error unknown: force limited, because the motor direction is not confirmed"


def test_a_rehearsal_is_not_called_a_run_on_a_real_drive() -> None:
    said = real_verdict(effort="force", cut=0.0, behind=None, rehearsed=True)
    assert said == "Rehearsed on a simulated drive: force never limited"


def test_every_parameter_of_an_element_has_its_unit() -> None:
    text = dict(announcement(plan("damped_wall")))["scene"]
    assert text == "damped_wall: stiffness 600 N/m, damping 2 N·s/m at 20 mm"
    assert dict(announcement(plan("sprung_mass")))["scene"] == "sprung_mass: stiffness 200 N/m, mass 0.5 kg"


def test_the_bench_of_a_real_bus_is_told_with_what_is_unknown() -> None:
    axis = default_axis(Workspace.LINEAR, bus="b", node=5, profile="maxon_epos4")
    known = plan("wall", Rig({"b": CanSection("socketcan", "can0", 500_000)}, {"handle": axis}), rate=500.0)
    bench = replace(known.axes[0].bench, inertia=None)
    blind = replace(known.axes[0], rig=replace(axis, inertia=None), bench=bench, plant=None, stability=None)
    unknown = replace(known, axes=(blind,))
    lines = dict(announcement(unknown))
    assert lines["bench"] == "maxon EPOS4 (socketcan can0), node 5, 500 kbit/s, 500 Hz"
    assert lines["limit"].startswith("unknown")
    assert axis_text(blind) in [text for _, text in announcement(unknown, verbose=True)]
    assert axis_text(blind).endswith("inertia or damping unknown")
    assert not known.simulated
    assert plan("wall").simulated


def test_on_several_buses_each_bench_is_told_with_its_bus_and_bit_rate() -> None:
    scene = scene_of(Wall("left", 100.0, name="a"), Wall("right", 100.0, name="b"))
    rig = rig_on(scene, {"left": "can_l", "right": "can_r"}, {"can_r": 500_000}, profile="maxon_epos4")
    compiled = plan(scene, rig)
    drive = "maxon EPOS4 (simulated), bus"
    assert bench_text(compiled) == f"1000 Hz; {drive} can_l, node 1, 1 Mbit/s; {drive} can_r, node 2, 500 kbit/s"


def test_the_limit_is_one_line_of_run_plan_and_stability() -> None:
    compiled = plan("wall")
    line = "750 N/m; 600 is inside, margin 1.25"
    assert limit_text(compiled.stability) == line
    assert dict(announcement(compiled))["limit"] == line
    assert f"limit      {line}" in explain(compiled)
    assert dict(stability_lines(judge_scene(Task("wall"))))["limit"] == line


def test_places_and_energies_are_written_for_people() -> None:
    assert (length(0.02, Workspace.LINEAR), length(0.5, Workspace.ROTARY)) == ("20 mm", "0.5 rad")
    assert energy_text(None) == ""
    assert energy_text(-2e-3).startswith("the loop absorbed 2 mJ")


def test_a_picture_has_one_line_of_figures() -> None:
    assert key_figures(RUN) == (
        "wall on maxon_epos4, sim, 1000 Hz · 10000 periods, none missed · "
        "force error 0.09 N rms, 0.412 N max · bus load 27 %"
    )


def test_a_capped_force_stands_in_the_first_lines_of_a_run() -> None:
    capped = announcement(plan("wall", drive="iris_orca", bus="sim-modbus-rtu", settings={"wall.stiffness": 15.0}))
    assert [key for key, _ in capped[:3]] == ["scene", "bench", "cap"]
    assert capped[2][1].startswith(
        "handle: force limited to 2.51 N (5 % of rated torque): Iris Dynamics ORCA has no watchdog"
    )
    assert "cap" not in dict(announcement(plan("wall")))
