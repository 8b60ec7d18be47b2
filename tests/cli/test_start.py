"""Modules that a command loads before it does anything."""

import gc
import inspect
import subprocess
import sys

import pytest

from haptic_fieldbus.cli import main
from haptic_fieldbus.cli.app import COMMANDS, GROUPS, application

HEAVY = ("numpy", "numpy.ma", "can", "canopen", "matplotlib", "tree_sitter", "asyncio", "haptic_fieldbus.cli.sweep")


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


def test_a_command_that_is_not_invoked_has_the_line_of_its_docstring() -> None:
    lines = {home.partition(":")[2]: line for panel in COMMANDS.values() for home, line in panel.items()}
    app = application()
    for each in app.registered_commands:
        assert each.callback is not None
        said = inspect.getdoc(each.callback) or ""
        assert said.split("\n\n")[0].replace("\n", " ") == lines.pop(each.callback.__name__)
    assert lines == {}
    groups = {each.name: each.typer_instance for each in app.registered_groups}
    assert {name: group and group.info.help for name, group in groups.items()} == GROUPS


def test_the_words_of_a_command_line_choose_the_commands_that_are_complete() -> None:
    complete = {each.callback.__name__ for each in application(["plan", "x"]).registered_commands if each.callback}
    assert complete == {"plan", "_not_invoked"}


def test_a_command_leaves_the_garbage_collector_as_it_was(capsys: pytest.CaptureFixture[str]) -> None:
    before, frozen = gc.get_threshold(), gc.get_freeze_count()
    with pytest.raises(SystemExit):
        main(["--version"])
    assert capsys.readouterr().out.startswith("haptic-fieldbus ")
    assert gc.get_threshold() == before
    assert gc.get_freeze_count() <= frozen


def test_a_plan_is_told_without_a_search_for_garbage() -> None:
    """From the import of the package to the end of the process; that took half as long again."""
    program = (
        "import gc, sys\n"
        "from haptic_fieldbus.cli import main\n"
        "sys.argv[1:] = ['plan', 'wall']\n"
        "searches = []\n"
        "gc.callbacks.append(lambda phase, told: searches.append(phase))\n"
        "try:\n"
        "    main()\n"
        "finally:\n"
        "    print('searched', len(searches), gc.get_freeze_count() > 0)\n"
    )
    finished = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert finished.stdout.splitlines()[-1] == "searched 0 True"
