"""Oracles of report cases share no code with what they judge: each imports numpy, `math` and other oracles alone."""

import ast
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg

from haptic_fieldbus.study import oracles
from haptic_fieldbus.study.oracles import energies, events
from haptic_fieldbus.study.oracles.contact import Pressed, limit_in_contact, schur_cohn_limit
from haptic_fieldbus.study.oracles.events import states_of

ROOM = Path(oracles.__file__).parent
NUMBERS = {"math", "numpy", "numpy.typing", "decimal"}
"""Modules with which an oracle computes; `decimal` has more digits than `math`."""
WORDS = {"collections.abc", "dataclasses", "functools", "typing"}
"""Modules that compute nothing."""


def imported(text: str) -> set[str]:
    """Modules that are imported anywhere, also inside of functions."""
    nodes = list(ast.walk(ast.parse(text)))
    plain = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    return plain | {f"{'.' * node.level}{node.module}" for node in nodes if isinstance(node, ast.ImportFrom)}


@pytest.mark.parametrize("path", sorted(ROOM.glob("**/*.py")), ids=lambda path: path.stem)
def test_an_oracle_imports_numpy_and_math_and_other_oracles_alone(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    others = {each for each in imported(text) if not each.startswith(f"{oracles.__name__}.")}
    assert others <= NUMBERS | WORDS
    assert "__import__" not in text
    assert "importlib" not in text


def borrowed(text: str) -> dict[str, set[str]]:
    """Names that the bodies of functions named `…_by_hand` use of the package, other than oracles."""
    tree = ast.parse(text)
    foreign = {
        alias.asname or alias.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and f"{node.module}.".startswith("haptic_fieldbus.")
        for alias in node.names
        if not f"{node.module}.{alias.name}.".startswith(f"{oracles.__name__}.")
    }
    by_hand = [node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name.endswith("_by_hand")]
    return {
        function.name: {
            each.id for line in function.body for each in ast.walk(line) if isinstance(each, ast.Name)
        } & foreign
        for function in by_hand
    }  # fmt: skip


def test_what_a_case_computes_by_hand_uses_oracles_alone() -> None:
    found = [borrowed(path.read_text(encoding="utf-8")) for path in ROOM.with_name("cases").glob("*.py")]
    assert sum(map(len, found)) > 5
    assert [each for functions in found for each in functions.items() if each[1]] == []


def test_what_is_borrowed_is_seen() -> None:
    text = "from haptic_fieldbus.margins import a, b\nfrom haptic_fieldbus.study.oracles import c\n"
    assert borrowed(text + "def _by_hand(x: b):\n    return a(x) + c(x)\n") == {"_by_hand": {"a"}}


def test_every_import_is_seen() -> None:
    text = "import a.b\nfrom .c import d\ndef f():\n    from e import g\n"
    assert imported(text) == {"a.b", ".c", "e"}


class TestOneAgainstAnother:
    """Oracles that answer the same question in other ways, and scipy."""

    PERIOD = 1e-3
    DEVICE = Pressed(0.1, 2.0, 0.0, 0.0, 1.0, 0.0, PERIOD)
    """Its mass and damping alone count here."""

    @pytest.mark.parametrize("delay", [0.0, 0.3, 1.0, 2.6])
    def test_a_loop_from_event_to_event_and_a_polynomial_of_60_digits(self, delay: float) -> None:
        found = limit_in_contact(events.motor(0.1, 2.0), self.PERIOD, delay * self.PERIOD)
        assert found == pytest.approx(schur_cohn_limit(self.DEVICE, self.PERIOD, delay), rel=1e-7)

    @pytest.mark.parametrize("delay", [0.0, 1.0, 2.0])
    def test_the_worst_of_all_motions_and_the_mean_age_of_a_force(self, delay: float) -> None:
        """b = K·(T/2 + td) for whole periods of delay."""
        drives = [energies.LateDrive(2.0, delay * self.PERIOD)]
        share = energies.worst_share(lambda z: complex(-800.0), drives, self.PERIOD)
        assert share == pytest.approx(800.0 * (0.5 + delay) * self.PERIOD / 2.0, rel=1e-5)

    def test_a_spring_between_equal_drives_needs_twice_the_damping(self) -> None:
        drives = [energies.LateDrive(2.0, 0.3e-3, 0.2e-3)] * 2
        ends = np.array([[1.0, -1.0], [-1.0, 1.0]], dtype=np.complex128)
        both = energies.worst_share(lambda z: -400.0 * ends, drives, self.PERIOD)
        alone = energies.worst_share(lambda z: complex(-400.0), drives[:1], self.PERIOD)
        assert both == pytest.approx(2.0 * alone, rel=1e-6)

    @pytest.mark.parametrize("stiff", [1.0, 4e4])
    def test_a_doubled_motion_and_the_exponential_of_scipy(self, stiff: float) -> None:
        system = np.array([[0.0, 1.0, 0.0], [-stiff, -3.0, 2.0], [0.0, 0.0, -50.0]])
        states = states_of(system, np.array([0.01, 0.0, 1.0]), 0.01, 37)
        assert states.shape == (38, 3)
        for step in (0, 1, 2, 16, 37):
            expected = scipy.linalg.expm(system * 0.01 * step) @ [0.01, 0.0, 1.0]
            np.testing.assert_allclose(states[step], expected, rtol=1e-10, atol=1e-12)
