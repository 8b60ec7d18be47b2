"""No module imports itself, and a function imports one of the package only where something does without."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp
import pytest

from haptic_fieldbus.scenes.registry import ELEMENTS
from tests.source import nodes_of, reads_the_source

PACKAGE = Path(__file__).resolve().parents[1] / "haptic_fieldbus"
MODULE = re.compile(r"haptic_fieldbus(?:\.\w+)+")


def imports() -> dict[str, set[str]]:
    """Imports of each module: at its top, in a function, or for its types alone."""
    graph = grimp.build_graph("haptic_fieldbus", exclude_type_checking_imports=False, cache_dir=None)
    return {module: set(graph.find_modules_directly_imported_by(module)) for module in graph.modules}


def loaded_by_name(modules: set[str]) -> Iterator[tuple[str, str]]:
    """Modules that load others by their names in a table, such as `scenes.registry`, and the modules loaded."""
    for path in PACKAGE.rglob("*.py"):
        text = path.read_text()
        if "import_module(" not in text:
            continue
        own = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for node in nodes_of(path):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                name = node.value.partition(":")[0]
                if MODULE.fullmatch(name) and name in modules:
                    yield own, name


@reads_the_source
def test_no_module_imports_itself_by_any_way_round() -> None:
    found = imports()
    for module, name in loaded_by_name(set(found)):
        found[module].add(name)
    try:
        TopologicalSorter(found).prepare()
    except CycleError as cycle:
        pytest.fail(" → ".join(reversed(cycle.args[1])))


DOES_WITHOUT = {
    "import haptic_fieldbus.cli": {
        "cli": "cli.app cli.failures errors",
        "cli.identify": "api.certification api.identification api.provenance identification planning.request"
        " report.analysis_plots report.plot",
        "cli.options": "documents.quantities planning.request protocols.registry report.drawing signals",
        "cli.bench": "api.bench clock running.watch",
        "cli.planning": "api.estimation report.analysis_texts report.analysis_plots planning.explain"
        " api.model api.open_loop api.provenance api.stability_limits planning.selection",
        "cli.profiles": "eds protocols.canopen.from_eds protocols.catalogue sim.canopen.simulated_eds documents"
        " protocols.canopen.profile sim.canopen.eds_proof",
        "cli.rehearse": "api api.bench api.rehearsal",
        "api.rehearsal": "sim.canopen.bus",
        "cli.recordings": "api.provenance api.replaying api.twin recordings.reading report.plot",
        "cli.report": "api api.provenance protocols.catalogue study.make_report study.measure.bench",
        "cli.run": "api api.provenance assessing.loop_report planning.refusal planning.request planning.selection"
        " recordings.reading report.plot report.texts scenes.catalogue sim.faults sim.faults.drawing",
        "cli.scenes": "api planning.explain protocols.catalogue protocols.registry scenes.catalogue scenes.registry"
        " scenes.scene",
        "cli.sweep": "api api.provenance api.sweep_folder api.sweeping planning.request planning.selection",
        "cli.view": "running.live view.description view.server",
        "cli.simulate": "drive.rig_units protocols.catalogue running.rights sim.host_request sim.faults",
        "cli.vcan": "vcan.runner",
        "running.ending": "assessing.result planning.request",
    },
    "import haptic_fieldbus.pytest_plugin": {
        "pytest_plugin": "errors sim.modbus.drives testing testing.modbus",
    },
    "import haptic_fieldbus as h; from haptic_fieldbus.cycle.cycle import Cycle; Cycle(h.plan('wall'))": {
        "api": "api.provenance api.site recordings.reading running.changes running.session",
        "assessing.result": "recordings.tables",
        "api.stability_limits": "numerics.estimators",
        "api.open_loop": "documents.samples numerics.estimators numerics.integrators numerics.integrators.method",
        "cycle.axis": "cycle.tachometer",
        "cycle.laws": "numerics.estimators numerics.integrators",
        "documents.document": "documents.positions",
        "margins.closed_loop": "margins.bodies",
        "margins.group": "margins.coupled numerics.estimators",
        "margins.passivity": "numerics.estimators",
        "margins.resting_points": "margins.own_laws",
        "numerics.coupled": "numerics.estimators",
        "numerics.sampled": "numerics.estimators numerics.integrators",
        "planning.compile": "numerics.estimators",
        "planning.plan": "planning.coupled_plan",
        "planning.limits": "margins.bodies",
        "planning.selection": "numerics.estimators numerics.integrators scenes.parameter_changes",
        "protocols.canopen.protocol": "eds protocols.canopen.from_eds",
        "scenes.element_checks": "numerics.integrators",
        "scenes.files": "scenes.own",
        "scenes.registry": "scenes.own",
    },
    "import haptic_fieldbus as h; from haptic_fieldbus.cycle.cycle import Cycle; "
    "Cycle(h.plan('wall', drive='example_velocity_only'))": {
        "cycle.axis": "cycle.standstill",
    },
    "import haptic_fieldbus as h; h.run('wall', duration=0.05)": {
        "api.provenance": "numerics.estimators numerics.integrators running.changes",
        "running.rows": "recordings.mcap",
        "api": "sim.faults.drawing running.leading sim.mechanics.pointer",
        "api.session": "running.rights",
        "api.site": "sim.faults.drawing",
        "assessing.summary": "assessing.coupling_error",
        "assessing.element_forces": "assessing.virtual_states",
        "running.session": "assessing.looking_back running.proofs running.rights",
        "sim.drive.settings": "sim.mechanics.loaded_plant",
    },
}
"""Commands and runs without some modules: the functions' imports, by who imports them, that keep them out of it."""


