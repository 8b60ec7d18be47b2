"""Examples of docs/how-to/prove_the_guard.md work as they stand there."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main
from haptic_fieldbus.protocols.catalogue import load_rig
from tests.running.guard_bench import GuardBench, rig_text

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "prove_the_guard.md").read_text(encoding="utf-8")
QUESTION, SHOWN = re.findall(r"^```text\n(.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)
PROVED, STOP, FAULTS = re.findall(r"^```toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
GOOD, BAD = re.findall(r"^```console\nhaptic-fieldbus (.*?)\n```", TEXT, re.MULTILINE | re.DOTALL)


def outcome(command: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def test_a_simulated_drive_lets_go_as_shown(capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = outcome(GOOD, capsys)
    assert status == 0, err
    assert SHOWN in out.splitlines()


def test_its_slow_drive_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "faults.toml").write_text(FAULTS, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    status, _, err = outcome(BAD, capsys)
    assert status == 4
    assert "did not fire in time" in err


def test_the_question_the_keys_and_the_emergency_stop_are_those_of_a_run(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(rig_text(profile="maxon_epos4", more=STOP.partition("\n")[2]), encoding="utf-8")
    assert load_rig(path).axis["handle"].emergency_stop == "power"
    bench = GuardBench(path).put()
    bench.run()
    assert QUESTION.replace("\n", " ") in bench.asked
    written, shown = (
        re.findall(r"^(\w+) = ", text, re.M) for text in (path.read_text().partition("proved]")[2], PROVED)
    )
    assert written == shown
    assert re.findall(r"^\| `(\w+)` \|", TEXT, re.M) == shown
