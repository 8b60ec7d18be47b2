"""A file that is given in the place of one of another kind is told by its kind, in one fault."""

from collections.abc import Callable
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main
from haptic_fieldbus.errors import DocumentError
from haptic_fieldbus.protocols.catalogue import load_profile, load_rig
from haptic_fieldbus.scenes.catalogue import load_scene
from tests.drive.test_profile_files import COMPLETE as PROFILE
from tests.drive.test_rig_files import COMPLETE as RIG
from tests.scenes.test_scene_files import TWO_WALLS as SCENE

FILES = {"a drive profile": PROFILE, "a rig": RIG, "a scene": SCENE}
LOADERS: dict[str, Callable[[Path], object]] = {
    "a drive profile": load_profile,
    "a rig": load_rig,
    "a scene": load_scene,
}
PAIRS = [(wanted, given) for wanted in FILES for given in FILES if wanted != given]


@pytest.mark.parametrize(("wanted", "given"), PAIRS)
def test_another_kind_of_file_is_told(wanted: str, given: str, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text(FILES[given], encoding="utf-8")
    with pytest.raises(DocumentError) as caught:
        LOADERS[wanted](path)
    (fault,) = caught.value.faults
    assert str(fault).startswith(f"this is {given}, not {wanted}; use it as ")
    assert str(path) in str(fault)


@pytest.mark.parametrize("kind", FILES)
def test_a_file_of_the_right_kind_is_read(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text(FILES[kind], encoding="utf-8")
    LOADERS[kind](path)


def test_profiles_check_says_that_a_rig_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(RIG, encoding="utf-8")
    with pytest.raises(SystemExit) as stopped:
        main(["profiles", "check", str(path)])
    assert stopped.value.code == 2
    told = " ".join(capsys.readouterr().out.split())
    assert f"this is a rig, not a drive profile; use it as --rig {path};" in told


def test_an_empty_file_has_the_faults_of_what_was_wanted(tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_text("", encoding="utf-8")
    with pytest.raises(DocumentError, match="bus: missing"):
        load_rig(path)
