"""The table of faults: complete, its tests exist, and each fault of a simulated bench ends as its row says."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import pytest

from haptic_fieldbus.api import run
from haptic_fieldbus.assessing.result import Result
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.sim import faults
from tests.builders import endless_rig
from tests.cases import every

PROJECT = Path(__file__).resolve().parents[2]
PAGE = PROJECT / "docs" / "reference" / "fmea.md"
AT, GOES_ON = 1.5, "goes on"
DURATION, LONGER = 5.0, {"position_stuck": 9.0}
"""[s]; an encoder is asked five times before the run ends."""
OF_MODBUS = ("answer_", "connection_reset", "foreign_set_points")
"""How kinds begin that a line of Modbus has, and no CAN bus."""


@dataclass(frozen=True)
class Row:
    fault: str
    tried: str
    noticed: str
    test: str


def rows() -> list[Row]:
    """All lines of all tables; `tried` and `noticed` are empty where nothing is run."""
    found = []
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("|") or cells[0] in ("fault", "---"):
            continue
        fault, test = cells[0].strip("`"), cells[-1].strip("`")
        run_too = len(cells) == 6
        found.append(Row(fault, cells[1] if run_too else "", cells[3] if run_too else "", test))
    return found


ROWS = rows()
RUN = {row.fault: row for row in ROWS if row.noticed}


def test_every_kind_of_fault_has_a_row() -> None:
    kinds = {
        kind
        for name in vars(faults).values()
        if isinstance(name, type)
        for kind in re.findall(r"kind: (?:typing\.)?Literal\['(\w+)'\]", _kind_of(name))
    }
    assert len(kinds) > 30
    assert kinds <= {row.fault for row in ROWS}


def _kind_of(name: type) -> str:
    return f"kind: {getattr(name, '__annotations__', {}).get('kind', '')}"


@every("row", ROWS, ids=lambda row: row.fault)
def test_the_test_of_each_row_exists(row: Row) -> None:
    file, _, function = row.test.partition("::")
    assert (PROJECT / file).is_file()
    assert not function or f"def {function}(" in (PROJECT / file).read_text(encoding="utf-8")


@pytest.mark.thorough("a run for each row", quick=1)
@pytest.mark.parametrize("fault", RUN)
def test_each_fault_ends_as_its_row_says(fault: str, tmp_path: Path) -> None:
    row = RUN[fault]
    file = tmp_path / "faults.toml"
    values = "\n".join(re.findall("`([^`]+)`", row.tried))
    file.write_text(f'[[fault]]\nkind = "{fault}"\nat = {AT}\n{values}\n', encoding="utf-8")
    bus = "sim-modbus-tcp" if fault.startswith(OF_MODBUS) else "sim"
    assert [trip.name for trip in _ended(file, bus, LONGER.get(fault, DURATION)).trips] == (
        [] if row.noticed == GOES_ON else [row.noticed]
    )


def _ended(file: Path, bus: str, duration: float) -> Result:
    try:
        if bus == "sim":
            return run("wall", endless_rig("wall"), hand="push", duration=duration, faults=file)
        return run("wall", bus=bus, settings={"wall.stiffness": "max/2"}, hand="push", duration=duration, faults=file)
    except HapticFieldbusError as error:
        return cast(Result, error.result)
