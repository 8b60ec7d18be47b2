"""Section on stiff and extreme cases; a case that raises an error counts as failed, and the others go on."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from time import perf_counter

from haptic_fieldbus.numerals import percent
from haptic_fieldbus.study.case import Case, CaseResult
from haptic_fieldbus.study.cases import CASES
from haptic_fieldbus.study.page import margins
from haptic_fieldbus.study.page.context import Context
from haptic_fieldbus.study.page.html import Card, Cell, Section, paragraph, picture, table
from haptic_fieldbus.study.page.style import svg

EXPLAINED = """Cases that break naive code, each judged by something that is not this program: a closed form, extended
precision, or brute force. <i>Expected</i> is what theory says, <i>measured</i> what the code does."""


def run_case(case: Case, quick: bool) -> tuple[CaseResult, float]:
    """Return the result of a case and the time it took [s]; an exception in the case is reported as its failure."""
    begun = perf_counter()
    try:
        result = case(quick)
        result = replace(result, passed=bool(result.passed))  # a numpy truth is not JSON's
    except Exception as error:  # a case may break in any way; the report goes on and shows it
        result = CaseResult("a result", f"{type(error).__name__}: {error}", False, "none", "")
    return result, perf_counter() - begun


def stability_section(context: Context) -> Section:
    """Run the chosen cases and return their section."""
    chosen = {name: case for name, case in CASES.items() if context.is_chosen(name)}
    found = {}
    for name, case in context.with_progress(chosen.items(), lambda item: f"case {item[0]}"):
        found[name] = run_case(case, context.quick)
        context.add("stability_cases", {"name": name, **asdict(found[name][0])})
    results = {name: result for name, (result, _) in found.items()}
    document = svg(margins.draw(CASES, results))
    return Section(
        "stability",
        "Stiff and extreme cases",
        paragraph(EXPLAINED) + _table(found),
        (_finding(results),),
        {"margins": document},
        card=Card("Is it stable on stiff and extreme cases?", picture("margins", document, margins.TOLD)),
    )


def _finding(results: Mapping[str, CaseResult]) -> str:
    """Return how many cases behave as theory says, which failed, and which come closest to it."""
    failed = [f"<code>{name}</code>" for name, result in results.items() if not result.passed]
    told = f"; failed: {', '.join(failed)}" if failed else ""
    close = [name for name in margins.closest(results) if results[name].passed][:1]
    near = "".join(f"; the closest, <code>{name}</code>, uses {percent(results[name].used or 0.0)} of what is permitted"
                   for name in close)  # fmt: skip
    return f"{len(results) - len(failed)} of {len(results)} stiff and extreme cases behave as theory says{told}{near}."


def _table(results: Mapping[str, tuple[CaseResult, float]]) -> str:
    rows: list[list[str | Cell]] = [
        [
            name,
            Cell("✓ passed", "good") if result.passed else Cell("✗ failed", "bad"),
            result.expected,
            result.measured,
            f"{result.oracle}; within: {result.tolerance}" if result.tolerance else result.oracle,
            "–" if result.used is None else percent(result.used),
            f"{seconds:.2f}",
        ]
        for name, (result, seconds) in results.items()
    ]
    return table(
        ("case", "verdict", "expected", "measured", "judged by", "used of it", "time [s]"), rows, text_columns=5
    )
