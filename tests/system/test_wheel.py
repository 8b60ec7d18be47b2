"""The wheel that is shipped, installed where there is nothing else, and used from another folder."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.cli import test_first_drive_guide as first_drive
from tests.peers.hosts import require_multicast

PROJECT = Path(__file__).resolve().parents[2]
PROFILES = {path.name for path in (PROJECT / "profiles").glob("*.toml")}
SCENES = {path.name for path in (PROJECT / "haptic_fieldbus" / "scenes" / "library").glob("*.toml")}

pytestmark = pytest.mark.xdist_group("wheel")


def call(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a program that sees nothing of this checkout."""
    hidden = ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "COVERAGE_PROCESS_START")
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    return subprocess.run([str(word) for word in command], cwd=cwd, env=environment, capture_output=True, text=True)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dist")
    built = call(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder, PROJECT, cwd=folder)
    assert built.returncode == 0, built.stderr
    (path,) = folder.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of programs of a clean environment that holds the wheel and what it depends on."""
    folder = tmp_path_factory.mktemp("clean")
    made = call(sys.executable, "-m", "venv", folder, cwd=folder)
    assert made.returncode == 0, made.stderr
    project = tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]
    extra = project["optional-dependencies"]
    needed = [*project["dependencies"], *extra["plot"], *(each for each in extra["test"] if each.startswith("pytest>"))]
    pip = (folder / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    fetched = call(*pip, *needed, cwd=folder)
    if fetched.returncode != 0:
        pytest.skip(f"no package index can be reached, so the wheel is not installed: {fetched.stderr.strip()[-200:]}")
    installed = call(*pip, "--no-deps", wheel, cwd=folder)
    assert installed.returncode == 0, installed.stderr
    return folder / "bin"


def test_the_wheel_carries_package_profiles_scenes_and_licence(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"haptic_fieldbus/profiles/{name}" for name in PROFILES} <= set(names)
    assert {f"haptic_fieldbus/scenes/library/{name}" for name in SCENES} <= set(names)
    assert "haptic_fieldbus/py.typed" in names
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert {name.partition("/")[0].partition("-")[0] for name in names} == {"haptic_fieldbus"}


def test_a_wall_is_rendered_from_the_wheel_by_the_packages_that_are_here(wheel: Path, tmp_path: Path) -> None:
    unpacked = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(unpacked)
    program = (
        f"import sys; sys.path.insert(0, {str(unpacked)!r}); import haptic_fieldbus as h; "
        "print(h.__file__, h.run('wall', drive='maxon_epos4', duration=0.1).missed_cycles)"
    )
    finished = call(sys.executable, "-c", program, cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr
    path, missed = finished.stdout.split()
    assert Path(path).is_relative_to(unpacked)
    assert missed == "0"


@pytest.mark.thorough("installs into a clean environment")
def test_all_that_the_wheel_needs_is_installed_with_it(environment: Path) -> None:
    checked = call(environment / "python", "-m", "pip", "check", cwd=environment)
    assert checked.returncode == 0, checked.stdout


@pytest.mark.thorough("installs into a clean environment, and real time")
def test_the_page_of_the_first_drive_is_walked_from_the_wheel_with_the_extra_that_it_names(
    wheel: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """In an environment of its own, so that nothing of another extra is there; beside a drive on another group."""
    folder = tmp_path_factory.mktemp("first day")
    made = call(sys.executable, "-m", "venv", folder / "clean", cwd=folder)
    assert made.returncode == 0, made.stderr
    programs = folder / "clean" / "bin"
    (extra,) = re.findall(r"^pip install -e '\.(\[\w+\])'$", first_drive.TEXT, re.MULTILINE)
    pip = (programs / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet")
    fetched = call(*pip, f"{wheel}{extra}", cwd=folder)
    if fetched.returncode != 0:
        pytest.skip(f"no package index can be reached, so the wheel is not installed: {fetched.stderr.strip()[-200:]}")
    walk = first_drive.Walk(folder, [str(programs / "haptic-fieldbus")], seen="")
    require_multicast(walk.port)
    with walk.beside(first_drive.SIMULATE, "node 5"), first_drive.another_bench(walk):
        first_drive.walked(walk)


@pytest.mark.thorough("installs into a clean environment")
def test_the_demo_runs_from_the_wheel(environment: Path, tmp_path: Path) -> None:
    words = "run wall --drive maxon_epos4 --hand release --duration 3 --plot demo.png"
    finished = call(environment / "haptic-fieldbus", *words.split(), cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr
    assert "verdict" in finished.stdout
    assert (tmp_path / "demo.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough("installs into a clean environment")
def test_profiles_and_scenes_are_found_in_the_wheel(environment: Path, tmp_path: Path) -> None:
    for kind, names in (("profiles", PROFILES), ("scenes", SCENES)):
        listed = call(environment / "haptic-fieldbus", kind, "list", cwd=tmp_path).stdout
        assert {Path(name).stem for name in names} == {line.split()[0] for line in listed.splitlines()[1:]}


@pytest.mark.thorough("installs into a clean environment")
def test_python_can_finds_the_simulated_bus_of_the_wheel(environment: Path, tmp_path: Path) -> None:
    program = "import can; assert 'haptic_sim' in can.VALID_INTERFACES"
    finished = call(environment / "python", "-c", program, cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr


@pytest.mark.thorough("installs into a clean environment")
def test_pytest_finds_the_fixtures_of_the_wheel(environment: Path, tmp_path: Path) -> None:
    example = shutil.copytree(PROJECT / "examples" / "test_your_master", tmp_path / "example")
    finished = call(environment / "python", "-W", "error", "-m", "pytest", "-k", "enabled", cwd=example)
    assert finished.returncode == 0, finished.stdout + finished.stderr
    assert "warning" not in finished.stdout


@pytest.mark.thorough("installs into a clean environment")
def test_the_python_api_runs_from_the_wheel(environment: Path, tmp_path: Path) -> None:
    program = "import haptic_fieldbus as h; print(h.__file__, h.run('wall', duration=0.1).missed_cycles)"
    finished = call(environment / "python", "-c", program, cwd=tmp_path)
    assert finished.returncode == 0, finished.stderr
    path, missed = finished.stdout.split()
    assert Path(path).is_relative_to(environment.parent)
    assert missed == "0"
