"""The table of what users of other programs suffered from: each test that it names exists."""

import re
from pathlib import Path

from tests.cases import every

PROJECT = Path(__file__).resolve().parents[2]
PAGE = PROJECT / "docs" / "reference" / "pains.md"
ROWS = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if re.match(r"\| (?!reported|-)", line)]


def test_the_table_is_there() -> None:
    assert len(ROWS) > 30


@every("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_the_test_of_each_row_exists(row: str) -> None:
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert len(cells) == 4
    file, _, function = cells[-1].strip("`").partition("::")
    assert (PROJECT / file).is_file()
    assert not function or f"def {function}(" in (PROJECT / file).read_text(encoding="utf-8")
