"""All figures with a bound: each beside a reference of the same run, as a ratio with its spread.

`haptic-fieldbus bench`, or `make bench` in a checkout. Every round measures each figure once, ours and the reference
one right after the other, so that other programs disturb both. What is judged is the median ratio of all rounds.
"""

import argparse
import json
import signal
import sys
from contextlib import ExitStack
from statistics import median

import bus_limit
import drive_cost
import modbus_exchange
import period_cost
import plan_cost
import session_cost
import start_cost
import step_cost
import sweep_cost
import virtual_time
import wire_period
from rich.console import Console
from rich.progress import track
from rich.table import Table
from rows import PAGE, Figure, NotHereError, Pair, machine, put_on_page

from haptic_fieldbus.numerals import rounded

FIGURES: tuple[Figure, ...] = (
    *period_cost.FIGURES,
    *step_cost.FIGURES,
    *modbus_exchange.FIGURES,
    *wire_period.FIGURES,
    *bus_limit.FIGURES,
    *virtual_time.FIGURES,
    *session_cost.FIGURES,
    *sweep_cost.FIGURES,
    *drive_cost.FIGURES,
    *plan_cost.FIGURES,
    *start_cost.FIGURES,
)
ROUNDS, SHORT_ROUNDS = 15, 3
PATIENCE = 1.25
"""Factor on the bounds of the short form; what is above that after few rounds is measured again in many."""
HEAD = ("figure", "ours", "reference", "ratio", "spread", "at most")
Measured = tuple[Figure, list[tuple[float, float]]]


def measured(figures: list[Figure], rounds: int) -> list[Measured]:
    """Measure each figure once a round; return its pairs (ours, reference) [s]."""
    with ExitStack() as stack:
        pairs: list[tuple[Figure, Pair]] = []
        for figure in figures:
            try:
                pairs.append((figure, figure.pair(stack)))
            except NotHereError as error:
                print(f"not measured: {figure.name}: {error}", file=sys.stderr)
        found: list[Measured] = [(figure, []) for figure, _ in pairs]
        console = Console(stderr=True)
        for _ in track(range(rounds), "Measuring", console=console, transient=True, disable=not console.is_terminal):
            for (_, pair), (_, times) in zip(pairs, found, strict=True):
                times.append(pair())
    return found


def ratio(times: list[tuple[float, float]]) -> float:
    """Return the median ratio of all rounds."""
    return median(ours / reference for ours, reference in times)


def above(found: list[Measured], patience: float) -> list[Figure]:
    """Return the figures whose ratio is above so many times their bound."""
    return [figure for figure, times in found if ratio(times) > patience * figure.bound]


def cells(found: Measured) -> list[str]:
    """Return the cells of one line of the table."""
    figure, times = found
    ratios = [ours / reference for ours, reference in times]
    ours, reference = (median(each) for each in zip(*times, strict=True))
    spread = f"{min(ratios):.2f} to {max(ratios):.2f}"
    what = f"{figure.name}, beside {figure.reference}"
    return [what, of(ours), of(reference), f"{ratio(times):.2f}", spread, f"{figure.bound:.3g}"]


def of(seconds: float) -> str:
    """Return a time with a unit that suits it."""
    return f"{1e3 * seconds:.0f} ms" if seconds >= 1e-2 else f"{rounded(1e6 * seconds)} µs"


def as_object(found: list[Measured]) -> dict[str, object]:
    """Return all that was measured for `--json`."""
    return {
        "machine": machine(),
        "figures": [
            {"name": figure.name, "reference": figure.reference, "bound": figure.bound, "ratio": ratio(times)}
            | {"ours_s": [ours for ours, _ in times], "reference_s": [reference for _, reference in times]}
            for figure, times in found
        ],
    }


def write(found: list[Measured]) -> None:
    """Put the table into its page."""
    lines = ["| " + " | ".join(each) + " |" for each in (HEAD, ["---"] * len(HEAD), *map(cells, found))]
    text = f"Measured on {machine()}, in {len(found[0][1])} rounds.\n\n" + "\n".join(lines)
    put_on_page("bench.py --write", f"{text}\n")


def main() -> int:
    """Measure, print, and judge; return 1 if a ratio is above its bound."""
    parser = argparse.ArgumentParser(prog="haptic-fieldbus bench", description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help=f"{SHORT_ROUNDS} rounds, with {PATIENCE:g} × the bounds")
    parser.add_argument("--only", metavar="WORD", default="", help="only the figures whose name contains WORD")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    if PAGE.is_file():  # in a checkout
        parser.add_argument("--write", action="store_true", help="write the table into docs/reference/performance.md")
    asked = parser.parse_args()
    figures = [figure for figure in FIGURES if asked.only in figure.name]
    if not figures:
        parser.exit(2, f"--only {asked.only}: expected a part of one of: {'; '.join(each.name for each in FIGURES)}\n")
    found = measured(figures, SHORT_ROUNDS if asked.short else ROUNDS)
    patience = PATIENCE if asked.short else 1.0
    if asked.short:
        doubtful = dict(measured(above(found, patience), ROUNDS))
        found = [(figure, doubtful.get(figure, times)) for figure, times in found]
    if asked.json:
        print(json.dumps(as_object(found), indent=2))
    else:
        table = Table(*HEAD, title=machine(), box=None, title_justify="left", pad_edge=False)
        for each in found:
            table.add_row(*cells(each))
        Console().print(table)
    if getattr(asked, "write", False):
        write(found)
    slow = above(found, patience)
    for figure in slow:
        print(f"above its bound: {figure.name}", file=sys.stderr)
    return 1 if slow else 0


if __name__ == "__main__":
    # Both ways to end unwind the stack, which ends the processes that were started.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
