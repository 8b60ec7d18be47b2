"""Values that were measured with another drive are refused at the start of a run, before anything is written."""

from pathlib import Path

import pytest

from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.running.session import Session
from tests.running.guard_bench import GuardBench, rig_text
from tests.running.test_proofs import with_serial

MEASURED = """
[axis.handle.identified]
inertia = 4.0e-5
inertia_interval = [3.9e-5, 4.1e-5]
viscous_damping = 1.0e-4
viscous_damping_interval = [0.98e-4, 1.02e-4]
serial = 0x1234
"""


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text() + MEASURED, encoding="utf-8")
    return path


def test_another_drive_is_refused_and_nothing_is_written_to_it(rig: Path) -> None:
    before, bench = rig.read_bytes(), GuardBench(rig).put(but=with_serial(0x9999))
    with pytest.raises(PlanError, match=r"serial number 0x00001234, this drive has 0x00009999\. Run haptic-fieldbus"):
        bench.run()
    assert (bench.asked, bench.torques(), bench.downloads()) == ("", [], set())
    assert bench.is_free()
    assert rig.read_bytes() == before


def test_after_a_run_it_is_known_which_drive_it_was(rig: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`identify` keeps this number in the rig."""
    sessions: list[Session] = []
    begun = Session.__init__

    def noted(self: Session, *arguments: object, **words: object) -> None:
        begun(self, *arguments, **words)  # type: ignore[arg-type]
        sessions.append(self)

    monkeypatch.setattr(Session, "__init__", noted)
    GuardBench(rig).put(but=with_serial(0x1234)).run()
    assert [each.identities["handle"].serial for each in sessions] == [0x1234]
    assert not sessions[0].plan.simulated


@pytest.mark.parametrize("serial", [0x1234, 0])
def test_the_same_drive_and_one_that_tells_no_number_run(serial: int, rig: Path) -> None:
    assert GuardBench(rig).put(but=with_serial(serial)).run().cycles == 50
