"""One new thing of each kind, as a person would add it: the steps in their order, and what a test says after each."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

Edit = Callable[[str], str]
"""The text of a file before → after; of a new file the text before is empty."""

PAGES = (
    "tests/test_project.py::test_a_page_that_is_written_by_a_script_is_what_it_writes_now",
    "tests/test_project.py::test_the_tables_of_methods_estimators_and_drives_are_those_of_the_code",
    "tests/test_schemas.py::test_the_schema_files_are_those_of_the_dataclasses",
)
MAKE_DOCS, GOLDEN = "make docs", "python -m tests.golden"


@dataclass(frozen=True)
class Step:
    """A file that a person writes or changes, and what the tests of `NewThing.complete` say then."""

    path: str
    edit: Edit
    says: str


@dataclass(frozen=True)
class NewThing:
    """A thing with all that is to be done for it."""

    name: str
    steps: tuple[Step, ...]
    generators: tuple[str, ...]
    generated: tuple[str, ...]
    """Files that the generators write."""
    complete: tuple[str, ...]
    """Tests that say what is missing."""
    cheap: tuple[str, ...] = ()
    """Tests over the kind that need no generated file and little time. All others run in the whole quick lane."""


def new(text: str) -> Edit:
    """A file that was not there."""

    def write(before: str) -> str:
        if before:
            raise ValueError("the file is there already")
        return text

    return write


def before(mark: str, line: str) -> Edit:
    """A line in front of the one that begins with `mark`."""

    def insert(text: str) -> str:
        if f"\n{mark}" not in text:
            raise ValueError(f"no line begins with {mark!r}")
        return text.replace(f"\n{mark}", f"\n{line}\n{mark}", 1)

    return insert


def both(first: Edit, second: Edit) -> Edit:
    """Two changes of one file."""
    return lambda text: second(first(text))


PROFILE = (Path(__file__).resolve().parents[1] / "profiles" / "generic_cia402.toml").read_text(encoding="utf-8")
SCENE = """\
description = "A soft floor above a hard one"

[axis.handle]
workspace = "linear"

[[element]]
kind = "wall"
name = "soft"
axis = "handle"
stiffness = 200.0
position = 0.005

[[element]]
kind = "wall"
name = "hard"
axis = "handle"
stiffness = 500.0
position = 0.015
"""
ELEMENT = '''\
"""A spring that grows stiffer the further it is pulled: F = −K·x − H·x³.

It stores what it takes, ½·K·x² + ¼·H·x⁴.
"""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from annotated_types import Ge

from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Length, Stiffness
from haptic_fieldbus.signals import Signal


@dataclass(frozen=True)
class CubicSpring:
    """`stiffness` K [N/m] at rest and `hardening` H [N/m³]; judged at `reach` [m]."""

    axis: str
    stiffness: Stiffness
    hardening: Annotated[float, Ge(0)]
    reach: Length
    name: str = "cubic_spring"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def force(self, position: float) -> float:
        return -self.stiffness * position - self.hardening * position**3

    def stored(self, position: float) -> float:
        """Return the energy that it can give back from `position` [J]."""
        return 0.5 * self.stiffness * position**2 + 0.25 * self.hardening * position**4

    def linearised(self) -> StateSpace:
        """At `reach`."""
        return gain([[-self.stiffness - 3.0 * self.hardening * self.reach**2, 0.0]])
'''
SHEET = '''\
"""A spring whose slope is bounded within reach."""

from haptic_fieldbus.scenes.cubic_spring import CubicSpring
from tests.scenes.sheet import Motion, Sheet, at_once, resting, spring_leak

FURTHEST = 0.07
"""[m]; of all motions that are tried."""


def slope(spring: CubicSpring) -> float:
    return spring.stiffness + 3.0 * spring.hardening * FURTHEST**2


def stored(spring: CubicSpring, position: float) -> float:
    return 0.5 * spring.stiffness * position**2 + 0.25 * spring.hardening * position**4


SHEET = Sheet(
    examples=(CubicSpring("handle", stiffness=100.0, hardening=2.0e4, reach=0.03),),
    steepness=lambda spring: (slope(spring), 0.0, 0.0),
    stiffest=lambda spring: (at_once(spring.reach), 1.0),
    continuous=lambda spring, motion: stored(spring, motion.position[0]),
    sampled=lambda spring, motion: stored(spring, motion.position[0]) + spring_leak(slope(spring), motion),
    silent=lambda spring: [resting(0.0)],
    signs=lambda spring: [(resting(0.01), -1), (resting(-0.01), 1)],
)
'''
ONE_STEP = """\
def _mostly_implicit(x: Matrix) -> Matrix:
    return _solve(np.eye(len(x)) - 0.75 * x, x)


MOSTLY_IMPLICIT = _method(
    "mostly-implicit", 1, 1, lambda x: (1.0 + 0.25 * x) / (1.0 - 0.75 * x), _mostly_implicit, 1, (math.inf, math.inf),
    "all states at once, with a quarter of the rates of before and three of those of after",
)"""
TEXTBOOK = """\
def mostly_implicit(p: Number, v: Number, u: Number, after: Number, period: Number, square: Number) -> tuple[Any, Any]:
    there, here = 3 * period / 4, period / 4
    pull = here * (u - p) + there * (after - p - here * v)
    velocity = (v + square * pull) / (1 + there * there * square)
    return p + here * v + there * velocity, velocity

