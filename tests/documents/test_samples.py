"""A sampled quantity in a CSV file: each fault is told with its line and column, all of a file at once."""

from pathlib import Path

import numpy as np
import pytest

from haptic_fieldbus.documents import samples
from haptic_fieldbus.documents.samples import MOST_FAULTS, read_samples
from haptic_fieldbus.errors import DocumentError

BOTH = ("position", "velocity")


def written(folder: Path, text: str) -> Path:
    path = folder / "signal.csv"
    path.write_text(text, encoding="utf-8")
    return path


def faults_of(path: Path) -> list[str]:
    with pytest.raises(DocumentError) as refused:
        read_samples(path, BOTH)
    assert all(line.startswith(f"{path}: ") for line in str(refused.value).splitlines())
    return [str(fault) for fault in refused.value.faults]


def test_columns_are_found_by_their_names_wherever_they_stand(tmp_path: Path) -> None:
    path = written(tmp_path, '\ufeffnote, velocity ,time\r\n"a,\nb",0.5,1\r\n\r\n,-2e-3, 1.5\r\n')
    found = read_samples(path, BOTH)
    assert found.quantity == "velocity"
    np.testing.assert_array_equal(found.times, [1.0, 1.5])
    np.testing.assert_array_equal(found.values, [0.5, -2e-3])
    np.testing.assert_array_equal(found.lines, [3, 5])


@pytest.mark.parametrize(
    ("text", "faults"),
    [
        ("", ['columns ""; expected the columns time and position or velocity, separated by commas']),
        (
            "t;x\n0;1\n",
            ['line 1: columns "t;x"; expected the columns time and position or velocity, separated by commas'],
        ),
        (
            "time,force\n0,1\n",
            ['line 1: columns "time, force"; expected the columns time and position or velocity, separated by commas'],
        ),
        (
            "time,position,velocity\n0,1,1\n",
            [
                "line 1: columns position and velocity; expected the columns time and position or velocity, separated "
                "by commas, and only one of these"
            ],
        ),
        ("time,position,time\n0,1,2\n", ["line 1: time: appears 2 times; expected one column with this name"]),
        ("time,position\n0,1\n", ["line 2: 1 rows of numbers; expected two or more"]),
        (
            "time,position\n0,x\n0.1\n,3\n0.2,nan\n0.3,-inf\n0.4,1e101\n0.5,1\n0.5,2\n0.4,3\n0.6,1\n",
            [
                'line 2: position: "x"; expected a number',
                "line 3: position: missing; expected a number",
                "line 4: time: missing; expected a number",
                "line 5: position: nan; expected a finite number, at most 1e100 in size",
                "line 6: position: -inf; expected a finite number, at most 1e100 in size",
                "line 7: position: 1e101; expected a finite number, at most 1e100 in size",
                "line 9: time: 0.5 after 0.5; expected a later time",
                "line 10: time: 0.4 after 0.5; expected a later time",
            ],
        ),
        ('time,position\n0,1\n1,"' + "x" * 200_000, ["line 3: not CSV: field larger than field limit (131072)"]),
    ],
)
def test_every_fault_is_told_with_its_line_and_column(text: str, faults: list[str], tmp_path: Path) -> None:
    assert faults_of(written(tmp_path, text)) == faults


def test_of_very_many_faults_the_first_are_told_and_the_others_counted(tmp_path: Path) -> None:
    found = faults_of(written(tmp_path, "time,position\n" + "".join(f"{row},x\n" for row in range(1000))))
    assert found[MOST_FAULTS - 1] == f'line {MOST_FAULTS + 1}: position: "x"; expected a number'
    assert found[MOST_FAULTS:] == [f"and {1000 - MOST_FAULTS} more errors"]


def test_what_is_no_text_or_not_there_is_told(tmp_path: Path) -> None:
    path = tmp_path / "signal.csv"
    assert faults_of(path) == ["cannot be read: No such file or directory"]
    path.write_bytes(b"time,position\n\xff")
    assert faults_of(path) == ["not UTF-8, from octet 14 on"]


def test_a_row_too_many_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "MOST_ROWS", 3)
    assert len(read_samples(written(tmp_path, "time,position\n0,1\n1,1\n2,1\n"), BOTH).times) == 3
    assert faults_of(written(tmp_path, "time,position\n0,1\n1,1\n2,1\n3,1\n4,1\n")) == [
        "line 5: too many rows; expected at most 3"
    ]
