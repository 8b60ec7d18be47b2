"""Faults of a file are told at once, in plain words, with key and line."""

import contextlib
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
from annotated_types import Ge, Gt, Le, Len, Lt
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.documents import Document, file_of, is_path, nearest, read_document, schema_of, suggestion
from haptic_fieldbus.documents.document import key_text, knows
from haptic_fieldbus.documents.expected import Expectation
from haptic_fieldbus.documents.positions import Positions
from haptic_fieldbus.errors import DocumentError, SceneError, UsageError, VcanError, require

STRICT = {"extra": "forbid", "allow_inf_nan": False}


@dataclass(frozen=True)
class Inner:
    ratio: Annotated[float, Ge(0), Lt(1)]
    word: Literal["spring", "damper"] = "spring"
    __pydantic_config__: ClassVar = STRICT


@dataclass(frozen=True)
class Sample:
    """A table with one key of each sort."""

    count: Annotated[int, Ge(1), Le(9)] = 1
    factor: Annotated[float, Gt(0)] = 1.0
    share: Annotated[float, Le(1)] = 1.0
    amount: float = 0.0
    flag: bool = False
    text: str = ""
    label: Annotated[str, Len(1)] = "x"
    pair: tuple[float, float] = (0.0, 1.0)
    many: tuple[Annotated[int, Ge(0)], ...] = ()
    free: tuple[dict[str, object], ...] = ()
    inner: Inner | None = None
    named: dict[str, Inner] = field(default_factory=dict)
    zero: Literal["start"] | int = "start"
    index: Annotated[int, Ge(0x1000), Le(0xFFFF)] = 0x1000
    whatever: object = 0
    source: str = ""
    __pydantic_config__: ClassVar = STRICT


def read(text: str) -> Sample:
    document = Document("sample.toml", text, DocumentError)
    return document.checked(document.validate(Sample, loaded=("source",)))


def faults_of(text: str) -> list[str]:
    """All faults of a text read as a Sample."""
    with pytest.raises(DocumentError) as caught:
        read(text)
    return [str(fault) for fault in caught.value.faults]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("count = 1.0", "line 1: count: 1.0; expected a whole number from 1 to 9"),
        ("count = 10", "line 1: count: 10; expected a whole number from 1 to 9"),
        ("count = true", "line 1: count: true; expected a whole number from 1 to 9"),
        ('count = "1"', 'line 1: count: "1"; expected a whole number from 1 to 9'),
        ("factor = 0", "line 1: factor: 0; expected a number above 0"),
        ("factor = nan", "line 1: factor: nan; expected a number above 0"),
        ("factor = -inf", "line 1: factor: -inf; expected a number above 0"),
        ('factor = "2.0"', 'line 1: factor: "2.0"; expected a number above 0'),
        ("factor = false", "line 1: factor: false; expected a number above 0"),
        ("factor = 1979-05-27", "line 1: factor: 1979-05-27; expected a number above 0"),
        ("share = 2", "line 1: share: 2; expected a number of at most 1"),
        ("amount = nan", "line 1: amount: nan; expected a finite number"),
        ("flag = 1", "line 1: flag: 1; expected true or false"),
        ("text = 3", "line 1: text: 3; expected a string"),
        ("text = 1979-05-27", "line 1: text: 1979-05-27; expected a string"),
        ('label = ""', 'line 1: label: ""; expected a non-empty string'),
        ("pair = [1.0]", "line 1: pair[1]: missing; expected a number"),
        ("pair = [1, 2, 3]", "line 1: pair: [1, 2, 3]; expected a list of 2 values, each a number"),
        ("pair = 1", "line 1: pair: 1; expected a list of 2 values, each a number"),
        ("many = 1", "line 1: many: 1; expected a list, each a whole number of at least 0"),
        ("many = [\n 1,\n -1]", "line 3: many[1]: -1; expected a whole number of at least 0"),
        ("free = 1", "line 1: free: 1; expected a list, each a table"),
        ("inner = 1", "line 1: inner: 1; expected a table with ratio and word"),
        ("inner = {}", "line 1: inner.ratio: missing; expected a number of at least 0 and below 1"),
        ("[inner]\nratio = 1.5", "line 2: inner.ratio: 1.5; expected a number of at least 0 and below 1"),
        ("named = 1", "line 1: named: 1; expected a table"),
        (
            '[named."a b"]\nratio = 0\nword = "sprig"',
            'line 3: named."a b".word: "sprig"; expected "spring" or "damper"; nearest: spring',
        ),
        ('zero = "begin"', 'line 1: zero: "begin"; expected "start" or a whole number'),
        ("zero = 1.5", 'line 1: zero: 1.5; expected "start" or a whole number'),
        ("index = 0x0071", "line 1: index: 0x0071; expected a whole number from 0x1000 to 0xFFFF"),
        ("index = 113", "line 1: index: 113; expected a whole number from 4096 to 65535"),
        ("cuont = 1", "line 1: cuont: unknown key; nearest: count"),
        ("inner = { ratio = 0, z = 1 }", "line 1: inner.z: unknown key; known: ratio, word"),
        ('source = "me"', "line 1: source: unknown key"),
    ],
)
def test_a_fault_names_the_value_found_and_what_was_expected(text: str, message: str) -> None:
    assert faults_of(text) == [message]


