"""Whole runs with a free control tick, encoder and adapter latency, and a host that is late by chance."""

from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.api import plan, run
from haptic_fieldbus.drive.rig import Limits, Rig, default_axis
from haptic_fieldbus.errors import SafetyTripError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import load_profile
from haptic_fieldbus.signals import Workspace

SECTION = CanSection("haptic_sim", "sim", adapter_latency=1e-4, jitter=5e-5)
TIMES = 'control_tick = "free"\nencoder_latency = 5e-5\n'
SOURCES = '"timing.control_tick" = "chosen"\n"timing.encoder_latency" = "chosen"\n'


@pytest.fixture
def rig(tmp_path: Path) -> Rig:
    """The shipped bench without Coulomb friction, and a drive with all of these times."""
    text = Path(load_profile("maxon_epos4").source).read_text(encoding="utf-8")
    path = tmp_path / "free.toml"
    path.write_text(text.replace("[timing]\n", f"[timing]\n{TIMES}") + SOURCES, encoding="utf-8")
    axis = default_axis(Workspace.LINEAR, bus="b", node=1, profile=str(path))
    axis = replace(axis, coulomb_friction=0.0, encoder_counts_per_revolution=65536, limits=Limits(speed=2.0))
    return Rig({"b": SECTION}, {"handle": axis})


@pytest.mark.thorough("runs ten seconds of a loop, twice")
@pytest.mark.parametrize(("share", "grows"), [(0.85, False), (1.25, True)])
def test_a_released_spring_grows_above_the_planned_limit_and_not_below(rig: Rig, share: float, grows: bool) -> None:
    limit = plan("spring", rig, settings={"spring.damping": 0.0}).stability
    assert limit is not None
    assert limit.stiffness_limit.stable is not None
    settings = {"spring.damping": 0.0, "spring.stiffness": share * limit.stiffness_limit.stable}
    if grows:
        with pytest.raises(SafetyTripError, match="speed"):
            run("spring", rig, settings=settings, duration=14.0, hand="release", force=True)
    else:
        assert run("spring", rig, settings=settings, duration=14.0, hand="release").trips == ()


def test_frames_pass_the_adapter_later_and_no_period_is_missed(rig: Rig) -> None:
    result = run("wall", rig, duration=0.2, hand="none")
    assert result.missed_cycles == 0
    assert result.timing is not None
    assert result.timing.age_us is not None
    assert result.timing.age_us.p50 > 1e6 * 2e-4