def imported_in_functions() -> dict[str, set[str]]:
    """The modules of the package that functions import, by the module of the function; names as in `DOES_WITHOUT`."""
    found: dict[str, set[str]] = {}
    for path in PACKAGE.rglob("*.py"):
        own = ".".join(path.relative_to(PACKAGE).with_suffix("").parts).removesuffix(".__init__")
        functions = [node for node in nodes_of(path) if isinstance(node, ast.FunctionDef)]
        for node in (inner for function in functions for inner in ast.walk(function)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PACKAGE.name):
                home = PACKAGE.joinpath(*(node.module or "").split(".")[1:])
                for name in node.names:
                    is_module = (home / name.name).exists() or (home / f"{name.name}.py").exists()
                    full = f"{node.module}.{name.name}" if is_module else node.module or ""
                    found.setdefault(own, set()).add(full.removeprefix(f"{PACKAGE.name}."))
    return found


@reads_the_source
def test_a_function_imports_only_what_something_does_without() -> None:
    listed: dict[str, set[str]] = {}
    for importers in DOES_WITHOUT.values():
        for importer, names in importers.items():
            listed.setdefault(importer, set()).update(names.split())
    assert imported_in_functions() == listed


@pytest.mark.parametrize("program", DOES_WITHOUT)
def test_what_a_function_imports_is_not_there_where_it_is_not_needed(program: str) -> None:
    code = f"{program}\nimport sys\nprint(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    needless = {f"{PACKAGE.name}.{name}" for names in DOES_WITHOUT[program].values() for name in names.split()}
    assert needless & set(loaded) == set()


def test_a_simulated_modbus_line_needs_no_server() -> None:
    code = (
        "import sys; import haptic_fieldbus; haptic_fieldbus.run('wall', bus='sim-modbus-tcp', duration=0.05);"
        " print(*sys.modules)"
    )
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"pymodbus.server", "aiohttp", "haptic_fieldbus.sim.modbus.hosting"} & {*loaded}


PUBLIC = {"", "clock", "errors", "numerics.linear", "scenes.element", "sim.faults"}
"""Names that docs/reference promises or documents beside the elements; "" is the package itself."""
FENCED = {
    "study": (
        "api.site assessing cycle margins numerals numerics.batch numerics.estimators numerics.estimators.tachometer"
        " numerics.integrators numerics.integrators.method numerics.sampled planning.compile report.drawing"
        " running.loop sim.hand sim.mechanics",
        "cli.report",
    ),
    "vcan": ("", "cli.vcan"),
    "view": (
        "cycle.laws margins.group numerals planning.axis_plan planning.explain planning.live_changes planning.plan"
        " recordings.tables report.texts running.ring scenes.registry scenes.scene signals",
        "cli.view",
    ),
}
"""Rooms that stand beside the product: which modules each may import beside the public ones, and what imports it."""
MOST_MODULES = 16


@reads_the_source
def test_a_fenced_room_imports_public_names_and_few_modules_and_its_command_alone_imports_it() -> None:
    found = imports()
    public = PUBLIC | {module.removeprefix(f"{PACKAGE.name}.") for module, _ in ELEMENTS.values()}
    for room, (listed, command) in FENCED.items():
        inside = {module for module in found if f"{module}.".startswith(f"{PACKAGE.name}.{room}.")}
        used = {other.removeprefix(PACKAGE.name).removeprefix(".") for each in inside for other in found[each] - inside}
        assert used - public == set(listed.split())
        assert len(listed.split()) <= MOST_MODULES
        assert {each for each in found if found[each] & inside} - inside == {f"{PACKAGE.name}.{command}"}
