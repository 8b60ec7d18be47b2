"""Couplings as files and Python give them: which axes, in which units, and what is refused."""

from pathlib import Path

import pytest

import haptic_fieldbus
from haptic_fieldbus.errors import SceneError
from haptic_fieldbus.scenes.catalogue import load_scene
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.signals import Workspace

HEAD = '[axis.rack]\nworkspace = "linear"\n[axis.pinion]\nworkspace = "rotary"\n[axis.other]\nworkspace = "linear"\n'
ELEMENT = '[[element]]\nkind = "coupling"\n'


def loaded(folder: Path, text: str, name: str = "scene") -> Coupling:
    path = folder / f"{name}.toml"
    path.write_text(HEAD + ELEMENT + text, encoding="utf-8")
    (found,) = load_scene(path).elements
    assert isinstance(found, Coupling)
    return found


def fault(folder: Path, text: str) -> str:
    with pytest.raises(SceneError) as refused:
        loaded(folder, text)
    return "\n".join(f"{each.key}: {each.message}" for each in refused.value.faults)


def test_texts_have_the_units_of_the_first_axis(tmp_path: Path) -> None:
    found = loaded(tmp_path, 'axes = ["rack", "pinion"]\nratio = 0.02\nstiffness = "0.3 N/mm"\ndead_band = "1 mm"\n')
    assert (found.stiffness, found.dead_band) == pytest.approx((300.0, 1e-3))
    turned = loaded(tmp_path, 'axes = ["pinion", "rack"]\nratio = 50\nstiffness = "2 mNm/rad"\nsaturation = "30 mNm"\n')
    assert (turned.stiffness, turned.saturation) == pytest.approx((2e-3, 0.03))
    assert "because the axis is linear" in fault(tmp_path, 'axes = ["rack", "other"]\nstiffness = "2 mNm/rad"\n')


def test_axes_of_one_kind_have_a_ratio_of_one(tmp_path: Path) -> None:
    assert loaded(tmp_path, 'axes = ["rack", "other"]\nstiffness = 100\n').transmission == 1.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            'axes = ["rack", "pinion"]\nstiffness = 100\n',
            "ratio: missing; expected a number: motion of the linear axis per motion of the rotary axis [m/rad]",
        ),
        (
            'axes = ["pinion", "rack"]\nstiffness = 100\n',
            "ratio: missing; expected a number: motion of the rotary axis per motion of the linear axis [rad/m]",
        ),
        ('axes = ["rack", "rack"]\nstiffness = 100\n', "rack, rack: expected two different axes"),
        ('axes = ["rack"]\nstiffness = 100\n', "expected a list of 2 values, each a string"),
        ('axes = ["rack", "other", "pinion"]\nstiffness = 100\n', "expected a list of 2 values, each a string"),
        ('axes = ["rack", "othr"]\nstiffness = 100\n', "axes[1]: no [axis.othr] in this file; nearest: other"),
        ("stiffness = 100\n", "axes: missing"),
        ('axes = ["rack", "other"]\nstiffness = 100\nratio = 0\n', "ratio: 0: expected another number"),
        ('axes = ["rack", "other"]\nstiffness = 0\n', "stiffness: 0; expected a number from 1e-12"),
    ],
)
def test_what_makes_no_sense_is_refused_with_a_sentence(tmp_path: Path, text: str, expected: str) -> None:
    assert expected in fault(tmp_path, text)


def test_a_setting_may_give_the_ratio(tmp_path: Path) -> None:
    path = tmp_path / "scene.toml"
    path.write_text(f'{HEAD}{ELEMENT}axes = ["rack", "pinion"]\nstiffness = 10\n', encoding="utf-8")
    (found,) = load_scene(path, {"coupling.ratio": 0.05}).elements
    assert isinstance(found, Coupling)
    assert found.ratio == 0.05


def test_scenes_made_in_python_are_held_to_the_same() -> None:
    axes = (SceneAxis("rack", Workspace.LINEAR), SceneAxis("pinion", Workspace.ROTARY))
    with pytest.raises(SceneError, match=r"coupling.ratio: missing; expected a number.*\[m/rad\]"):
        haptic_fieldbus.plan(Scene("made", "", axes, (Coupling(("rack", "pinion"), 100.0),)))
    with pytest.raises(SceneError, match="no axis 'wheel'"):
        haptic_fieldbus.plan(Scene("made", "", axes, (Coupling(("rack", "wheel"), 100.0),)))
