"""A protocol that another package adds: a mode register, big-endian values, torque in mA, a traffic of its own.

`plugin/` is what such a package installs: a module, its profile, and the metadata by which it is found.
"""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import haptic_fieldbus
from haptic_fieldbus.cli import main
from haptic_fieldbus.errors import BusOverloadError, PlanError, ProfileError, UsageError
from haptic_fieldbus.planning.explain import explain, plan_json
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig
from haptic_fieldbus.protocols.registry import parse_bus, protocol_named, protocol_names

PLUGIN = Path(__file__).parent / "plugin"
DRIVE = str(PLUGIN / "toy_drive.toml")
OCTETS_IN, OCTETS_OUT, SECONDS_AN_OCTET = 1 + 9, 5, 10 / 2e6
RADIUS = 0.05 / (2 * 3.141592653589793)


@pytest.fixture(autouse=True)
def _installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The package is on the path, as pip would put it there."""
    monkeypatch.syspath_prepend(str(PLUGIN))


def status(*words: str) -> int:
    """Of a command line on this drive."""
    with pytest.raises(SystemExit) as ended:
        main(words)
    return int(ended.value.code or 0)


def answer(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert status(*words, "--drive", DRIVE, "--bus", "toy", "--json") == 0
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_it_is_found_by_its_name() -> None:
    assert protocol_names() == ["canopen", "modbus", "toy"]
    assert protocol_named("toy").name == "toy"
    assert parse_bus("toy").section.protocol == "toy"


def test_its_plan_has_its_own_traffic_delay_and_units() -> None:
    plan = haptic_fieldbus.plan("wall", drive=DRIVE, bus="toy")
    axis, (bus,) = plan.axes[0], plan.buses
    assert bus.traffic.load == pytest.approx((OCTETS_IN + OCTETS_OUT) * SECONDS_AN_OCTET * 1000.0)
    assert plan.delay.bus == pytest.approx((9 + OCTETS_OUT) * SECONDS_AN_OCTET)
    assert axis.position_unit == pytest.approx(1e-3 * RADIUS), "a milliradian of the motor"
    assert axis.effort_unit == pytest.approx(1e-3 * 0.05 / RADIUS), "a milliampere at 0.05 N·m/A"
    assert axis.limits.effort == pytest.approx(0.4 / RADIUS), "rated torque, whatever the unit of the set-point"
    assert plan.mapped == (
        "register 1 mode",
        "register 2 position",
        "register 6 echo",
        "register 4 command",
        "register 5 current",
    )


def test_its_words_stand_in_the_explanation() -> None:
    text = explain(haptic_fieldbus.plan("wall", drive=DRIVE, bus="toy"))
    for line in (
        "axis       handle: toy works Mover, node 1, linear, at most 50.3 N",
        "bus        1000 Hz at 2000000 baud, load 7.5 %",
        "in         message of node 1: register 1 mode, register 2 position, register 6 echo",
        "out        message of node 1: register 4 command, register 5 current",
    ):
        assert line in text.splitlines()
    assert not any(word in text for word in ("PDO", "SYNC", "Mbit", "6041h"))


def test_it_renders_a_wall_in_virtual_time() -> None:
    result = haptic_fieldbus.run("wall", drive=DRIVE, bus="toy", duration=2.0)
    assert (result.clock, result.cycles, result.missed_cycles, result.trips) == ("virtual", 2000, 0, ())
    (trace,) = result.traces
    friction = 2e-3 / RADIUS
    assert trace.force[-1] == pytest.approx(-6.0, abs=friction), "the hand's 6 N, as far as friction lets it through"
    assert trace.position[-1] == pytest.approx(0.02 + 6.0 / 600.0, abs=friction / 600.0 + 1e-5)
    assert result.torque_error is not None
    assert result.torque_error.contact is not None
    assert result.torque_error.contact < 0.02
    assert result.verdict is not None
    assert result.verdict.startswith("Feels right: ")
    again = haptic_fieldbus.run("wall", drive=DRIVE, bus="toy", duration=2.0)
    assert again.torque_error == result.torque_error


def test_the_command_line_tells_its_numbers(capsys: pytest.CaptureFixture[str]) -> None:
    plan = answer(capsys, "plan", "wall")
    assert plan["messages"] == [{"bus": "toy", "node": 1, "octets": 14}]
    assert (plan["pdos"], plan["registers"]) == (None, None)
    assert plan["delay_s"]["bus"] == pytest.approx((9 + OCTETS_OUT) * SECONDS_AN_OCTET)
    run = answer(capsys, "run", "wall", "--duration", "0.5")
    assert run["bus"] == "toy"
    assert run["bus_load"] == pytest.approx((OCTETS_IN + OCTETS_OUT) * SECONDS_AN_OCTET * 1000.0)
    limits = answer(capsys, "stability", "wall")
    assert limits["delay_s"] == pytest.approx(plan["delay_s"]["total"] - plan["delay_s"]["torque_loop"])
    assert limits["plant"]["resolution"] == pytest.approx(1e-3 * RADIUS)


def test_a_part_of_its_limit_can_be_asked_for() -> None:
    whole = haptic_fieldbus.stability("wall", drive=DRIVE, bus="toy")
    half = haptic_fieldbus.stability("wall", drive=DRIVE, bus="toy", settings={"wall.stiffness": "max/2"})
    assert half.stiffness == pytest.approx(whole.limit.value / 2)


@pytest.mark.thorough("renders two axes for a second")
def test_several_axes_share_its_line() -> None:
    plan = haptic_fieldbus.plan("virtual_shaft", drive=DRIVE, bus="toy")
    assert plan.buses[0].traffic.load == pytest.approx(2 * (OCTETS_IN + OCTETS_OUT) * SECONDS_AN_OCTET * 1000.0)
    result = haptic_fieldbus.run("virtual_shaft", drive=DRIVE, bus="toy", duration=0.5)
    assert (result.cycles, result.trips) == (500, ())


def test_its_bus_has_a_highest_rate_too() -> None:
    with pytest.raises(BusOverloadError, match="too fast for a toy: at most 8000 Hz"):
        haptic_fieldbus.plan("wall", drive=DRIVE, bus="toy", rate=9000.0)


def test_a_drive_and_a_bus_that_do_not_speak_the_same_are_refused() -> None:
    with pytest.raises(PlanError, match="toy works Mover speaks toy, but the bus sim is canopen"):
        haptic_fieldbus.plan("wall", drive=DRIVE)
    with pytest.raises(PlanError, match="maxon EPOS4 speaks canopen, but the bus toy is toy"):
        haptic_fieldbus.plan("wall", bus="toy")


def test_a_rig_names_it_by_its_interface_and_its_node_range_holds(tmp_path: Path) -> None:
    text = f"""
