"""The report: sections are measured one after another and written as one page, figures and JSON.

A section is one entry of SECTIONS. What it finds goes to three places: the page, `report.json` (rows under stable keys)
and `details.json` (everything else).
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from time import perf_counter

from haptic_fieldbus.errors import UsageError
from haptic_fieldbus.report.measure.bench import Tools, bench_of
from haptic_fieldbus.report.measure.contact_loop import contacts
from haptic_fieldbus.report.measure.host import host
from haptic_fieldbus.report.measure.problems import problems
from haptic_fieldbus.report.page.context import Context, Progress
from haptic_fieldbus.report.page.html import Section, page
from haptic_fieldbus.report.page.made_on import made_on_section
from haptic_fieldbus.report.page.stability import known_cases

SECTIONS = {
    "work-precision": "work_precision",
    "growth": "growth",
    "sources": "sources",
    "integrator": "integrator",
    "impedance": "impedance",
    "region": "region",
    "stability": "stability",
    "cost": "cost",
}
"""Name → module of `report.page`, with a function NAME_section."""
KEYS = ("work_precision", "stability_cases", "optional_parts")
"""Of `report.json`, beside `host`."""
TITLE = "Error against run time"
LEAD = """How exact the virtual forces of haptic-fieldbus are, what they cost to compute, how their error grows along a
run, and where the sampled loop is stable. SI units; lengths in metres, forces in newtons, unless a column says
otherwise."""


@dataclass(frozen=True)
class Chosen:
    """Sections to make, and the problems or cases in them; None: all."""

    sections: tuple[str, ...]
    names: frozenset[str] | None = None


def choose(only: str | None) -> Chosen:
    """A section, a problem or a case by its name; raises UsageError for another."""
    if only is None:
        return Chosen(tuple(SECTIONS))
    if only in SECTIONS:
        return Chosen((only,))
    inside = {"work-precision": [*problems(), *contacts()], "stability": list(known_cases())}
    for section, names in inside.items():
        if only in names:
            return Chosen((section,), frozenset((only,)))
    from haptic_fieldbus.documents import nearest

    every = [*SECTIONS, *inside["work-precision"], *inside["stability"]]
    near = nearest(only, every)
    hint = f"nearest: {near[0]}; " if near else ""
    raise UsageError(
        f"--only {only}: there is none of that name; {hint}sections are: {', '.join(SECTIONS)}; problems and cases go "
        "by their names too"
    )


def make_report(
    out: Path,
    tools: Tools,
    *,
    quick: bool = False,
    only: str | None = None,
    progress: Progress | None = None,
    command: str = "haptic-fieldbus report",
) -> dict[str, object]:
    """Measure, and write `index.html`, `report.json`, `details.json` and `figures/` into `out`; returns report.json.

    Raises UsageError for a name that is not known and a folder that cannot be written.
    """
    begun = perf_counter()
    chosen = choose(only)
    _make_folder(out)
    context = Context(tools, bench_of(tools.plan("wall")), quick, chosen.names)
    sections = [_section(context, name, place, len(chosen.sections), progress)
                for place, name in enumerate(chosen.sections)]  # fmt: skip
    machine = host()
    found: dict[str, object] = {**{key: context.rows.get(key, []) for key in KEYS}, "host": machine}
    if progress is not None:
        progress("done", 1.0)
    last = made_on_section(machine, command, perf_counter() - begun)
    _write(out, [*sections, last], found)
    return found


def _section(context: Context, name: str, place: int, total: int, progress: Progress | None) -> Section:
    """One section; its progress is a part of the whole."""
    if progress is not None:
        tell = progress
        tell(name, place / total)
        context = replace(context, progress=lambda label, share: tell(label, (place + share) / total))
    module = SECTIONS[name]
    make: Callable[[Context], Section] = getattr(
        import_module(f"haptic_fieldbus.report.page.{module}"), f"{module}_section"
    )
    return make(context)


def _make_folder(out: Path) -> None:
    """Before anything is measured, for a report takes minutes."""
    try:
        (out / "figures").mkdir(parents=True, exist_ok=True)
        probe = out / "report.json"
        existed = probe.exists()
        probe.open("ab").close()
        if not existed:
            probe.unlink()
    except OSError as error:
        raise UsageError(f'--out "{out}": {error.strerror}') from error


def _write(out: Path, sections: list[Section], found: Mapping[str, object]) -> None:
    for section in sections:
        for name, document in section.figures.items():
            (out / "figures" / f"{name}.svg").write_text(document, encoding="utf-8")
    details = {section.name: section.details for section in sections if section.details is not None}
    _write_json(out / "report.json", found)
    _write_json(out / "details.json", details)
    (out / "index.html").write_text(page(TITLE, LEAD, sections), encoding="utf-8")


def _write_json(path: Path, value: object) -> None:
    path.write_text(json.dumps(finite(value), ensure_ascii=False, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def finite(value: object) -> object:
    """The same with None where a number is infinite or not a number, and lists for tuples."""
    if isinstance(value, Mapping):
        return {str(key): finite(member) for key, member in value.items()}
    if isinstance(value, list | tuple):
        return [finite(member) for member in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
