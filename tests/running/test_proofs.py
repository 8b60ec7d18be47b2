"""Text that a run writes about a proof into the rig file, text that it leaves there, and its message when it cannot."""

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.drive.rig import Proved
from haptic_fieldbus.errors import RigError, UnprovedGuardError, UsageError
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig
from haptic_fieldbus.sim.canopen.world import World
from tests.running.guard_bench import DEAD, RPDO, GuardBench, rig_text

UNKNOWN = [0, 0xFFFF_FFFF]
"""Serial numbers of drives that were never given one."""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(), encoding="utf-8")
    return path


@pytest.mark.parametrize("answer", ["n", "", None, 0, 1, [True], np.array([False, True])], ids=repr)
def test_an_answer_that_is_no_bool_is_refused_before_anything_moves(rig: Path, answer: object) -> None:
    bench = GuardBench(rig).put()
    bench.answer = answer
    with pytest.raises(TypeError, match=r"answer of confirm\(\): expected True or False, not "):
        bench.run()
    assert bench.asked
    assert not [frame for frame in bench.frames if frame[1] & ~0x7F == RPDO]


def test_a_coroutine_is_no_answer(rig: Path) -> None:
    async def refuse() -> bool:
        return False

    bench = GuardBench(rig).put()
    bench.answer = asked = refuse()
    with pytest.raises(TypeError, match="coroutine"):
        bench.run()
    asked.close()


def test_a_bool_of_numpy_is_an_answer(rig: Path) -> None:
    bench = GuardBench(rig).put()
    bench.answer = np.True_
    assert bench.run().cycles
    bench = GuardBench(rig).put()
    bench.answer = np.False_
    with pytest.raises(UsageError, match="not enabled"):
        bench.run()


def proved(rig: Path) -> Proved | None:
    return load_rig(rig).axis["handle"].proved


def assert_of_the_sign(warnings: Sequence[str]) -> None:
    """A short run on a new bench says that nobody has shown its direction, and that it was too short; nothing else."""
    direction, seen = warnings
    assert "positive direction not confirmed by a person" in direction
    assert "motor direction not confirmed" in seen
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
    assert (kept.vendor, kept.revision) == (None, 0x0001_0000), "1018h:01 is 0, 1018h:03 is told"
    assert kept.digest == kept.digest_with(bench.plan.guards[0].set_to.written)
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
    assert told.startswith(
        f"the watchdog proof of axis handle was not saved in {rig}: it is read-only. To add it by hand:"
    )
    assert "[axis.handle.proved], serial = 0x" in told
    assert (result.cycles, rig.read_bytes()) == (50, before)


@pytest.mark.thorough("one more run")
def test_a_failure_that_cannot_be_kept_is_told_with_it(rig: Path) -> None:
    rig.chmod(0o444)
    with pytest.raises(UnprovedGuardError, match=r'was not saved.*read-only.*guard = "none"'):
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
        (lambda rig: rig.write_text(rig.read_text().replace("axis.handle", "axis.knob")), "handle] no longer exists"),
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


def with_serial(serial: int) -> Callable[[World], None]:
    """Let the drive tell this serial number."""

    def tell(world: World) -> None:
        held = world.slave(1).drive.dictionary.find(0x1018, 4)
        assert held is not None
        held.value = serial

    return tell


class TestADriveWithoutASerialNumber:
    @pytest.mark.thorough("two runs each", quick=1)
    @pytest.mark.parametrize("serial", UNKNOWN)
    def test_is_proved_at_every_start_and_nothing_is_kept(self, serial: int, rig: Path) -> None:
        before = rig.read_bytes()
        for _ in range(2):
            bench = GuardBench(rig).put(but=with_serial(serial))
            assert bench.run().proofs[0].holds
            assert rig.read_bytes() == before
            assert "(serial" not in bench.asked

    @pytest.mark.thorough("two runs each", quick=1)
    @pytest.mark.parametrize("serial", UNKNOWN)
    def test_gets_no_proof_of_another_one_although_both_tell_the_same(self, serial: int, rig: Path) -> None:
        GuardBench(rig).put().run()
        kept, text = proved(rig), rig.read_text()
        assert kept is not None
        shared = replace(kept, serial=serial)
        digest = shared.digest_with(GuardBench(rig).plan.guards[0].set_to.written)
        rig.write_text(
            text.replace(f"{kept.serial:#010X}".replace("X", "x"), hex(serial)).replace(str(kept.digest), digest)
        )
        bench = GuardBench(rig).put(but=with_serial(serial))
        assert bench.run().proofs[0].holds
        assert "the drive reports no serial number" in bench.asked


