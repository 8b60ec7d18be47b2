"""The runs that docs/how-to/simulate_faults.md shows end as it says."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "simulate_faults.md").read_text(encoding="utf-8")
FILES = re.findall(r"^```toml\n# faults.toml\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
COMMANDS = re.findall(r"^```console\nhaptic-fieldbus (.*)\n```", TEXT, re.MULTILINE)
STATED = [int(status) for status in re.findall(r"ends with exit status (\d)", TEXT)]
(PROGRAM,) = re.findall(r"^```python\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)
CAUSES = ("after enabling: position", "reset the connection")


@pytest.mark.thorough("runs of seconds")
@pytest.mark.parametrize(
    ("faults", "command", "status", "cause"),
    [*zip(FILES, COMMANDS, STATED, CAUSES, strict=True)],
    ids=["CANopen", "Modbus"],
)
def test_its_faults_end_a_run_with_the_status_and_for_the_cause_of_the_page(
    faults: str,
    command: str,
    status: int,
    cause: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "faults.toml").write_text(faults, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(command.split())
    assert ended.value.code == status
    assert cause in capsys.readouterr().err


@pytest.mark.thorough("runs of seconds")
def test_its_program_runs() -> None:
    exec(compile(PROGRAM, "simulate_faults.md", "exec"), {})
