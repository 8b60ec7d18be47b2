"""Command `certify`."""

import json
from pathlib import Path

import pytest

from haptic_fieldbus.identification.certificate import Certificate
from tests.api.certified import drawn_bench
from tests.cli.command import Command
from tests.identification.test_certificate import certificate
from tests.recordings.test_provenance import told_by

SLOW = ("--rate", 250, "--share", 0.2)


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text(drawn_bench(1).text, encoding="utf-8")
    return path


@pytest.mark.thorough("certifies a bench, and draws it")
def test_it_is_told_as_text_and_on_a_page(rig: Path, tmp_path: Path, command: Command) -> None:
    page = tmp_path / "page.pdf"
    ended = command("certify", "wall", "--rig", rig, *SLOW, "--out", page)
    assert ended.status == 0, ended.err
    for part in (
        "which is below the limit: keep hands off",
        "well damped (each swing at most 0.9 of",
        "extrapolated",
        "predicted  onset 903 N/m",
        "ended by",
    ):
        assert part in ended.out
    assert page.read_bytes().startswith(b"%PDF")
    assert f"out        {page}, page.json" in ended.out
    before = page.with_suffix(".json").read_bytes()
    ended = command("certify", "wall", "--rig", rig, *SLOW, "--out", page)
    assert (ended.status, page.with_suffix(".json").read_bytes()) == (2, before)
    assert "page.json: exists; move it away" in ended.err.replace("\n", "")


@pytest.mark.thorough("certifies a bench")
def test_it_is_told_as_json_with_the_keys_of_the_contract_first(rig: Path, tmp_path: Path, command: Command) -> None:
    page = tmp_path / "page.png"
    ended = command("certify", "wall", "--rig", rig, *SLOW, "--json", "--plot", page)
    assert ended.status == 0, ended.err
    found = json.loads(ended.out)
    assert list(found)[:5] == ["seen", "onset", "predicted", "bench", "date"]
    assert set(found["onset"]) == {"value", "low", "high"}
    assert found["bench"]["rig"] == str(rig)
    assert "keep hands off" in ended.err
    assert list(told_by(page)["files"]) == [rig.name]
    assert json.loads(page.with_suffix(".json").read_text(encoding="utf-8")) == found
    page.with_suffix(".json").unlink()
    page.with_suffix(".json").mkdir()
    ended = command("certify", "wall", "--rig", rig, *SLOW, "--out", page)
    assert (ended.status, ended.out) == (2, ""), "nothing moved"
    assert "page.json" in ended.err


@pytest.mark.parametrize(("words", "answers"), [(("--yes",), [True, None]), (("--yes", "--above"), [True, True])])
def test_a_script_goes_above_the_limit_only_when_it_says_so(
    words: tuple[str, ...], answers: list[bool | None], rig: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[bool | None] = []

    def certify(_: object, *, confirm: object, above: object, **more: object) -> Certificate:
        asked.extend(each("Go on?") if callable(each) else None for each in (confirm, above))
        return certificate(0.5)

    monkeypatch.setattr("haptic_fieldbus.api.certification.certify", certify)
    assert command("certify", "wall", "--rig", rig, *words).status == 0
    assert asked == answers


def test_exit_statuses_are_those_of_the_contract(rig: Path, command: Command) -> None:
    assert command("certify").status == 2
    ended = command("certify", "wall", "--rig", rig, "--out", "cert")
    assert (ended.status, ended.err) == (2, 'out "cert": the suffix must be one of .png, .svg, .pdf\n')
    assert command("certify", "wall", "--rig", rig, "--share", 1.5).status == 2
    for rate in (0, "nan", -5):
        ended = command("certify", "wall", "--rig", rig, f"--rate={rate}")
        assert (ended.status, f"rate {rate}: expected a rate above 0" in ended.err) == (2, True)
    text = rig.read_text(encoding="utf-8").splitlines()
    rig.write_text("\n".join(line for line in text if not line.startswith("viscous_damping")), encoding="utf-8")
    ended = command("certify", "wall", "--rig", rig)
    assert ended.status == 4
    assert "haptic-fieldbus identify" in ended.err
