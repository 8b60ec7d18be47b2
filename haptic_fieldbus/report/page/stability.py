"""The section on stiff and extreme cases: each runs by itself, and one that breaks is a case that failed."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec
from time import perf_counter

from haptic_fieldbus.report.case import CaseResult
from haptic_fieldbus.report.page.context import Context
from haptic_fieldbus.report.page.html import Cell, Section, paragraph, picture, table

MODULE = "haptic_fieldbus.report.cases"
Case = Callable[[bool], CaseResult]

EXPLAINED = """Cases that break naive code, each judged by something that is not this program: a closed form, extended
precision, or brute force. <i>Expected</i> is what theory says, <i>measured</i> what the code does."""


def known_cases() -> Mapping[str, Case]:
    """By name; none where the cases are not part of the installation."""
    if find_spec(MODULE) is None:
        return {}
    cases: Mapping[str, Case] = import_module(MODULE).CASES
    return cases


def run_case(name: str, case: Case, quick: bool) -> tuple[CaseResult, float]:
    """The result and the seconds it took; whatever goes wrong inside is a failure of the case, and told."""
    begun = perf_counter()
    try:
        result = case(quick)
        result = replace(result, name=name, passed=bool(result.passed))  # a numpy truth is not JSON's
    except Exception as error:  # a case may break in any way; the report goes on and shows it
        result = CaseResult(name, "a result", f"{type(error).__name__}: {error}", False, "none")
    return result, perf_counter() - begun


def stability_section(context: Context) -> Section:
    """All cases that are wanted."""
    chosen = {name: case for name, case in known_cases().items() if context.wanted(name)}
    found = []
    for place, (name, case) in enumerate(chosen.items()):
        context.progress(f"case {name}", place / len(chosen))
        found.append(run_case(name, case, context.quick))
    for result, _ in found:
        context.add(
            "stability_cases",
            {"name": result.name, "expected": result.expected, "measured": result.measured, "passed": result.passed,
             "oracle": result.oracle, "tolerance": result.tolerance},
        )  # fmt: skip
    figures = {f"case-{result.name}": result.figure for result, _ in found if result.figure}
    pictures = "".join(picture(name, document, name.removeprefix("case-")) for name, document in figures.items())
    text = paragraph(EXPLAINED) + _table(found) if found else paragraph("No cases are part of this installation.")
    return Section("stability", "Stiff and extreme cases", text + pictures, _findings(found), figures)


def _table(found: list[tuple[CaseResult, float]]) -> str:
    rows: list[list[str | Cell]] = [
        [
            result.name,
            Cell("✓ passed", "good") if result.passed else Cell("✗ failed", "bad"),
            result.expected,
            result.measured,
            f"{result.oracle}; within: {result.tolerance}" if result.tolerance else result.oracle,
            f"{seconds:.2f}",
        ]
        for result, seconds in found
    ]
    return table(("case", "verdict", "expected", "measured", "judged by", "time [s]"), rows, text_columns=5)


def _findings(found: list[tuple[CaseResult, float]]) -> tuple[str, ...]:
    if not found:
        return ()
    failed = [f"<code>{result.name}</code>" for result, _ in found if not result.passed]
    told = f"; failed: {', '.join(failed)}" if failed else ""
    return (f"{len(found) - len(failed)} of {len(found)} stiff and extreme cases behave as theory says{told}.",)
