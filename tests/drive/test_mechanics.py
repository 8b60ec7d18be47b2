"""The table [axis.NAME.simulation] of a rig: what it may ask of the simulated bench."""

from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import Cogging, CompliantCoupling, Mechanics, Stribeck, Weight
from haptic_fieldbus.errors import RigError
from haptic_fieldbus.protocols.catalogue import load_rig

RIG = """\
[bus.can0]
interface = "socketcan"
channel = "can0"
[axis.handle]
bus = "can0"
node = 5
profile = "maxon_epos4"
encoder_counts_per_revolution = 4096
inertia = 6.0e-5
mechanism = { kind = "rotary" }
"""
GUIDE = Path(__file__).resolve().parents[2] / "docs" / "how-to" / "simulate_a_bench.md"
SIMULATION = GUIDE.read_text(encoding="utf-8").partition("```toml\n")[2].partition("```")[0]
"""As the guide shows it."""


def load(folder: Path, text: str) -> Mechanics:
    path = folder / "rig.toml"
    path.write_text(text, encoding="utf-8")
    return load_rig(path).axis["handle"].simulation


def test_a_rig_that_asks_for_nothing_is_simulated_rigid(tmp_path: Path) -> None:
    assert load(tmp_path, RIG).is_rigid


def test_every_part_is_read_as_it_stands(tmp_path: Path) -> None:
    asked = load(tmp_path, RIG + SIMULATION)
    assert asked == Mechanics(
        CompliantCoupling(stiffness=20.0, load_inertia=1e-5, damping=1e-3, backlash=0.01),
        Weight(torque=0.01, hanging_at=0.3),
        Cogging(torque=2e-3, periods_per_revolution=14),
        Stribeck(torque=1e-3, velocity=0.5),
    )
    assert not asked.is_rigid


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("load_inertia = 1.0e-5", "load_inertia = 6.0e-5", "less than the inertia of the axis"),
        ("inertia = 6.0e-5\n", "", "less than the inertia of the axis, which is required"),
        (
            'mechanism = { kind = "rotary" }',
            'mechanism = { kind = "linear", metres_per_revolution = 0.05 }',
            "a linear mechanism has no lever",
        ),
        ("stiffness = 20", "stiffness = 0", "coupling.stiffness"),
        ("torque = 2.0e-3", "torque = 2.0e4", "above 10 kHz"),
        ("periods_per_revolution = 14", "periods_per_revolution = 0", "cogging.periods_per_revolution"),
        ("velocity = 0.5", "speed = 0.5", "stribeck.velocity"),
        ("torque = 0.01, ", "", "gravity.torque"),
        ("load_inertia = 1.0e-5", 'load_inertia = "all"', "coupling.load_inertia"),
        ("simulation]\n", "simulation]\ninertia = 1.0e-5\n", "less than simulation.inertia"),
        ("simulation]\n", "simulation]\ntorque_scale = 0\n", "simulation.torque_scale"),
    ],
)
def test_what_cannot_be_simulated_is_refused(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    text = RIG + SIMULATION
    assert old in text
    with pytest.raises(RigError) as refused:
        load(tmp_path, text.replace(old, new, 1))
    assert complaint in str(refused.value)
