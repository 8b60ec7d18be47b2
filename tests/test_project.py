"""The project's own promises: documents, dependencies, checks and contracts agree with the code."""

import ast
import importlib.util
import os
import pkgutil
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

import haptic_fieldbus
from haptic_fieldbus.api.site import BUS_GROUP, SIMULATION_GROUP
from haptic_fieldbus.cli import main
from haptic_fieldbus.numerics.estimators import GROUP as ESTIMATOR_GROUP
from haptic_fieldbus.numerics.integrators import GROUP as METHOD_GROUP
from haptic_fieldbus.protocols.registry import GROUP
from haptic_fieldbus.scenes.own import GROUP as ELEMENT_GROUP
from haptic_fieldbus.sim.hand import GROUP as HAND_GROUP
from tests.cases import every
from tests.source import modules, nodes_of, reads_the_source, tree_of
from tests.view.served import serving

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "haptic_fieldbus"
SETTINGS = tomllib.loads((PROJECT / "pyproject.toml").read_text())
MAKEFILE = (PROJECT / "Makefile").read_text()
DOCUMENTS = sorted(
    path for path in PROJECT.rglob("*.md") if not re.match(r"(.*/)?\.|build/", str(path.relative_to(PROJECT)))
)
CURRENT = [path for path in DOCUMENTS if path.parent.name != "decisions"]
"""A decision names what there was when it was made."""
PLACEHOLDER = re.compile(r"NAME|KIND|\bname\b")
ENTRY_POINT_GROUPS = {GROUP, BUS_GROUP, SIMULATION_GROUP, ELEMENT_GROUP, ESTIMATOR_GROUP, METHOD_GROUP, HAND_GROUP}
LONGEST_FILE = 600
REFUSED = 4

DISTRIBUTIONS = {
    "can": "python-can",
    "serial": "pyserial",
    "tree_sitter": "tree-sitter",
    "tree_sitter_toml": "tree-sitter-toml",
}
"""Where a package is not called as its distribution is."""


def shown_commands() -> Iterator[tuple[Path, str]]:
    """Every line of every `sh` block, its comment left out."""
    for document in DOCUMENTS:
        for block in re.findall(r"^```sh\n(.*?)^```", document.read_text(), re.MULTILINE | re.DOTALL):
            for line in block.splitlines():
                command = line.partition("#")[0].strip()
                if command:
                    yield document, command


def is_quick(command: str) -> bool:
    """Whether it neither measures, nor draws, nor renders for seconds, nor starts a kernel."""
    words = command.split()
    measures = {"report", "--plot", "vcan"} & set(words) or (words[1] == "run" and "--duration 1" not in command)
    return not measures and not is_lasting(command)


def is_lasting(command: str) -> bool:
    """Whether it serves a page until it is stopped."""
    return bool({"demo", "view", "--view"} & set(command.split()))


def check_page(*words: str) -> None:
    """Serve a page, of a run that another command has begun where this one only attaches."""
    if words == ("view",):
        with serving("demo", "--no-browser", "--port", "0") as run:
            check_page("view", "--run", str(run.process.pid))
        return
    options = {"demo": ["--no-browser", "--port"], "run": ["--view-port"], "view": ["--port"]}[words[0]]
    with serving(*words, *options, "0"):
        pass


OWN_COMMANDS = sorted({command for _, command in shown_commands() if command.startswith("haptic-fieldbus ")})
QUICK_COMMANDS = tuple(filter(is_quick, OWN_COMMANDS))


