"""Set-points proved by asking for 6071h, over the simulated bus: acting, lost, switched off, refused, late."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus import run
from haptic_fieldbus.errors import BusConfigurationError, DriveFaultError
from haptic_fieldbus.planning.deadlines import EndCause
from haptic_fieldbus.scenes.catalogue import scene_names
from haptic_fieldbus.sim import faults
from haptic_fieldbus.sim.canopen.link import Frame
from tests.builders import endless_rig
from tests.system.test_set_points_that_do_not_act import CONTACT, RATES, TOOLS, SimulatedDrives
from tests.system.zero_torque import measured, planned

ASKED = str(Path(__file__).parent / "profiles" / "asked_echo.toml")
LOST_AT = 0.7
"""[s] after operation enabled; the led handle is on its way into the wall."""


class Watched(SimulatedDrives):
    """A rack that keeps the target torques on the wire, which tell when the first one differed from what is held."""

    def __init__(self, rate: float, these: tuple[faults.Fault, ...] = ()) -> None:
        super().__init__(ASKED, rate, these)
        self.targets: list[tuple[int, int]] = []
        self.answered = 0
        self.world.tap(self._heard)

    def _heard(self, t_ns: int, can_id: int, data: bytes) -> None:
        if can_id == 0x201:
            self.targets.append((t_ns, struct.unpack("<Hh", data)[1]))
        self.answered += can_id == 0x581 and data[1:4] == b"\x71\x60\x00"

    def waited(self) -> float:
        """Time from the first target that differs by more than a step from the one that the drive kept [s]."""
        assert self.report.last_ns is not None
        kept = self.drive.drive.dictionary.find(0x6071).value
        last = max(at for at, (_, target) in enumerate(self.targets) if target == kept and self.targets[at + 1][1] != 0)
        first = next(t_ns for t_ns, target in self.targets[last:] if abs(target - kept) > 1)
        return (self.report.last_ns - first) * 1e-9


@pytest.mark.thorough("every rate", quick=1)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("name", ["lost", "switched off"])
def test_set_points_without_effect_take_the_torque_away_in_the_stated_time(name: str, rate: float) -> None:
    these = (faults.MissingRpdos("missing_rpdos", LOST_AT),) if name == "lost" else ()
    rack = Watched(rate, these)
    with pytest.raises(DriveFaultError, match=r"set-points do not act.*the target torque asked of node 1 is"):
        rack.run(6.0, lambda: None if these else rack.tool(TOOLS["RPDO switched off"]))
    assert rack.ended >= (LOST_AT if these else CONTACT)
    assert rack.waited() <= rack.plan.axes[0].limits.echo


@pytest.mark.thorough("a run for each")
@pytest.mark.parametrize("rate", RATES)
def test_6071h_is_requested_every_5_ms_at_most(rate: float) -> None:
    rack, asked = Watched(rate), list[int]()

    def heard(t_ns: int, can_id: int, data: bytes) -> None:
        if can_id == 0x601 and data[:4] == b"\x40\x71\x60\x00":
            asked.append(t_ns)

    rack.world.tap(heard)
    rack.run(0.5)
    assert len(asked) > 10
    assert min(np.diff(asked)) >= 4.8e6, "[ns]; another frame may hold the one before up by 0.2 ms"


@pytest.mark.thorough("every rate at four places in a period", quick=1)
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("cause", [EndCause.NO_EFFECT, EndCause.TRIP])
def test_zero_torque_at_the_motor_within_the_stated_time(cause: EndCause, rate: float) -> None:
    stated = next(each.seconds for each in planned(ASKED, rate).deadlines if each.cause is cause)
    assert 0.0 < measured(ASKED, rate, cause) < stated


@pytest.mark.thorough("every scene of the library, and walls at half their limit, for 60 s", quick=1)
@pytest.mark.parametrize("scene", scene_names())
def test_no_scene_of_the_library_trips(scene: str) -> None:
    assert run(scene, drive=ASKED, duration=60.0 if scene in ("wall", "damped_wall") else 5.0).trips == ()


@pytest.mark.thorough("60 s at every rate", quick=0)
@pytest.mark.parametrize("rate", RATES)
def test_taps_on_a_wall_at_half_its_limit_never_trip(rate: float) -> None:
    rig = endless_rig("wall", ASKED)
    result = run("wall", rig, rate=rate, hand="tap", duration=60.0, settings={"wall.stiffness": "max/2"})
    assert result.trips == ()
    assert np.abs(result.traces[0].force).max() > 0.0


Answer = Callable[[Frame], list[Frame]]


class Slow(Watched):
    """A drive whose answers about 6071h are lost, refused or late, by their number."""

    def __init__(self, rate: float, changed: Callable[[int, bytes], bytes | None], late_ns: int = 0) -> None:
        super().__init__(rate)
        self.number = 0
        node = self.drive.node
        respond = node._respond

        def responded(responses: list[bytes]) -> None:
            for response in responses:
                if response[1:4] != b"\x71\x60\x00" or not self.running:
                    respond([response])
                    continue
                self.number += 1
                octets = changed(self.number, response)
                if octets is None:
                    continue
                if late_ns:
                    self._later(late_ns, octets)
                else:
                    respond([octets])

        node._respond = responded  # type: ignore[method-assign]
        self._respond = respond

    @property
    def running(self) -> bool:
        return bool(self.targets)

    def _later(self, late_ns: int, octets: bytes) -> None:
        alarm = self.drive.node.alarms.new(lambda t_ns: self._respond([octets]))
        alarm.at(self.clock.now_ns() + late_ns)


def test_answers_that_are_lost_now_and_then_are_no_reason_to_stop() -> None:
    rack = Slow(1000.0, lambda number, octets: None if number % 3 == 0 else octets)
    assert rack.run(4.0).cycles == 4000
    assert rack.answered > 50


@pytest.mark.thorough("3 cases of one rule", quick=1)
@pytest.mark.parametrize("late_ms", [3, 12, 25])
def test_answers_that_are_late_are_no_reason_to_stop(late_ms: int) -> None:
    """The hand moves all the time, so each target is another one."""
    rack = Slow(1000.0, lambda number, octets: octets, late_ms * 1_000_000)
    assert rack.run(4.0).cycles == 4000
    assert rack.answered > 50


ABORT = b"\x80\x71\x60\x00" + (0x0800_0022).to_bytes(4, "little")


def test_a_drive_that_refuses_from_some_time_on_is_told_and_takes_the_torque_away() -> None:
    rack = Slow(1000.0, lambda number, octets: octets if number < 100 else ABORT)
    with pytest.raises(
        DriveFaultError, match=r"set-points not confirmed: node 1 has not returned its target torque for 6\d ms"
    ):
        rack.run(4.0)
    assert 0.4 < rack.ended < 1.0


def test_a_refusal_now_and_then_is_no_reason_to_stop() -> None:
    rack = Slow(1000.0, lambda number, octets: octets if number % 4 else ABORT)
    assert rack.run(3.0).cycles == 3000


def test_a_drive_that_refuses_from_the_beginning_is_not_enabled() -> None:
    rack = Watched(1000.0)
    rack.drive.drive.dictionary.remove(0x6071)
    with pytest.raises(BusConfigurationError, match=r'torque\.echo = "asked"'):
        rack.run(1.0)
