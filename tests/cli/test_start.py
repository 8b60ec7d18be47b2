"""Modules that a command loads before it does anything."""

import subprocess
import sys

import pytest

HEAVY = ("numpy", "can", "canopen", "matplotlib", "tree_sitter", "asyncio")


def loaded_by(*words: str) -> set[str]:
    """The heavy modules in memory after a command, in a process of its own."""
    program = (
        "import sys\n"
        "from haptic_fieldbus.cli import main\n"
        "try:\n"
        "    main(sys.argv[1:])\n"
        "except SystemExit as stopped:\n"
        "    assert not stopped.code, stopped.code\n"
        f"print('loaded', *[name for name in {HEAVY} if name in sys.modules])\n"
    )
    finished = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=True)
    return set(finished.stdout.splitlines()[-1].split()[1:])


@pytest.mark.thorough("starts a process for each command", quick=1)
@pytest.mark.parametrize(
    "words",
    [
        ("--help",),
        ("run", "--help"),
        ("rehearse", "--help"),
        ("profiles", "--help"),
        ("profiles", "list"),
        ("profiles", "show", "maxon_epos4"),
    ],
    ids=" ".join,
)
def test_help_and_profiles_load_nothing_heavy(words: tuple[str, ...]) -> None:
    assert loaded_by(*words) == set()


@pytest.mark.thorough("starts a process for each command", quick=("plan wall",))
@pytest.mark.parametrize("words", [("scenes", "list"), ("plan", "wall")], ids=" ".join)
def test_scenes_and_plans_load_no_bus_and_no_plots(words: tuple[str, ...]) -> None:
    assert loaded_by(*words) <= {"numpy"}


def test_python_runs_the_package_as_the_command() -> None:
    finished = subprocess.run(
        [sys.executable, "-m", "haptic_fieldbus", "--version"], capture_output=True, text=True, check=True
    )
    assert finished.stdout.startswith("haptic-fieldbus 0.")