"""
ESTIMATOR = '''\
"""The last three differences, weighted 1, 2, 1: late by 3/2 T, and white noise comes out by √(1 + 1 + 1 + 1)/(4·T)."""

import numpy as np

from haptic_fieldbus.numerics.estimators.differences import shift_register
from haptic_fieldbus.numerics.estimators.estimator import Estimate, Estimator, EstimatorSetup
from haptic_fieldbus.numerics.linear import Matrix

WEIGHTS = (1.0, 1.0, -1.0, -1.0)


def _weights(setup: EstimatorSetup) -> Matrix:
    return np.array(WEIGHTS) / (4.0 * setup.period)


def _start(setup: EstimatorSetup) -> Estimate:
    window: list[float] = []

    def step(position: float) -> float:
        nonlocal window
        window = [position, *window[:3]] if window else [position] * 4
        newest, newer, older, oldest = window
        return (newest + newer - older - oldest) / (4.0 * setup.period)

    return step


BINOMIAL = Estimator(
    "binomial",
    "the last three differences, weighted 1, 2, 1",
    start=_start,
    system=lambda setup: shift_register(_weights(setup)),
    noise_gain=lambda setup: float(np.linalg.norm(_weights(setup))),
    delay=lambda setup: 1.5 * setup.period,
)
ESTIMATORS = (BINOMIAL,)
'''

_GOLDEN = "new: python -m tests.golden writes {}.txt; read it, then commit it"

THINGS: Mapping[str, NewThing] = {
    "profile": NewThing(
        "acme_lifter",
        (
            Step(
                "profiles/acme_lifter.toml",
                new(
                    PROFILE.replace('"generic"', '"acme"')
                    .replace('"CiA 402"', '"Lifter"')
                    .replace("[torque]", "[identity]\nvendor_id = 0x0ACE_0001\n\n[torque]", 1)
                    .replace('"left out: any vendor"', '"made up for this test"')
                ),
                _GOLDEN.format("acme_lifter"),
            ),
        ),
        (MAKE_DOCS, GOLDEN),
        ("profiles/README.md", "tests/golden/profiles/acme_lifter.txt"),
        ("tests/golden/test_plan_texts.py", PAGES[1]),
    ),
    "scene": NewThing(
        "two_floors",
        (Step("haptic_fieldbus/scenes/library/two_floors.toml", new(SCENE), _GOLDEN.format("two_floors")),),
        (MAKE_DOCS, GOLDEN),
        ("docs/reference/elements.md", "tests/golden/left_out/two_floors.txt", "tests/golden/scenes/two_floors.txt"),
        ("tests/golden/test_plan_texts.py",),
    ),
    "element": NewThing(
        "cubic_spring",
        (
            Step(
                "haptic_fieldbus/scenes/cubic_spring.py",
                new(ELEMENT),
                "add a line for cubic_spring to ELEMENTS in haptic_fieldbus/scenes/registry.py",
            ),
            Step(
                "haptic_fieldbus/scenes/registry.py",
                before('    "dahl"', '    "cubic_spring": ("haptic_fieldbus.scenes.cubic_spring", "CubicSpring"),'),
                "add tests/scenes/sheets/cubic_spring.py with the claims of the new kind",
            ),
            Step("tests/scenes/sheets/cubic_spring.py", new(SHEET), "run: make docs"),
        ),
        (MAKE_DOCS,),
        ("docs/reference/elements.md", "docs/reference/schemas/scene.schema.json"),
        (
            "tests/scenes/test_element_contract.py::test_every_module_beside_them_is_listed",
            "tests/scenes/test_element_contract.py::test_every_kind_has_a_sheet",
            *PAGES,
        ),
        (
            "tests/scenes/test_element_checks.py::test_every_kind_is_refused_with_any_number_that_is_none",
            "tests/scenes/test_stored.py::test_each_kind_states_its_energy_or_is_known_to_remember",
            "tests/scenes/test_surfaces.py",
        ),
    ),
    "integrator": NewThing(
        "mostly-implicit",
        (
            Step(
                "haptic_fieldbus/numerics/integrators/one_step.py",
                lambda text: f"{text}\n\n{ONE_STEP}\n",
                "add mostly-implicit to METHODS in ",
            ),
            Step(
                "haptic_fieldbus/numerics/integrators/__init__.py",
                before("        one_step.RK4,", "        one_step.MOSTLY_IMPLICIT,"),
                "add the step of mostly-implicit to TEXTBOOK in tests/numerics/textbook.py",
            ),
            Step(
                "tests/numerics/textbook.py",
                both(
                    before("TEXTBOOK:", f"{TEXTBOOK}\n"), before('    "rk4"', '    "mostly-implicit": mostly_implicit,')
                ),
                "run: make docs",
            ),
        ),
        (MAKE_DOCS,),
        (
            "docs/reference/methods.md",
            *(f"docs/images/lecture/{name}.png" for name in ("cost", "growth", "loop", "poles")),
        ),
        ("tests/numerics/test_integrators.py::test_every_method_has_a_textbook_and_a_line", *PAGES),
        (
            "tests/numerics/test_integrators.py",
            "tests/study/test_oracles.py",
            "tests/study/test_report_page.py::test_every_method_has_a_look_of_its_own",
        ),
    ),
    "estimator": NewThing(
        "binomial",
        (
            Step("haptic_fieldbus/numerics/estimators/binomial.py", new(ESTIMATOR), "add binomial to ESTIMATORS in "),
            Step(
                "haptic_fieldbus/numerics/estimators/__init__.py",
                before('    "low-pass"', '    "binomial": "binomial",'),
                "run: make docs",
            ),
        ),
        (MAKE_DOCS,),
        ("docs/reference/estimators.md",),
        ("tests/numerics/test_estimators.py::test_every_family_is_listed_in_full", *PAGES),
        ("tests/numerics/test_estimators.py",),
    ),
}
