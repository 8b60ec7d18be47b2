"""Command `twin`."""

import errno
import json
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from haptic_fieldbus.cli.identify import write_new
from haptic_fieldbus.documents.edits import with_table
from haptic_fieldbus.drive.rig_units import rig_text
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.protocols.canopen.bus import CanSection
from haptic_fieldbus.protocols.catalogue import load_rig
from tests.cli.command import Command
from tests.identification.twins import LASTING, hidden_bench, recorded


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a rig, and a run on a bench that differs from it."""
    folder, bench = tmp_path_factory.mktemp("bench"), hidden_bench(3)
    (folder / "rig.toml").write_text(rig_text(bench.stated, "My bench."), encoding="utf-8")
    recorded(bench, LASTING[0], folder / "run.mcap", 6.0, 1)
    return folder


@pytest.mark.thorough("three runs of a bench")
def test_a_twin_is_written_runs_and_is_compared(folder: Path, tmp_path: Path, command: Command) -> None:
    twin = tmp_path / "twin.toml"
    ended = command("twin", folder / "run.mcap", "--rig", folder / "rig.toml", "--out", twin)
    assert ended.status == 0, ended.err
    assert "inertia    9.75e-5 kg·m² ± 1 %" in ended.out
    assert f"written    {twin}" in ended.out
    assert "# Fitted to run.mcap.\n" in twin.read_text(encoding="utf-8")
    assert command("run", "spring", "--rig", twin, "--bus", "sim", "--duration", "0.2").status == 0
    checked = command("twin", folder / "run.mcap", "--rig", twin, "--check", "--json")
    assert checked.status == 0, checked.err
    told = json.loads(checked.out)
    assert list(told) == ["recording", "axis", "hand", "values", "predicted", "changed", "unknown", "warnings"]
    assert told["changed"] == []
    assert command("twin", folder / "run.mcap", "--rig", folder / "rig.toml", "--out", twin).status == 2


@pytest.mark.thorough("fits a twin")
def test_a_run_that_leaves_nothing_to_check_is_told_without_a_check(folder: Path, command: Command) -> None:
    asked = ("twin", folder / "run.mcap", "--rig", folder / "rig.toml", "--hand", "shake", "--free", "1:3.4")
    told, ended = command(*asked, "--json"), command(*asked)
    assert (told.status, ended.status) == (0, 0), told.err
    assert json.loads(told.out)["predicted"]["check"] is None
    assert "counts unexplained\n" in ended.out


@pytest.mark.thorough("fits a twin")
def test_a_run_that_tells_no_value_is_written_as_no_twin(folder: Path, command: Command) -> None:
    """Without a hand nothing but the motor would have moved the handle, which was pushed all the time."""
    asked = ("twin", folder / "run.mcap", "--rig", folder / "rig.toml", "--free", "1:3.4")
    ended, refused = command(*asked), command(*asked, "--out", folder / "untold.toml")
    assert (ended.status, refused.status) == (0, 2)
    assert "untold.toml: not written, since " in refused.err
    assert not (folder / "untold.toml").exists()


@pytest.mark.thorough("fits a twin")
def test_the_twin_of_a_simulated_run_on_the_rig_of_a_real_bus_is_simulated(tmp_path: Path, command: Command) -> None:
    rig, run, twin = (tmp_path / name for name in ("rig.toml", "run.mcap", "twin.toml"))
    stated = hidden_bench(3).stated
    real = replace(stated, bus={name: CanSection("socketcan", "can0", bitrate=500_000) for name in stated.bus})
    rig.write_text(rig_text(real, "My bench."), encoding="utf-8")
    words = ("--bus", "sim", "--hand", "shake", "--set", "wall.stiffness=120", "--duration", "6", "--record", run)
    assert command("run", "wall", "--rig", rig, "--rate", "500", *words).status == 0
    assert command("twin", run, "--rig", rig, "--out", twin).status == 0
    assert list(load_rig(twin).bus.values()) == [CanSection("haptic_sim", "sim", bitrate=500_000)]
    for bus in (["--bus", "sim"], list[str]()):
        ended = command("run", "spring", "--rig", twin, *bus, "--rate", "500", "--duration", "0.2")
        assert ended.status == 0, ended.err
    # Its values still do not count on a real bus.
    ended = command("plan", "spring", "--rig", twin, "--bus", "socketcan:can0@500000", "--rate", "500")
    assert "measured on a simulated bus" in f"{ended.out} {ended.err}".replace("\n", " ")
    assert command("twin", run, "--rig", twin, "--check").status == 0


@pytest.mark.thorough("fits a bench")
def test_a_disk_that_is_full_leaves_no_part_of_a_twin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A part of a rig is a rig of another bench."""

    def torn(path: Path, text: str, encoding: str) -> int:
        path.write_bytes(text[:10].encode(encoding))
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", torn)
    with pytest.raises(HapticFieldbusError, match=r"twin.toml.*: cannot be written: No space left on device"):
        write_new(tmp_path / "twin.toml", "[bus.here]\ninterface = ...")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough("two runs of a bench")
def test_a_change_is_told_by_text_and_status(folder: Path, tmp_path: Path, command: Command) -> None:
    twin, lighter = tmp_path / "twin.toml", tmp_path / "lighter.toml"
    assert command("twin", folder / "run.mcap", "--rig", folder / "rig.toml", "--out", twin).status == 0
    text = twin.read_text(encoding="utf-8")
    values = tomllib.loads(text)["axis"]["handle"]["identified"]
    values |= {
        "inertia": 0.8 * values["inertia"],
        "inertia_interval": [0.8 * each for each in values["inertia_interval"]],
    }
    lighter.write_text(with_table(text, ("axis", "handle", "identified"), values), encoding="utf-8")
    ended = command("twin", folder / "run.mcap", "--rig", lighter, "--check")
    assert ended.status == 1
    assert "changed    inertia 7.8e-5 kg·m² before, 9.75e-5 kg·m² now (+25 %)" in ended.out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--check"], "no twin, since it has no [axis.handle.identified]"),
        (["--free", "5"], '--free "5": expected FROM:TO, such as 12:18.5'),
        (["--free", "8:2"], "expected FROM:TO"),
        (["--free", "0:1"], "no bench can be fitted"),
        (["--hand", "glove"], 'no hand "glove"'),
        (["--out", "no_such_folder/twin.toml"], "no folder no_such_folder"),
    ],
)
def test_a_request_without_sense_is_refused(words: list[str], told: str, folder: Path, command: Command) -> None:
    ended = command("twin", folder / "run.mcap", "--rig", folder / "rig.toml", *words)
    assert ended.status == 2
    assert told in ended.err.replace("\n", " ")
