"""How long does torque last after each cause for which it is taken away, beside the time that the plan states?

`python -m benchmarks.deadlines` measures all of it at the simulated drives, in virtual time, and writes the tables of
docs/reference/deadlines.md anew; it takes some minutes.
"""

from collections.abc import Iterable
from itertools import groupby
from pathlib import Path

from haptic_fieldbus.planning.explain import milliseconds
from tests.system.zero_torque import PROFILES, Row, table

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "deadlines.md"
BEGIN = "<!-- written by python -m benchmarks.deadlines -->\n"


def tables(rows: Iterable[Row]) -> str:
    """The rows as one table for each profile, with a column for each of its rates: `stated / measured`."""
    return "".join(f"\n{_table(profile, list(of))}" for profile, of in groupby(rows, key=lambda row: row.profile))


def _table(profile: str, rows: list[Row]) -> str:
    rates = PROFILES[profile]
    head = f"| {profile} | {' | '.join(f'{rate:g} Hz' for rate in rates)} |\n|---|{'---|' * len(rates)}\n"
    cells = {(row.cause, row.rate): _cell(row) for row in rows}
    causes = dict.fromkeys(row.cause for row in rows)
    return head + "".join(
        f"| {cause.value} | {' | '.join(cells[cause, rate] for rate in rates)} |\n" for cause in causes
    )


def _cell(row: Row) -> str:
    return f"{milliseconds(row.stated)} / {milliseconds(row.measured)}"


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8").partition(BEGIN)[0]
    PAGE.write_text(text + BEGIN + tables(table()), encoding="utf-8")
    print(f"written: {PAGE}")
