"""The open loop against closed forms, the loop's own steps and scipy."""

import math
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.signal

import haptic_fieldbus
from haptic_fieldbus.api.open_loop import GroundedCoupling
from haptic_fieldbus.api.session import OwnEffort
from haptic_fieldbus.errors import DocumentError, UsageError
from haptic_fieldbus.numerics.integrators import METHODS, bind
from haptic_fieldbus.scenes.coupling import Coupling
from haptic_fieldbus.scenes.scene import Scene, SceneAxis
from haptic_fieldbus.scenes.sprung_mass import SprungMass
from haptic_fieldbus.scenes.wall import Wall
from haptic_fieldbus.signals import Workspace
from tests.loops import Array

STIFFNESS, MASS = 200.0, 0.5
OMEGA = math.sqrt(STIFFNESS / MASS)
AXES = (SceneAxis("handle", Workspace.LINEAR),)


@pytest.mark.parametrize("method", METHODS)
def test_a_step_finds_the_mass_at_rest_where_the_puck_was(method: str) -> None:
    found = haptic_fieldbus.response("sprung_mass", amplitude=0.3, method=method)
    assert found.states["position"][0] == pytest.approx(0.0, abs=1e-15)
    assert found.force[0] == pytest.approx(-STIFFNESS * 0.3, rel=1e-14)
    assert len(found.time) == 1001
    np.testing.assert_array_equal(found.position, 0.3)


@pytest.mark.parametrize("method", ["exact-zoh", "exact-foh"])
def test_an_exact_step_is_the_closed_form(method: str) -> None:
    """p = A·(1 − cos ωt), F = −K·A·cos ωt"""
    found = haptic_fieldbus.response("sprung_mass", method=method, duration=3.0)
    np.testing.assert_allclose(found.states["position"], 1.0 - np.cos(OMEGA * found.time), atol=1e-12)
    np.testing.assert_allclose(found.states["velocity"], OMEGA * np.sin(OMEGA * found.time), atol=1e-10)
    np.testing.assert_allclose(found.force, -STIFFNESS * np.cos(OMEGA * found.time), atol=1e-9)
    assert found.spectral_radius == pytest.approx(1.0, abs=1e-12)


def test_a_free_puck_after_a_step_is_its_two_normal_modes() -> None:
    """Undamped: M·ü + K·u = 0 for the ways u of puck and mass from rest at the handle, by scipy's eigenvectors."""
    found = haptic_fieldbus.response("free_puck", settings={"free_puck.damping": 0.0}, duration=3.0)
    masses, stiffness = np.diag([0.1, 0.3]), np.array([[300.0 + 150.0, -150.0], [-150.0, 150.0]])
    squares, modes = scipy.linalg.eigh(stiffness, masses)
    amplitudes = modes.T @ masses @ [-1.0, -1.0]
    ways = modes @ (amplitudes[:, None] * np.cos(np.sqrt(squares)[:, None] * found.time))
    np.testing.assert_allclose(found.states["position"], 1.0 + ways[0], atol=1e-9)
    np.testing.assert_allclose(found.states["mass position"], 1.0 + ways[1], atol=1e-9)
    np.testing.assert_allclose(found.force, 300.0 * ways[0], atol=1e-7)