def test_integers_are_fine_where_numbers_are_expected() -> None:
    assert read("factor = 2\npair = [0, 1]").factor == 2.0


def test_a_value_that_is_long_is_described_instead_of_shown() -> None:
    assert faults_of(f"count = [{'1, ' * 40}]") == ["line 1: count: a list; expected a whole number from 1 to 9"]
    assert faults_of("[count]\nx = 1") == ["line 1: count: a table; expected a whole number from 1 to 9"]
    assert faults_of(f'count = "{"x" * 90}"')[0].endswith("x…; expected a whole number from 1 to 9")


def test_true_and_one_point_zero_are_refused_where_a_literal_has_numbers() -> None:
    document = Document("sample.toml", "a = true\nb = 1.0\nc = 1", DocumentError)
    for key in "abcd":
        document.integers((key,))
    with pytest.raises(DocumentError) as caught:
        document.checked(None)
    assert [fault.key for fault in caught.value.faults] == ["a", "b"]


def test_a_second_fault_of_a_key_is_told_only_when_it_is_true_as_well() -> None:
    document = Document("sample.toml", "a = 1", DocumentError)
    document.fault(("a",), "first")
    document.fault(("a",), "second")
    document.fault(("a",), "third", also=True)
    with pytest.raises(DocumentError, match="first") as caught:
        document.checked(1)
    assert [fault.message for fault in caught.value.faults] == ["first", "third"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a = ", "line 1: not TOML: Invalid value, at the end"),
        ("a = 1\nb = = 2\n", "line 2: not TOML: Invalid value, at column 5"),
        ("a = 1\na.b = 2\n", "line 2: not TOML: Cannot overwrite a value, at column 8"),
        ("a = {}\na.b = 2\n", "line 2: not TOML: Cannot mutate immutable namespace ('a',), at column 8"),
        ("a = " + "[" * 5000, "nested too deeply"),
        ("a = " + "[" * 300 + "]" * 300, "nested too deeply"),
        (f"a = {'9' * 5000}", "a number has too many digits"),
        (f"a = {'9' * 400}", "a number has too many digits"),
        (f"a = [{{ b = -{2**128} }}]", "a number has too many digits"),
        (f"a = 0x{'9' * 5000}", "a number has too many digits"),
    ],
)
def test_what_is_not_toml_is_told_with_its_line(text: str, message: str) -> None:
    assert faults_of(text) == [message]


def test_all_keys_given_twice_are_told() -> None:
    text = "a = 1\na = 2\n[t]\nx = 1\n[u]\n[t]\nx = 1\n[v.w]\n[v]\n[[e]]\nk = 1\nk = 2\n[[e]]\nk = 3\n"
    assert faults_of(text) == [
        "line 2: a: set twice; first in line 1",
        "line 6: t: set twice; first in line 3",
        "line 7: t.x: set twice; first in line 4",
        "line 12: e[0].k: set twice; first in line 11",
    ]


