"""Requests on a CANopen bus apart from the exchange, and that nothing is asked while somebody else commands."""

from collections.abc import Iterator
from dataclasses import replace

import pytest

from haptic_fieldbus.buses.canopen.access import ACCESS, _on_the_bus
from haptic_fieldbus.drive.rig import default_axis
from haptic_fieldbus.errors import BusTimeoutError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.canopen.profile import canopen_profile
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Workspace
from tests.buses.canopen.two_programs import TwoPrograms, assert_uploads_alone

AXES = {"handle": default_axis(Workspace.LINEAR, bus="bus", node=99, profile="generic_cia402")}
SECTION = CanSection("virtual", "wire", listen=0.1)


@pytest.fixture
def two() -> Iterator[TwoPrograms]:
    made = TwoPrograms()
    yield made
    made.close()


def test_the_drive_is_asked_when_nobody_else_is_there(two: TwoPrograms) -> None:
    checks = _on_the_bus(two.wire, SECTION, AXES, 1000.0)
    assert [(check.name, check.ok) for check in checks] == [
        ("other_masters", True), ("round_trip", True), ("round_trip_jitter", True),
    ]  # fmt: skip
    assert_uploads_alone(two.sent())


def test_while_somebody_else_commands_nothing_is_asked(two: TwoPrograms) -> None:
    two.send(0x080)
    checks = _on_the_bus(two.wire, SECTION, AXES, 1000.0)
    assert [(check.name, check.ok) for check in checks] == [("other_masters", False), ("round_trip", None)]
    assert "SYNC (080h)" in checks[0].measured
    assert two.sent() == []


def test_an_adapter_that_cannot_be_opened_is_a_check_that_fails_and_the_others_are_made() -> None:
    checks = ACCESS.checks(CanSection("socketcan", "no_such_can"), AXES, 1000.0)
    assert checks[0].name == "adapter"
    assert checks[0].ok is False
    assert {"driver", "state", "bit_rate", "queue", "usb_latency_timer"} == {check.name for check in checks[1:]}


def test_a_profile_of_no_particular_drive_is_fitted_to_the_drive_on_the_bus_and_others_are_left_alone() -> None:
    section = CanSection("haptic_sim", "maxon_epos4@99", listen=0.01)
    profile = canopen_profile(ACCESS.fitted(section, AXES)["handle"])
    # An EPOS4 has no torque demand value; its own torque shows what it was sent.
    assert (profile.name, profile.torque.demand, profile.torque.echo) == ("generic_cia402", None, "actual")
    assert profile.link_loss == canopen_profile(load_profile("generic_cia402")).link_loss
    own = {"handle": replace(AXES["handle"], profile="maxon_epos4")}
    assert ACCESS.fitted(CanSection("socketcan", "no_such_can"), own) == {}
    assert ACCESS.rated_torque(section, "handle", own["handle"]) == pytest.approx(0.4)


def test_a_drive_that_does_not_answer_is_told_with_advice() -> None:
    with pytest.raises(
        BusTimeoutError, match=r"node 99 \(axis handle\), reading 6041h.*; check the power and the node-ID"
    ):
        ACCESS.fitted(CanSection("haptic_sim", "maxon_epos4@5", listen=0.01), AXES)
