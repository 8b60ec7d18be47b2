"""The handle of a drive that is off is moved by a hand, which rests while an exchange begins."""

from dataclasses import replace

import can

from haptic_fieldbus.clock import VirtualClock
from haptic_fieldbus.sim.canopen.bus import SimulatedBus
from haptic_fieldbus.sim.canopen.world import World
from haptic_fieldbus.sim.drive_on_bus import DriveOnBus
from haptic_fieldbus.sim.hand import hand_named
from tests.sim.bench import NODE, axis, profile

START, PRE_OPERATIONAL = b"\x01", b"\x80"
SHUTDOWN, SWITCH_ON, ENABLE = 6, 7, 15
CONTROLWORD = b"\x2b\x40\x60\x00"
"""Download of 6040h."""
METRE = 0.05 / 6.283185307179586
"""Of the handle in a radian of the shaft."""


class Bench:
    """A led drive on a wire, and a program that sends."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.world = World(self.clock)
        self.plant = self.world.add(DriveOnBus(NODE, profile(), axis(), hand_named("push"), led=True)).drive.plant
        self.bus = SimulatedBus(world=self.world)

    def send(self, can_id: int, data: bytes) -> None:
        self.bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
        self.wait(0.001)

    def wait(self, seconds: float) -> float:
        """Let time pass, and return the place of the handle [m]."""
        deadline_ns = self.clock.now_ns() + round(seconds * 1e9)
        while self.bus.recv(max(0.0, (deadline_ns - self.clock.now_ns()) * 1e-9)) is not None:
            pass
        self.plant.advance(self.clock.now_ns())
        return self.plant.position * METRE


def test_an_nmt_command_lets_it_rest_and_then_move_to_the_positive_side() -> None:
    bench = Bench()
    assert bench.wait(1.9) == 0.0
    assert bench.wait(3.1) > 0.05, "at the end of its stroke, from where it would go back"
    bench.send(0, START + bytes([NODE]))
    began = bench.wait(0.1)
    assert abs(bench.wait(1.8) - began) < 1e-4, "it rests"
    assert bench.wait(2.0) > began + 0.05


def test_a_drive_that_is_enabled_is_left_alone() -> None:
    bench = Bench()
    bench.send(0, START + bytes([NODE]))
    for word in (SHUTDOWN, SWITCH_ON, ENABLE):
        bench.send(0x600 + NODE, CONTROLWORD + bytes([word, 0, 0, 0]))
    bench.send(0, PRE_OPERATIONAL + bytes([NODE]))
    assert not bench.plant.led
    bench.send(0x600 + NODE, CONTROLWORD + bytes(4))
    assert bench.plant.led


def test_without_such_a_hand_the_handle_of_a_drive_that_is_off_rests() -> None:
    world = World(VirtualClock())
    slot = DriveOnBus(NODE, profile(), axis(), hand_named("push"))
    plants = [world.add(each).drive.plant for each in (slot, replace(slot, node=NODE + 1, led=True))]
    for plant in plants:
        plant.advance(4_000_000_000)
    assert plants[0].position == 0.0
    assert plants[1].position != 0.0