@pytest.mark.thorough("some measure, draw or render for seconds", quick=QUICK_COMMANDS)
@pytest.mark.parametrize("command", OWN_COMMANDS, ids=str)
def test_every_command_in_the_documents_does_what_they_say(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A report measures for a while: in a process of its own, where nobody counts which lines are run."""
    (tmp_path / "examples").symlink_to(PROJECT / "examples")
    monkeypatch.chdir(tmp_path)
    if command.split()[1] == "report":
        subprocess.run([sys.executable, "-m", "haptic_fieldbus", *command.split()[1:]], check=True)
        return
    if is_lasting(command):
        check_page(*command.split()[1:])
        return
    with pytest.raises(SystemExit) as stopped:
        main(command.split()[1:])
    assert (stopped.value.code or 0) == (REFUSED if "stiffness=3000" in command else 0)


def maker(name: str) -> ModuleType:
    """A script of docs/ that writes a page; like a program it finds what stands beside it."""
    if str(PROJECT / "docs") not in sys.path:
        sys.path.append(str(PROJECT / "docs"))
    spec = importlib.util.spec_from_file_location(name, PROJECT / "docs" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.thorough(
    "a page is written from runs",
    quick=("make_elements", "make_api", "make_faults", "make_rig_files", "make_modbus_profiles"),
)
@pytest.mark.parametrize(
    "name", ["make_elements", "make_api", "make_faults", "make_rig_files", "make_modbus_profiles", "make_buses"]
)
def test_a_page_that_is_written_by_a_script_is_what_it_writes_now(name: str) -> None:
    script = maker(name)
    assert script.FILE.read_text(encoding="utf-8") == script.page(), "run: make docs"


def test_the_tables_of_methods_estimators_and_drives_are_those_of_the_code() -> None:
    for path, text in maker("make_tables").pages().items():
        assert path.read_text(encoding="utf-8") == text, "run: make docs"


def test_every_public_name_is_on_the_page_of_the_api() -> None:
    script = maker("make_api")
    listed = {name for names in script.SECTIONS.values() for name in names}
    text = script.FILE.read_text(encoding="utf-8")
    errors = set(re.findall(r"^ *- `(\w+Error)`", text, re.MULTILINE))
    assert listed | errors == set(haptic_fieldbus.__all__)


def test_every_make_target_in_the_documents_exists() -> None:
    targets = set(re.findall(r"^([a-z-]+):", MAKEFILE, re.MULTILINE))
    for document, command in shown_commands():
        if command.startswith("make "):
            assert command.split()[1] in targets, f"{document.name}: {command}"


@every("document", DOCUMENTS, ids=lambda path: str(path.relative_to(PROJECT)))
def test_every_link_between_documents_leads_somewhere(document: Path) -> None:
    for link, anchor in re.findall(r"\]\(([^)#\s]*)#?([^)\s]*)\)", document.read_text()):
        if not link.startswith(("http://", "https://")):
            leads_to = document.parent / link if link else document
            assert leads_to.exists(), link
            assert not anchor or leads_to.suffix != ".md" or anchor in anchors_of(leads_to), f"{link}#{anchor}"


@cache
def anchors_of(document: Path) -> set[str]:
    """The anchors of a document: of its headings, as GitHub makes them, and those written as `<a id="…">`."""
    text = re.sub(r"^```.*?^```", "", document.read_text(), flags=re.MULTILINE | re.DOTALL)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    plain = [re.sub(r"\]\([^)]*\)", "]", each).strip().lower() for each in headings]
    made = [re.sub(r"[^\w\- ]", "", each).replace(" ", "-") for each in plain]
    again = {f"{each}-{number}" for each in made for number in range(1, made.count(each))}
    return {*made, *again, *re.findall(r'<a id="([^"]+)"', text)}


@every("document", CURRENT, ids=lambda path: str(path.relative_to(PROJECT)))
def test_every_module_and_file_of_the_package_that_a_document_names_is_there(document: Path) -> None:
    text = document.read_text()
    for name in set(re.findall(r"\bhaptic_fieldbus(?:\.\w+)+", text)) - ENTRY_POINT_GROUPS:
        pkgutil.resolve_name(name)
    for name in re.findall(r"\bhaptic_fieldbus/[\w/.]*", text):
        if not PLACEHOLDER.search(name):
            assert (PROJECT / name).exists(), name


def test_every_decision_is_in_the_list() -> None:
    folder = PROJECT / "docs" / "explanation" / "decisions"
    listed = set(re.findall(r"\]\((\d{4}-[^)]+)\)", (folder / "README.md").read_text()))
    assert listed == {path.name for path in folder.glob("[0-9]*.md")}


def test_github_and_ci_run_what_a_person_runs() -> None:
    script = PROJECT / ".ci" / "run"
    assert os.access(script, os.X_OK)
    assert {"step make check", "step make test"} <= set(script.read_text().splitlines())
    assert "run: .ci/run" in (PROJECT / ".github" / "workflows" / "ci.yml").read_text()


CI_MAKE = """#!/bin/sh
echo "make $* | $(pwd -P) | $(env | grep ^HAPTIC_) | $(ls)" >> "$STEPS"
mkdir -p .venv/bin build
printf '#!/bin/sh\\necho summary "$@"\\n' > .venv/bin/python
chmod +x .venv/bin/python
echo "$*" > build/last.xml
"""


@pytest.mark.parametrize("given", [True, False])
def test_ci_runs_in_a_clone_that_stands_alone(tmp_path: Path, given: bool) -> None:
    """The programs that it starts tell where they are: vendors' files are named to their lane alone."""
    checkout, programs, files, steps = (tmp_path / name for name in ("checkout", "bin", "files", "steps"))
    for folder in (checkout / ".ci", programs, files):
        folder.mkdir(parents=True)
    shutil.copy(PROJECT / ".ci" / "run", checkout / ".ci")
    (programs / "make").write_text(CI_MAKE)
    (programs / "make").chmod(0o755)
    for words in ("init -q", "add .ci", "-c user.name=n -c user.email=e commit -q -m first"):
        subprocess.run(["git", *words.split()], cwd=checkout, check=True)
    (checkout / "not_committed").touch()
    own = {name: value for name, value in os.environ.items() if not name.startswith(("GIT_", "HAPTIC_"))}
    own |= {"PATH": f"{programs}:{own['PATH']}", "STEPS": str(steps), "HAPTIC_FIELDBUS_PROFILES": "/elsewhere"}
    own |= {"HAPTIC_FIELDBUS_VENDOR_FILES": str(files)} if given else {}
    done = subprocess.run([checkout / ".ci" / "run"], env=own, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "not committed, so not tested: ?? not_committed" in done.stdout
    reports = ["build/tests.xml", "build/part.xml", *["build/vendor.xml"] * given]
    assert done.stdout.splitlines()[-1] == f"summary -m tests.ci_summary build/ci/times.txt {' '.join(reports)}"
    told = [line.split(" | ") for line in steps.read_text().splitlines()]
    always = ["setup", "check", "test", "test-part", "bench"]
    assert [line[0].split()[1] for line in told] == [*always, *["test-vendor"] * given]
    assert {line[1] for line in told}.isdisjoint([str(checkout)])
    assert [line[2] for line in told[:5]] == [""] * 5
    assert [line[2] for line in told[5:]] == [f"HAPTIC_FIELDBUS_VENDOR_FILES={files}"] * given
    assert not Path(told[0][1]).exists()
    assert (checkout / "build" / "last.xml").exists()


def test_no_test_looks_for_files_outside_of_the_checkout() -> None:
    """Vendors' files stand where an environment variable says, and are read in a lane of their own."""
    beside = re.compile(r"\b(?:CHECKOUT|PROJECT|ROOT)\.parent\b|parents\[\d+\]\.parent|(?:Path|open)\(f?[\"']\.\./")
    for path in (PROJECT / "tests").rglob("*.py"):
        name, text = path.relative_to(PROJECT), path.read_text(encoding="utf-8")
        assert not beside.findall(text), name
        assert all(int(count) < len(name.parts) for count in re.findall(r"__file__\).*\.parents\[(\d+)\]", text)), name


def test_make_makes_the_environment_before_it_uses_it() -> None:
    for target in ("test", "test-all", "test-part", "test-vendor", "check", "docs", "format"):
        assert re.search(rf"^{target}: setup$", MAKEFILE, re.MULTILINE)


@pytest.mark.parametrize(("version", "stays"), [(sys.version, True), ("3.2.1 (of long ago)", False)])
def test_an_environment_of_another_python_than_the_one_asked_for_is_made_anew(
    tmp_path: Path, version: str, stays: bool
) -> None:
    environment = tmp_path / ".venv"
    python = environment / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f"#!/bin/sh\necho '{version}'\n")
    python.chmod(0o755)
    outside = {
        name: value for name, value in os.environ.items() if name not in ("PYTHON", "MAKEFLAGS", "MAKEOVERRIDES")
    }
    for asked, left in (("NOTHING=", True), ("PYTHON=/nowhere/python", True), (f"PYTHON={sys.executable}", stays)):
        command = ["make", "--dry-run", "-f", str(PROJECT / "Makefile"), "setup", asked]
        subprocess.run(command, cwd=tmp_path, env=outside, check=False, capture_output=True)
        assert environment.exists() is left


def test_nobody_is_told_to_install_a_release_while_there_is_none() -> None:
    """From a checkout: `pip install .`, or `pip install ".[plot]"`."""
    for path in [*DOCUMENTS, *PACKAGE.rglob("*.py")]:
        for told in re.findall(r"pip install ([^\n`]*)", path.read_text(encoding="utf-8")):
            assert not re.search(r"haptic[-_]fieldbus", told), path


def test_before_a_commit_the_hooks_run_what_make_check_runs() -> None:
    """With the programs of the environment that `make` makes, and nothing that is fetched."""
    text = (PROJECT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    hooks = re.findall(r"^ +entry: \.venv/bin/(.+)$", text, re.MULTILINE)
    assert re.findall(r"repo: (.+)", text) == ["local"]
    assert re.findall(r"language: (.+)", text) == ["system"] * len(hooks)
    checks = re.search(r"^check:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert checks is not None
    assert set(hooks) == set(re.findall(r"\$\(BIN\)/(.+)", checks[1]))


def test_the_demo_waits_for_no_test_tools() -> None:
    assert re.search(r"^demo: \$\(DEMO_STAMP\)$", MAKEFILE, re.MULTILINE)
    (recipe,) = re.findall(r"^\$\(DEMO_STAMP\): pyproject.toml\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert "install,plot$(,)multicast)" in recipe
    assert "dev" not in recipe


def test_the_installed_version_is_the_one_that_is_written_down() -> None:
    assert version("haptic-fieldbus") == SETTINGS["project"]["version"]


def test_the_change_log_tells_of_what_comes_next() -> None:
    headings = re.findall(r"^## \[(.+?)\]", (PROJECT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings[0] == "Unreleased"


def imported() -> set[str]:
    """Packages from elsewhere that any module of this one imports."""
    names: set[str] = set()
    for path in modules():
        for node in nodes_of(path):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.partition(".")[0])
    # pytest alone imports the plugin for it, and is there then.
    return names - set(sys.stdlib_module_names) - {"haptic_fieldbus", "pytest"}


@reads_the_source
def test_every_import_is_a_declared_dependency_and_the_other_way_round() -> None:
    project = SETTINGS["project"]
    required = [
        *project["dependencies"],
        *(
            each
            for extra in ("cluster", "data", "multicast", "plot", "view")
            for each in project["optional-dependencies"][extra]
        ),
    ]
    declared = {re.split(r"[\[<>=,;]", requirement)[0] for requirement in required} | PARTS_OF_NICEGUI
    assert {DISTRIBUTIONS.get(name, name.replace("_", "-")) for name in imported()} == declared


PARTS_OF_NICEGUI = {"fastapi", "starlette", "uvicorn"}
"""Packages that NiceGUI is made of; its version, of which one minor one is permitted, chooses theirs."""


def contract(words: str, key: str = "modules") -> list[str]:
    """The modules of the import contract whose name has these words."""
    contracts = SETTINGS["tool"]["importlinter"]["contracts"]
    modules: list[str] = next(each for each in contracts if words in each["name"])[key]
    return modules


def test_all_of_the_simulation_is_pure_but_what_opens_a_bus_and_the_world_behind_it() -> None:
    sim = "haptic_fieldbus.sim"
    pure = {module for module in contract("pure half", "source_modules") if module.startswith(sim)}
    with_a_bus = {f"{sim}.canopen.{name}" for name in ("bus", "hosting", "site", "world")}
    with_a_bus |= {f"{sim}.modbus.{name}" for name in ("hosting", "line", "station")}
    rooms = modules_in("sim") - {f"{sim}.canopen", f"{sim}.modbus", f"{sim}.simulation"}
    everything = rooms | modules_in("sim/canopen") | modules_in("sim/modbus")
    assert everything == pure | with_a_bus, "list the module in the import contract"


ON_BOTH_SIDES = {"NmtState", "Node", "Pdo", "Plant", "Wire"}
"""Of the wire: the master's and the simulation's (docs/explanation/decisions/0018)."""


@reads_the_source
def test_a_class_name_occurs_once_but_for_what_stands_on_both_sides_of_the_wire() -> None:
    places: dict[str, list[bool]] = {}
    for path in modules():
        for node in nodes_of(path):
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(path.is_relative_to(PACKAGE / "sim"))
    twice = {name for name, found in places.items() if len(found) > 1}
    assert twice == ON_BOTH_SIDES
    assert all(sorted(places[name]) == [False, True] for name in twice), "one of them in the simulation"


@reads_the_source
def test_a_module_defines_each_name_once() -> None:
    """A second definition takes the place of the first one, also in the code above it."""
    for path in modules():
        body = tree_of(path).body
        names = [each.name for each in body if isinstance(each, ast.FunctionDef | ast.ClassDef)]
        targets = [target for each in body if isinstance(each, ast.Assign) for target in each.targets]
        targets += [each.target for each in body if isinstance(each, ast.AnnAssign)]
        names += [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
        assert len(names) == len({*names}), f"{path}: {sorted({name for name in names if names.count(name) > 1})}"


def modules_in(folder: str) -> set[str]:
    """The modules and folders of a folder of the package, by their full names."""
    prefix = f"haptic_fieldbus.{folder.replace('/', '.')}"
    return {f"{prefix}.{path.stem}" for path in (PACKAGE / folder).iterdir() if not path.stem.startswith("__")}


# Public functions of one name in several modules: the same question, answered for what their module is about.
SAME_QUESTION = {
    "acknowledge": "the fault of a drive that lost its master cleared, by its protocol",
    "adapter_checks": "what the system tells of an adapter, by its protocol",
    "bind": "a fresh step, its parameters bound",
    "certify": "the command and the API behind it",
    "check_profile": "faults of a profile beyond its schema, by its protocol",
    "discrete": "the linear system that a step is",
    "draw": "a picture of what a page or a command shows",
    "dynamics": "(A, B) of bodies",
    "environment": "what a sampled loop is closed over, of one axis or several",
    "free_puck": "the lecture's free puck",
    "growth": "spectral radius but for shifts, of one axis or several",
    "host": "drives hosted on a bus that other programs join, by its protocol",
    "identify": "the command and the API behind it",
    "in_place_of": "a bus that is named in the place of one of a rig, by its protocol",
    "listen": "a bus heard before anything is sent, by its protocol",
    "loop_matrix": "one period of a loop, of one axis or several",
    "main": "a program",
    "measure": "the points of a work-precision set",
    "opened": "a bus open for a block, by its protocol",
    "parse_bus": "a bus name taken apart, by its protocol",
    "plan": "the command and the API behind it",
    "response": "the command and the API behind it",
    "round_trip_checks": "the way to a node and back judged, by its protocol",
    "run": "the command, the API behind it, and a batch of loops",
    "sample": "a device under the delayed hold",
    "stability": "the command and the API behind it",
    "sweep": "the command and the API behind it",
    "translate": "the errors of a library or the system as ours, by its protocol",
    "twin": "the command and the API behind it",
}


@reads_the_source
def test_a_function_name_occurs_once_but_for_the_same_question() -> None:
    where: dict[str, set[str]] = {}
    for path in modules():
        for node in tree_of(path).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                where.setdefault(node.name, set()).add(str(path))
    assert {name for name, paths in where.items() if len(paths) > 1} == set(SAME_QUESTION)


@reads_the_source
def test_every_module_fits_on_a_few_screens_and_says_what_it_is() -> None:
    lines = {str(path.relative_to(PROJECT)): len(path.read_text().splitlines()) for path in modules()}
    assert {name: count for name, count in lines.items() if count > LONGEST_FILE} == {}
    silent = [str(path) for path in modules() if not ast.get_docstring(tree_of(path))]
    assert silent == [], "a module begins with one sentence about itself"