class TestAProofIsMadeAgain:
    @pytest.fixture
    def proved_rig(self, rig: Path) -> Path:
        assert GuardBench(rig).put().run().proofs[0].holds
        assert GuardBench(rig).put().run().proofs == (), "it counts for the same bench"
        return rig

    def again(self, rig: Path) -> str:
        """Run, and return the question; the new proof counts."""
        bench = GuardBench(rig).put()
        assert bench.run().proofs[0].holds
        assert GuardBench(rig).put().run().proofs == ()
        assert rig.read_text().count("[axis.handle.proved]") == 1
        return bench.asked

    def test_when_an_earlier_version_made_it(self, proved_rig: Path) -> None:
        lines = proved_rig.read_text().splitlines(keepends=True)
        old = [line for line in lines if not line.startswith(("digest", "vendor", "product", "revision"))]
        proved_rig.write_text("".join(old))
        assert "by an earlier version and has no digest; run --prove makes a new one" in self.again(proved_rig)

    @pytest.mark.thorough("four runs each", quick=("brake",))
    @pytest.mark.parametrize(
        ("old", "new"),
        [
            ("[axis.handle]\n", '[axis.handle]\non_link_loss = "brake"\n'),
            ('channel = "can0"', 'channel = "can1"'),
            ("node = 1 ", "node = 2 "),
            ("asked_ms = 50.0", "asked_ms = 50.2"),
        ],
        ids=["brake", "bus", "node", "edited"],
    )
    def test_when_the_rig_was_changed(self, old: str, new: str, proved_rig: Path) -> None:
        text = proved_rig.read_text()
        assert old in text
        proved_rig.write_text(text.replace(old, new))
        assert "changed after the proof was saved" in self.again(proved_rig)

    @pytest.mark.thorough("four runs each")
    @pytest.mark.parametrize(
        "edit",
        [("object = 0x6007, value = 2", "object = 0x6007, value = 1"), ("0x605E, value = 0", "0x605E, value = 2")],
    )
    def test_when_the_own_profile_was_edited(self, edit: tuple[str, str], tmp_path: Path, rig: Path) -> None:
        own = tmp_path / "own.toml"
        own.write_text(Path(load_profile("generic_cia402").source).read_text(encoding="utf-8"), encoding="utf-8")
        rig.write_text(rig_text(profile=str(own)), encoding="utf-8")
        assert GuardBench(rig).put().run().proofs[0].holds
        text = own.read_text(encoding="utf-8")
        assert edit[0] in text
        own.write_text(text.replace(*edit), encoding="utf-8")
        assert "changed after the proof was saved" in self.again(rig)


def test_a_proof_that_somebody_wrote_by_hand_is_refused_where_no_proof_could_say_so(rig: Path) -> None:
    table = 'guard = "proved"\nguard_ms = 5000\nasked_ms = 50.0\nprofile = "generic_cia402"\ndate = "today"\n'
    rig.write_text(f"{rig_text()}[axis.handle.proved]\n{table}", encoding="utf-8")
    with pytest.raises(RigError, match=r"axis\.handle\.proved\.guard_ms.*5000; expected from 20 to 150 ms"):
        GuardBench(rig)


def test_on_a_full_disk_the_rig_stays_as_it_was_and_the_run_goes_on(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = rig.read_bytes()

    def full(_descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    result = GuardBench(rig).put().run()
    assert any(f"was not saved in {rig}: No space left on device" in each for each in result.warnings)
    assert (result.cycles, rig.read_bytes(), os.listdir(rig.parent)) == (50, before, [rig.name])


@pytest.mark.thorough("a process each", quick=1)
@pytest.mark.parametrize("call", ["os.replace", "os.fsync"])
def test_a_run_that_is_killed_while_it_keeps_a_proof_leaves_the_rig_of_before(call: str, rig: Path) -> None:
    before = rig.read_bytes()
    code = f"""
import os, signal
from pathlib import Path
from tests.running.guard_bench import GuardBench

def kill_at_the_rig(given, *more):
    path = os.readlink(f"/proc/self/fd/{{given}}") if isinstance(given, int) else given
    if Path(path).name.startswith(".rig.toml"):
        os.kill(os.getpid(), signal.SIGKILL)
    return real(given, *more)

bench = GuardBench(Path({str(rig)!r})).put()
real, {call} = {call}, kill_at_the_rig
bench.run()
"""
    killed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert rig.read_bytes() == before
    assert GuardBench(rig).put().run().proofs[0].holds
    assert proved(rig) is not None


def test_after_a_power_cut_the_rig_is_that_of_before_or_has_the_whole_proof(
    rig: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that is renamed over the rig has reached the disk as a whole before."""
    on_disk: dict[int, bytes] = {}
    fsync, rename = os.fsync, os.replace
    renamed: dict[Path, bytes] = {}

    def synced(descriptor: int) -> None:
        fsync(descriptor)
        path = Path(f"/proc/self/fd/{descriptor}")
        if path.is_file():
            on_disk[os.fstat(descriptor).st_ino] = path.read_bytes()

    def replaced(name: str, target: Path) -> None:
        renamed[target] = on_disk.get(os.stat(name).st_ino, b"torn")
        rename(name, target)

    monkeypatch.setattr(os, "fsync", synced)
    monkeypatch.setattr(os, "replace", replaced)
    GuardBench(rig).put().run()
    assert renamed[Path(os.path.realpath(rig))] == rig.read_bytes()
    assert b"torn" not in renamed.values()
    assert proved(rig) is not None