@pytest.mark.parametrize("broken", ["[#c\na]\n", '"\\ud800" = 1\n', '["\\ud800"]\nb = 1\n', "[\n", "b = [1, =]\n"])
def test_keys_given_twice_are_told_also_in_a_text_that_is_broken_further_down(broken: str) -> None:
    assert faults_of(f"a = 1\na = 2\n{broken}") == ["line 2: a: set twice; first in line 1"]


def test_faults_come_in_the_order_of_their_lines_and_those_without_a_line_last() -> None:
    document = Document("sample.toml", "a = 1\nb = 2", DocumentError)
    for key in ("absent", "b", "a"):
        document.fault((key,), "wrong")
    with pytest.raises(DocumentError) as caught:
        document.checked(1)
    assert [fault.line for fault in caught.value.faults] == [1, 2, None]


def test_a_file_that_is_missing_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="no such file"):
        read_document(tmp_path / "absent.toml", SceneError)


def test_a_folder_and_an_impossible_name_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="cannot be read: it is a folder; expected a regular file"):
        read_document(tmp_path, SceneError)
    with pytest.raises(SceneError, match="cannot be read: invalid file name"):
        read_document(Path("a\0b"), SceneError)


def test_a_file_that_is_not_utf_8_is_told_with_octet_and_line(tmp_path: Path) -> None:
    path = tmp_path / "latin.toml"
    path.write_bytes(b'a = 1\nb = "\xb5N"\n')
    with pytest.raises(SceneError) as caught:
        read_document(path, SceneError)
    assert [str(fault) for fault in caught.value.faults] == ["line 2: not UTF-8: octet 0xB5; save the file as UTF-8"]


def test_a_byte_order_mark_and_line_ends_of_windows_are_fine(tmp_path: Path) -> None:
    path = tmp_path / "windows.toml"
    path.write_bytes(b"\xef\xbb\xbfcount = 2\r\nfactor = -1\r\n")
    document = read_document(path, SceneError)
    with pytest.raises(SceneError) as caught:
        document.checked(document.validate(Sample))
    assert [(fault.key, fault.line) for fault in caught.value.faults] == [("factor", 2)]


def test_a_value_of_the_caller_is_told_by_its_label_and_without_a_line() -> None:
    document = Document("sample.toml", "[inner]\nratio = 0.5", DocumentError)
    document.table("inner")["ratio"] = 7.0
    document.labels["inner", "ratio"] = "--set inner.ratio"
    with pytest.raises(DocumentError) as caught:
        document.checked(document.validate(Sample))
    assert [str(fault) for fault in caught.value.faults] == [
        "--set inner.ratio: 7.0; expected a number of at least 0 and below 1"
    ]


def test_lines_of_nested_keys_are_found() -> None:
    text = (
        "# comment\n"
        'a.b = 1\n"q.x" = { c = 0x10, d.e = [1,\n 2, # two\n {f = 3}] }\n[t.u] # header\nk = """x\ny"""\n'
        "[[e]]\nn = 1\n[[e]]\n[e.f]\nz = 1\n[[e.g]]\nk = 2\n"
    )
    tomllib.loads(text)
    positions = Positions(text)
    assert [
        positions.line(path)
        for path in (
            ("a",),
            ("a", "b"),
            ("q.x", "c"),
            ("q.x", "d", "e"),
            ("q.x", "d", "e", 1),
            ("q.x", "d", "e", 2, "f"),
            ("t",),
            ("t", "u", "k"),
            ("t", "u", "absent"),
            ("e", 0, "n"),
            ("e", 1, "f", "z"),
            ("e", 1, "g", 0, "k"),
            ("absent",),
            (),
        )
    ] == [2, 2, 3, 3, 4, 5, 6, 7, 6, 10, 13, 15, None, None]
    assert positions.text(("q.x", "c")) == "0x10"
    assert positions.text(("nowhere",)) == ""
    assert positions.duplicates == []