[bus.line]
interface = "toy"
channel = "bench"
[axis.handle]
bus = "line"
node = 8
profile = "{DRIVE}"
rated_torque = 0.4
torque_constant = 0.05
inertia = 4e-5
viscous_damping = 1e-4
coulomb_friction = 2e-3
encoder_counts_per_revolution = 4096
mechanism = {{ kind = "linear", metres_per_revolution = 0.05 }}
limits = {{ speed = 10.0 }}
"""
    path = tmp_path / "rig.toml"
    path.write_text(text)
    assert load_rig(path).bus["line"].protocol == "toy"
    result = haptic_fieldbus.run("wall", path, duration=0.5)
    assert (result.cycles, result.bus) == (500, "toy:bench")
    path.write_text(text.replace("node = 8", "node = 9").replace('channel = "bench"', 'channel = "bench"\nbitrate = 1'))
    with pytest.raises(ValueError, match="a whole number from 1 to 8") as refused:
        load_rig(path)
    assert "bus.line.bitrate: unknown key" in str(refused.value)


def test_torque_in_milliampere_needs_the_motors_constant_and_its_rated_torque() -> None:
    rig = haptic_fieldbus.plan("wall", drive=DRIVE, bus="toy").rig
    axis = rig.axis["handle"]
    with pytest.raises(
        PlanError, match="node 1: torque_constant is missing in the rig; it is needed to scale the torque"
    ):
        haptic_fieldbus.plan("wall", replace(rig, axis={"handle": replace(axis, torque_constant=None)}))
    with pytest.raises(PlanError, match="node 1: rated_torque is missing in the rig; it is needed to limit the torque"):
        haptic_fieldbus.run("wall", replace(rig, axis={"handle": replace(axis, rated_torque=None)}), force=True)


def test_its_rules_are_told_with_the_faults_of_its_files(tmp_path: Path) -> None:
    text = Path(DRIVE).read_text(encoding="utf-8")
    path = tmp_path / "toy.toml"
    path.write_text(text.replace("position = {", "place = {").replace("control_period = 0.0001", "control_period = -1"))
    with pytest.raises(ProfileError) as refused:
        load_profile(path)
    assert [fault.key for fault in refused.value.faults] == ["registers.position", "timing.control_period"]


def test_a_protocol_that_is_not_there_is_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = '"canopen" or "modbus" or "toy"'
    path = tmp_path / "toy.toml"
    path.write_text(Path(DRIVE).read_text(encoding="utf-8").replace('protocol = "toy"', 'protocol = "tcp"'))
    with pytest.raises(ProfileError) as refused:
        load_profile(path)
    assert words in str(refused.value)
    assert status("profiles", "check", str(path)) == 2
    assert words in "".join(capsys.readouterr())
    assert status("run", "wall", "--drive", str(path)) == 2


def test_a_protocol_without_a_real_bus_says_so() -> None:
    with pytest.raises(UsageError, match='no protocol "nobody"'):
        protocol_named("nobody")


def test_what_it_maps_is_found_in_its_json_alone() -> None:
    assert "messages" not in plan_json(haptic_fieldbus.plan("wall"))


def test_its_guard_is_proved_as_any_other(capsys: pytest.CaptureFixture[str]) -> None:
    """A toy lets go 50 ms after its last set-point."""
    (proof,) = answer(capsys, "run", "wall", "--duration", "0.2", "--prove")["guards"]
    assert proof["guard_ms"] == 50.0
    assert proof["measured_ms"] == pytest.approx(50.0, abs=1.1)


def test_a_toy_that_never_lets_go_is_refused(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import toy_fieldbus  # type: ignore[import-not-found]

    real = toy_fieldbus.DEADLINE_NS
    monkeypatch.setattr(toy_fieldbus.ToyDrive, "_advance", lambda toy, t_ns: toy.plant.advance(t_ns))
    assert status("run", "wall", "--duration", "0.2", "--prove", "--drive", DRIVE, "--bus", "toy") == 4
    assert f"(watchdog {real // 1_000_000} ms, " in capsys.readouterr().err
