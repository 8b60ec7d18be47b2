"""What a run writes of a proof into the rig file, what it leaves there, and what it says when it cannot write."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from haptic_fieldbus.drive.rig import Proved
from haptic_fieldbus.errors import UnprovedGuardError
from haptic_fieldbus.protocols.catalogue import load_rig
from tests.running.guard_bench import DEAD, GuardBench, rig_text


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(), encoding="utf-8")
    return path


def proved(rig: Path) -> Proved | None:
    return load_rig(rig).axis["handle"].proved


def assert_of_the_sign(warnings: Sequence[str]) -> None:
    """A short run on a new bench says that nobody has shown its direction, and that it was too short; nothing else."""
    direction, seen = warnings
    assert "direction not confirmed by a person" in direction
    assert "the sign from torque to motion was not seen" in seen
    assert "the run was too short" in seen


def test_what_is_kept_is_the_drive_the_time_and_the_day_and_all_else_stays_octet_for_octet(rig: Path) -> None:
    before = rig.read_bytes()
    rig.chmod(0o600)
    bench = GuardBench(rig).put()
    (proof,) = bench.run().proofs
    assert rig.read_bytes().startswith(before)
    assert rig.stat().st_mode & 0o777 == 0o600
    kept = proved(rig)
    assert kept is not None
    assert (kept.guard, kept.profile, kept.asked_ms) == ("proved", "generic_cia402", 50.0)
    assert kept.serial == bench.world.slave(1).drive.settings.serial
    assert kept.guard_ms == pytest.approx(1e3 * (proof.off or 0.0), abs=1e-3)
    assert kept.date.startswith("20")
    assert "T" in kept.date


def test_a_rig_that_is_a_link_stays_one(rig: Path, tmp_path: Path) -> None:
    link = tmp_path / "bench.toml"
    link.symlink_to(rig)
    GuardBench(link).put().run()
    assert link.is_symlink()
    assert proved(rig) is not None


def test_a_read_only_rig_is_told_with_what_it_would_hold_and_the_run_goes_on(rig: Path) -> None:
    before = rig.read_bytes()
    rig.chmod(0o444)
    result = GuardBench(rig).put().run()
    told, *others = result.warnings
    assert_of_the_sign(others)
    assert told.startswith(f"the proof of axis handle was not kept in {rig}: it is read-only. It would be:")
    assert "[axis.handle.proved], serial = 0x" in told
    assert (result.cycles, rig.read_bytes()) == (50, before)


@pytest.mark.thorough("one more run")
def test_a_failure_that_cannot_be_kept_is_told_with_it(rig: Path) -> None:
    rig.chmod(0o444)
    with pytest.raises(UnprovedGuardError, match=r'was not kept.*read-only.*guard = "none"'):
        GuardBench(rig).put([DEAD]).run()


@pytest.mark.thorough("one more run")
def test_what_somebody_wrote_meanwhile_stays(rig: Path) -> None:
    bench = GuardBench(rig).put()
    theirs = rig.read_text() + "\n[axis.handle.limits]\n"
    theirs = theirs.replace("limits = { speed = 10.0 }\n", "") + "speed = 3.0   # slower\n"
    bench.when_left_alone(lambda: rig.write_text(theirs))
    assert_of_the_sign(bench.run().warnings)
    assert rig.read_text().startswith(theirs)
    assert proved(rig) is not None


@pytest.mark.thorough("a run each", quick=1)
@pytest.mark.parametrize(
    ("spoil", "why"),
    [
        (lambda rig: rig.write_text(rig.read_text().replace("axis.handle", "axis.knob")), "no [axis.handle] any more"),
        (lambda rig: rig.unlink(), "No such file"),
        (lambda rig: rig.write_text("["), "Invalid"),
    ],
)
def test_a_rig_that_can_no_longer_hold_it_is_told(spoil, why: str, rig: Path) -> None:  # type: ignore[no-untyped-def]
    bench = GuardBench(rig).put()
    bench.when_left_alone(lambda: spoil(rig))
    result = bench.run()
    assert result.cycles == 50
    assert why in result.warnings[0]
