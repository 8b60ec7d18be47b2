"""The guide shows what its commands print, on a simulated bench with a third of the stated damping."""

import re
from pathlib import Path

import pytest

from haptic_fieldbus.cli import main
from tests.docs.test_know_your_bench_guide import RIG as UNSTATED

TEXT = (Path(__file__).resolve().parents[2] / "docs" / "how-to" / "measure_your_bench.md").read_text(encoding="utf-8")
MEASURED, PLANNED, CERTIFIED, LOOKED_BACK = re.findall(r"^```text\n(.*?)^```", TEXT, re.M | re.S)
STATED = "inertia = 4.0e-5\nviscous_damping = 3.0e-4\ncoulomb_friction = 2.0e-3\nseen"
TRUTH = "inertia = 5.0e-5, viscous_damping = 1.0e-4, coulomb_friction = 2.0e-3"
RIG = UNSTATED.replace("seen", STATED, 1).replace(TRUTH, "viscous_damping = 1.0e-4")
"""That of the other guide, which states nothing, with values, and another truth."""


@pytest.mark.thorough("measures a bench, and certifies a contact on it")
def test_the_commands_of_the_guide_print_what_it_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text(RIG, encoding="utf-8")
    for words, shown in (
        ("identify --rig rig.toml", MEASURED),
        ("plan wall --rig rig.toml", PLANNED),
        ("certify wall --rig rig.toml --out certificate.pdf", CERTIFIED),
    ):
        with pytest.raises(SystemExit):
            main(words.split())
        told = capsys.readouterr()
        for line in shown.splitlines():
            assert line.removesuffix("…") in told.out + told.err, words
