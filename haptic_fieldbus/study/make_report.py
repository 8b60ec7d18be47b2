"""Report: sections are measured one after another and written as one page, figures and JSON.

A section is one entry of SECTIONS. Its findings go to three places: the page, `report.json` (rows under stable keys)
and `details.json` (everything else).
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from difflib import get_close_matches
from html import escape
from pathlib import Path
from time import perf_counter

from haptic_fieldbus import Plan, UsageError
from haptic_fieldbus.margins import HAND
from haptic_fieldbus.numerals import exactly, in_unit, percent, rounded
from haptic_fieldbus.report.drawing import FELT, with_description
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.measure.bench import Bench, Tools, bench_of
from haptic_fieldbus.study.measure.loops import contacts
from haptic_fieldbus.study.measure.problems import problems
from haptic_fieldbus.study.measure.timing import MachineNoise, host_facts, load_average
from haptic_fieldbus.study.page.cost import buses_section, cost_section
from haptic_fieldbus.study.page.html import Context, Progress, Section, page, paragraph, plain_text, table
from haptic_fieldbus.study.page.sources import impedance_section, integrator_section, sources_section
from haptic_fieldbus.study.page.stability import passivity_section, region_section, stability_section
from haptic_fieldbus.study.page.work_precision import growth_section, work_precision_section

# What the report takes for granted: the bench, what its drive's data leave open, the hand, and the machine.


def assumed(plan: Plan, bench: Bench, machine: Mapping[str, str]) -> str:
    """Return the assumptions as a sentence each, as HTML."""
    plant = bench.plant
    known = (
        f"{rounded(plant.mass)} kg, {rounded(plant.damping)} N·s/m, {rounded(plant.coulomb)} N of dry friction, counts "
        f"of {in_unit(plant.resolution, 'm')}"
    )
    open_ = "; ".join(plan.assumed) or "nothing"
    drive = escape(plan.axes[0].profile.title)
    return (
        f"<strong>Assumptions.</strong> No hardware: {drive}, simulated at {exactly(plan.rate)} Hz in virtual time; "
        f"the handle has {known}; torque acts {rounded(1e3 * bench.delay)} ms after its sample and lags by "
        f"{rounded(1e3 * plant.torque_lag)} ms. Values of the drive without a source: {escape(open_)}. The hand is "
        f"{exactly(HAND.mass)} kg on {exactly(HAND.damping)} N·s/m and {exactly(HAND.stiffness)} N/m, and notices a "
        f"change of force from {percent(FELT)} (Pang, Tan and Durlach 1991). Costs are for "
        f"{escape(machine['python'])} on this machine ({escape(machine['processor'])}); errors and stability do not "
        "depend on the machine."
    )


# The page has the sections in this order: error first, stability next, cost last.
SECTIONS: dict[str, Callable[[Context], Section]] = {
    "work-precision": work_precision_section,
    "growth": growth_section,
    "sources": sources_section,
    "buses": buses_section,
    "integrator": integrator_section,
    "impedance": impedance_section,
    "region": region_section,
    "passivity": passivity_section,
    "stability": stability_section,
    "cost": cost_section,
}
KEYS = ("work_precision", "stability_cases", "optional_parts")
"""Keys of rows in `report.json`; `host`, `findings` and `warnings` are there too."""
TITLE = "Error against run time"
INTRODUCTION = """Accuracy and cost of the virtual forces of haptic-fieldbus: growth of the error in a run,
stability of the sampled loop, and the parts that a scene omits."""

HOW = """Times are those of this machine; errors, limits and stability do not depend on it. <code>report.json</code> and
<code>details.json</code> contain every number on this page, <code>figures/</code> every figure."""


@dataclass(frozen=True)
class Report:
    """Files of a report: `content` is report.json; findings and warnings are sentences without markup."""

    content: dict[str, object]
    findings: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class ChosenSections:
    """Sections to make, and the names of problems or cases in them; None for all."""

    sections: tuple[str, ...]
    names: frozenset[str] | None = None


def choose(only: str | None) -> ChosenSections:
    """Return the sections to make: all for None, or those for the name of a section, a problem or a case.

    Raises UsageError for an unknown name.
    """
    if only is None:
        return ChosenSections(tuple(SECTIONS))
    if only in SECTIONS:
        return ChosenSections((only,))
    inside = {"work-precision": [*problems(), *contacts()], "stability": list(CASES)}
    for section, names in inside.items():
        if only in names:
            return ChosenSections((section,), frozenset((only,)))
    known = [*SECTIONS, *inside["work-precision"], *inside["stability"]]
    near = get_close_matches(only.lower(), known, 1) or [name for name in sorted(known) if only.lower() in name]
    hint = f"nearest: {near[0]}; " if near else ""
    raise UsageError(
        f"--only {only}: unknown name; {hint}sections are: {', '.join(SECTIONS)}; names of problems and cases are "
        "valid too"
    )


def make_report(
    out: Path,
    tools: Tools,
    *,
    quick: bool = False,
    only: str | None = None,
    progress: Progress | None = None,
    command: str = "haptic-fieldbus report",
    mark: str = "",
) -> Report:
    """Measure, and write `index.html`, `report.json`, `details.json` and `figures/` into `out`.

    `progress` is called with a label and the share that is done; `command` is shown on the page, and `mark` tells in
    each figure what it was made from.

    Raises UsageError when `only` is unknown or the folder cannot be written, PlanError when the bench has no known mass
    and friction.
    """
    begun = perf_counter()
    chosen = choose(only)
    _make_folder(out)
    tell = progress or (lambda label, share: None)
    load, wall = load_average(), tools.plan("wall")
    context = Context(tools, bench_of(wall), quick, chosen.names)
    sections = []
    for place, name in enumerate(chosen.sections):
        part = _part_of(tell, place, len(chosen.sections))
        part(name, 0.0)
        sections.append(SECTIONS[name](replace(context, progress=part)))
    machine, warnings = host_facts(), tuple[str, ...]()
    if context.costs:
        quiet = MachineNoise.of(load, context.costs)
        machine, warnings = {**machine, "quiet": quiet.words()}, tuple(filter(None, [quiet.warning()]))
    findings = tuple(plain_text(finding) for section in sections for finding in section.findings)
    content: dict[str, object] = {key: context.rows.get(key, []) for key in KEYS}
    content |= {"host": machine, "findings": findings, "warnings": warnings}
    tell("done", 1.0)
    sections.append(_made_on(machine, command, perf_counter() - begun))
    text = page(TITLE, INTRODUCTION, sections, assumed(wall, context.bench, machine), escape(" ".join(warnings)))
    with _writing(out):
        _write(out, sections, content, text, mark)
    return Report(content, findings, warnings)


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """Turn an error of writing into the folder into a UsageError with the reason."""
    try:
        yield
    except OSError as error:
        raise UsageError(f'--out "{out}": {error.strerror}') from error


def _made_on(machine: dict[str, str], command: str, seconds: float) -> Section:
    """Return the section on hardware, versions, command and duration."""
    rows = [[key.replace("_", " "), value] for key, value in machine.items()]
    rows.append(["report made in", f"{seconds:.1f} s"])
    body = paragraph(HOW) + paragraph(f"Made by <code>{escape(command)}</code>.")
    return Section("host", "Made on", body + table(("what", "which"), rows, text_columns=2))


def _part_of(tell: Progress, place: int, total: int) -> Progress:
    """Return a function that reports the progress of one of `total` sections as progress of the whole."""
    return lambda label, share: tell(label, (place + share) / total)


def _make_folder(out: Path) -> None:
    """Make the folders and try to write into them, before anything is measured: a report takes minutes.

    Raises UsageError when the folder cannot be written.
    """
    with _writing(out):
        (out / "figures").mkdir(parents=True, exist_ok=True)
        probe = out / "report.json"
        existed = probe.exists()
        probe.open("ab").close()
        if not existed:
            probe.unlink()


def _write(out: Path, sections: list[Section], rows: Mapping[str, object], text: str, mark: str) -> None:
    """Write figures, both JSON files and the page."""
    for section in sections:
        for name, document in section.figures.items():
            (out / "figures" / f"{name}.svg").write_text(with_description(document, mark), encoding="utf-8")
    details = {section.name: section.details for section in sections if section.details is not None}
    _write_json(out / "report.json", rows)
    _write_json(out / "details.json", details)
    (out / "index.html").write_text(text, encoding="utf-8")


def _write_json(path: Path, value: object) -> None:
    text = json.dumps(json_ready(value), ensure_ascii=False, indent=1, allow_nan=False)
    path.write_text(f"{text}\n", encoding="utf-8")


def json_ready(value: object) -> object:
    """Return a copy with None in place of infinities and NaN, and with lists in place of tuples, as JSON has it."""
    if isinstance(value, Mapping):
        return {str(key): json_ready(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [json_ready(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