@given(st.recursive(st.integers(0, 9), lambda inner: st.dictionaries(st.text(max_size=3), inner, max_size=3)))
def test_each_key_of_a_table_is_found_on_its_line(value: object) -> None:
    """Keys of any characters, one line each, dotted."""
    lines: list[tuple[tuple[str, ...], str]] = []

    def flatten(path: tuple[str, ...], inner: object) -> None:
        if isinstance(inner, dict) and inner:
            for key, member in inner.items():
                flatten((*path, key), member)
        elif path and isinstance(inner, int):
            lines.append((path, f"{key_text(path)} = {inner}"))

    flatten((), value)
    text = "\n".join(line for _, line in lines if tomllib.loads(line))
    positions = Positions(text)
    for number, (path, _) in enumerate(lines, 1):
        assert positions.line(path) == number


@given(st.text() | st.text(alphabet='ab.[]{}=,"\n#1 '))
def test_no_text_raises_anything_but_a_document_error(text: str) -> None:
    with contextlib.suppress(DocumentError):
        read(text)


@given(st.text(alphabet='ab.[]{}=,"\n#1 '))
def test_positions_of_a_broken_text_never_fail(text: str) -> None:
    assert Positions(text).line(("a",)) is None or "a" in text


def test_near_names_are_found_by_likeness_and_by_a_part() -> None:
    names = ["generic_cia402", "maxon_epos4", "maxon_epos2"]
    assert nearest("maxon_epos5", names) == ["maxon_epos4", "maxon_epos2"]
    assert nearest("EPOS", names) == ["maxon_epos2", "maxon_epos4"]
    assert nearest("zz", names) == []


def test_a_suggestion_lists_all_names_when_none_is_near_and_they_are_few() -> None:
    assert suggestion("maxon_epos5", ["maxon_epos4"]) == "; nearest: maxon_epos4"
    assert suggestion("zz", ["b", "a"]) == "; known: a, b"
    assert suggestion("zz", [f"name{number}" for number in range(20)]) == ""
    assert suggestion("zz", []) == ""


def test_a_path_is_told_from_a_name(tmp_path: Path) -> None:
    assert [is_path(name) for name in (Path("a"), "a.toml", "x/a", "x\\a", "a")] == [True, True, True, True, False]
    (tmp_path / "wall.toml").touch()
    assert file_of("scene", "wall", tmp_path) == tmp_path / "wall.toml"
    assert file_of("scene", "my/wall.toml", tmp_path) == Path("my/wall.toml")
    with pytest.raises(UsageError) as caught:
        file_of("scene", "wal", tmp_path)
    assert str(caught.value) == 'no scene "wal"; nearest: wall. To list them: haptic-fieldbus scenes list'


def test_what_the_loader_fills_in_is_not_in_the_exported_schema() -> None:
    assert "source" not in schema_of(Sample, loaded=("source",))["properties"]
    assert "source" in schema_of(Sample)["properties"]


def test_a_package_that_is_missing_is_named_with_its_extra() -> None:
    require("numpy", "data")
    with pytest.raises(UsageError, match=r"^this needs no_such_package; in a checkout, run: pip install -e '\.\[data"):
        require("no_such_package", "data")


def test_a_command_that_could_not_run_beside_vcan_has_an_exit_status() -> None:
    assert (VcanError("no guest kernel").status, VcanError("interrupted", 130).status) == (125, 130)


@pytest.mark.parametrize(
    ("path", "there"),
    [
        (("count",), True),
        (("inner", "ratio"), True),
        (("inner", "count"), False),
        (("named", "ratio"), True),  # any name is a key of this table
        (("named", "any", "ratio"), True),
        (("named", "any", "count"), False),
        (("many", "ratio"), False),
        (("amount", "ge"), False),
        (("share", "le"), False),
        (("none",), False),
        ((0,), False),
    ],
)
def test_a_schema_has_a_key_by_its_dataclasses_as_by_its_json_schema(path: tuple[str | int, ...], there: bool) -> None:
    assert knows(Sample, path) is there
    assert bool(Expectation(schema_of(Sample)).nodes(path, {})) is there