@pytest.mark.thorough("18 integrations by an adaptive solver", quick=3)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("motion", ["ramp", "sine@2"])
def test_every_method_converges_to_scipys_answer(method: str, motion: str) -> None:
    found = haptic_fieldbus.response("sprung_mass", input=motion, method=method, rate=8000.0)
    system = ([[0.0, 1.0], [-(OMEGA**2), 0.0]], [[0.0], [OMEGA**2]], [[1.0, 0.0]], [[0.0]])
    _, expected, _ = scipy.signal.lsim(system, found.position, found.time, interp=True)
    error = np.abs(found.states["position"] - expected).max() / np.abs(expected).max()
    assert error < (0.03 if METHODS[method].order == 1 else 1e-4)
    np.testing.assert_allclose(found.force, STIFFNESS * (found.states["position"] - found.position), atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_a_motion_that_begins_at_rest_is_what_the_loop_renders(method: str) -> None:
    found = haptic_fieldbus.response("sprung_mass", input="sine@3", method=method)
    step = bind(SprungMass("handle", STIFFNESS, MASS).dynamics, 1e-3, method)
    np.testing.assert_allclose(found.force, [step(x) for x in found.position.tolist()], atol=1e-9)


def test_forward_euler_grows_by_its_spectral_radius_until_a_number_overflows() -> None:
    found = haptic_fieldbus.response("sprung_mass", method="forward-euler", rate=5.0, duration=500.0)
    assert found.spectral_radius == pytest.approx(math.sqrt(1.0 + (OMEGA / 5.0) ** 2))
    assert found.diverged
    assert 400 < len(found.time) < 2501
    lengths = {len(values) for values in (found.time, found.position, found.force, *found.states.values())}
    assert lengths == {len(found.time)}
    assert all(np.isfinite(values).all() for values in (found.force, *found.states.values()))


def test_a_wall_answers_with_its_force_and_nothing_else() -> None:
    found = haptic_fieldbus.response("wall", input="ramp", amplitude=0.05)
    np.testing.assert_allclose(found.force, np.minimum(0.0, -600.0 * (found.position - 0.02)), atol=1e-12)
    assert (found.states, found.spectral_radius, found.diverged) == ({}, None, False)


def test_a_damper_works_on_the_estimated_velocity() -> None:
    found = haptic_fieldbus.response("damped_wall", input="step", amplitude=0.03)
    rest = -600.0 * 0.01
    np.testing.assert_allclose(found.force[:3], [rest - 2.0 * 0.03 / 1e-3, rest, rest])


@pytest.mark.parametrize("estimator", ["tick-interval", "low-pass"])
def test_any_estimator_may_be_chosen(estimator: str) -> None:
    found = haptic_fieldbus.response("damped_wall", input="ramp", amplitude=0.05, estimator=estimator)
    assert found.force[-1] == pytest.approx(-600.0 * 0.03 - 2.0 * 0.05, rel=0.02)


def test_elements_add_up_and_a_second_ones_states_carry_its_name() -> None:
    masses = (SprungMass("handle", 200.0, 0.5), SprungMass("handle", 50.0, 0.1, name="second"))
    both = haptic_fieldbus.response(Scene("two", "", AXES, masses), method="rk4")
    assert list(both.states) == ["position", "velocity", "second.position", "second.velocity"]
    single = [haptic_fieldbus.response(Scene("one", "", AXES, (mass,)), method="rk4").force for mass in masses]
    np.testing.assert_allclose(both.force, single[0] + single[1])


def test_a_scene_without_elements_answers_with_nothing() -> None:
    found = haptic_fieldbus.response(Scene("free", "", AXES, ()))
    assert not found.force.any()


def test_a_law_that_overflows_ends_the_response() -> None:
    class Steep(Wall):
        def force(self, position: float, velocity: float = 0.0) -> float:
            return 1e308 * position

    found = haptic_fieldbus.response(Scene("huge", "", AXES, (Steep("handle", 1.0),)), input="ramp", amplitude=1e5)
    assert found.diverged
    assert len(found.time) == 1


def test_a_law_that_raises_an_overflow_ends_the_response() -> None:
    class Explosive(Wall):
        def force(self, position: float, velocity: float = 0.0) -> float:
            return math.exp(1e5 * position)

    found = haptic_fieldbus.response(Scene("huge", "", AXES, (Explosive("handle", 1.0),)), input="ramp", amplitude=1.0)
    assert found.diverged
    assert 1 < len(found.time) < 100


class TestFile:
    @staticmethod
    def written(folder: Path, text: str) -> Path:
        path = folder / "motion.csv"
        path.write_text(text)
        return path

    def test_its_rows_are_joined_by_straight_lines(self, tmp_path: Path) -> None:
        path = self.written(tmp_path, "time,position,note\n1.0,0.5,a\n1.2,0.7,b\n1.5,0.1,c\n")
        found = haptic_fieldbus.response("sprung_mass", input=path, amplitude=2.0, rate=100.0)
        expected: Array = 2.0 * np.interp(1.0 + found.time, [1.0, 1.2, 1.5], [0.5, 0.7, 0.1])
        np.testing.assert_allclose(found.position, expected)
        assert found.time[-1] == pytest.approx(0.5)

    def test_the_mass_rests_where_the_file_begins(self, tmp_path: Path) -> None:
        path = self.written(tmp_path, "time,position\n0,0.5\n1,0.5\n")
        found = haptic_fieldbus.response("sprung_mass", input=str(path))
        np.testing.assert_allclose(found.force, 0.0, atol=1e-9)

    @pytest.mark.parametrize(
        "text",
        ["", "time,position\n0,1\n", "time,place\n0,1\n1,2\n", "time,position\n0,1\n0,2\n", "time,position\n0,x\n1,2\n",
         "time,position\n0,1\n1,nan\n", "time,position\n0\n1,2\n"],
    )  # fmt: skip
    def test_one_that_is_no_motion_is_refused(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(DocumentError, match="expected"):
            haptic_fieldbus.response("wall", input=self.written(tmp_path, text))

    def test_one_that_does_not_exist_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(DocumentError, match="cannot be read"):
            haptic_fieldbus.response("wall", input=tmp_path / "none.csv")


@pytest.mark.parametrize("motion", ["jump", "sine", "sine@", "sine@x", "sine@0", "sine@-1", "sine@inf"])
def test_a_motion_that_does_not_exist_is_refused(motion: str) -> None:
    with pytest.raises(UsageError, match=r"step, ramp, sine@HZ|frequency above 0"):
        haptic_fieldbus.response("wall", input=motion)


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"amplitude": math.nan}, "amplitude"),
        ({"rate": 0.0}, "rate"),
        ({"duration": -1.0}, "duration"),
        ({"settings": {"wall.stiffness": math.nan}}, "wall.stiffness"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(wrong: dict[str, object], sentence: str) -> None:
    with pytest.raises((UsageError, ValueError), match=sentence):
        haptic_fieldbus.response("wall", **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("mass", [0.0, -1.0, math.nan])
def test_a_virtual_mass_that_cannot_be_is_refused_with_its_limit(mass: float) -> None:
    with pytest.raises(ValueError, match=r"sprung_mass\.mass"):
        haptic_fieldbus.response("sprung_mass", settings={"sprung_mass.mass": mass})


@pytest.mark.parametrize(("axes", "expected"), [(("a", "b"), -200.0), (("b", "a"), -200.0 * 0.5**2)])
def test_what_is_coupled_to_the_first_axis_stands_still(axes: tuple[str, str], expected: float) -> None:
    """A unit step of axis a twists by 1 where it is the first, and by −n where it is the second."""
    spaces = (SceneAxis("a", Workspace.LINEAR), SceneAxis("b", Workspace.LINEAR))
    shaft = Coupling(axes, stiffness=200.0, damping=3.0, ratio=0.5)
    found = haptic_fieldbus.response(Scene("shaft", "", spaces, (Wall("b", 100.0), shaft)), duration=0.005)
    np.testing.assert_allclose(found.force[1:], expected)
    assert abs(found.force[0]) > 3000.0 * abs(expected) / 200.0, "the step's velocity is damped"
    np.testing.assert_allclose(GroundedCoupling("a", shaft).linearised().d, [[expected, 3.0 / 200.0 * expected]])


def test_settings_hold_for_a_scene_made_in_python_too() -> None:
    scene = Scene("one", "", AXES, (Wall("handle", 100.0),))
    found = haptic_fieldbus.response(scene, settings={"wall.stiffness": "0.2 N/mm"}, duration=0.01)
    assert found.force[-1] == pytest.approx(-200.0)


def test_an_element_that_needs_the_torque_of_a_drive_is_refused() -> None:
    effort = OwnEffort("handle", lambda feedback: 0.0, ("torque",))
    scene = Scene("effort", "", (SceneAxis("handle", Workspace.LINEAR),), (effort,))
    with pytest.raises(UsageError, match="element effort needs torque actual, which a prescribed motion does not have"):
        haptic_fieldbus.response(scene)
