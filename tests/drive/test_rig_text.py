"""The text of a rig file is read back as the same rig."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import (
    BusSection,
    Cogging,
    CompliantCoupling,
    Limits,
    Mechanics,
    Proved,
    Rig,
    RigAxis,
    RotaryMechanism,
    Seen,
    Weight,
    default_axis,
)
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.protocols.canopen.bus import Argument, CanSection
from haptic_fieldbus.protocols.catalogue import load_rig
from haptic_fieldbus.signals import Workspace

LINEAR, ROTARY = (
    default_axis(workspace, bus="can", node=5, profile="maxon_epos4")
    for workspace in (Workspace.LINEAR, Workspace.ROTARY)
)
AXES = {
    "shipped": LINEAR,
    "rotary": ROTARY,
    "unknown": replace(LINEAR, inertia=None, viscous_damping=None, rated_torque=None, torque_constant=None),
    "everything": replace(
        ROTARY,
        mechanism=RotaryMechanism("rotary", gear_ratio=3.5, sign=-1, zero=-12),
        on_link_loss="brake",
        raise_max_torque=True,
        emergency_stop="power",
        proved=Proved("none", "maxon_epos4", 50.0, "2026-11-22T12:00:00+01:00", serial=0xFFFF_FFFF),
        limits=Limits(effort=1.5, speed=2.0, position=(-0.1, 1e-7), acceleration=1e5, power=3.0, stall=10.0),
        seen=Seen(sign="seen", direction="confirmed", date="yesterday"),
        simulation=Mechanics(CompliantCoupling(20.0, 1e-5, backlash=0.1), Weight(-0.01), Cogging(1e-3, 14)),
    ),
}


def written(rig: Rig, path: Path) -> Rig:
    """The rig as it is read from its text."""
    path.write_text(rig_text(rig, "A bench"), encoding="utf-8")
    return replace(load_rig(path), source="")


@pytest.mark.parametrize("axis", AXES.values(), ids=list(AXES))
def test_what_is_read_is_what_was_written(axis: RigAxis, tmp_path: Path) -> None:
    sections: dict[str, BusSection] = {"can": CanSection("socketcan", "can0", 500_000, listen=2.5, master_node=100)}
    rig = Rig(sections, {"handle": axis, "other": replace(axis, node=6)})
    assert written(rig, tmp_path / "rig.toml") == rig


@pytest.mark.parametrize("name", ["left hand", 'a "quoted" one', "back\\slash", "ärmel"])
def test_names_and_channels_may_be_any_text(name: str, tmp_path: Path) -> None:
    sections: dict[str, BusSection] = {name: CanSection("udp_multicast", name)}
    rig = Rig(sections, {name: replace(LINEAR, bus=name)})
    assert written(rig, tmp_path / "rig.toml") == rig


def test_arguments_of_an_interface_are_written_too(tmp_path: Path) -> None:
    arguments: dict[str, Argument] = {"ttyBaudrate": 115_200, "rtscts": True, "sleep_after_open": 0.5, "a b": 'x"y'}
    rig = Rig({"can": CanSection("slcan", "/dev/ttyACM0", arguments=arguments)}, {"handle": LINEAR})
    assert written(rig, tmp_path / "rig.toml") == rig


def test_what_is_a_default_is_left_out_and_units_stand_beside_the_values() -> None:
    text = rig_text(Rig({"can": CanSection("socketcan", "can0")}, {"handle": ROTARY}), "One line\nand another")
    assert text.startswith("# One line\n# and another\n\n[bus.can]\n")
    assert "simulation" not in text
    assert "bitrate" not in text
    assert "coulomb_friction = 0.002  # N·m\n" in text
    assert "speed = 10000.0  # rad/s\n" in text
