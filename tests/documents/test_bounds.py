"""Texts that would take minutes to parse are refused before, and honest texts are not."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_fieldbus.documents.safe_read import DEEPEST, MOST_MEMBERS, fault_of_data, fault_of_text
from tests.documents.hostile import READERS, TOML, said_of

OF_TOML = {name: code for name, code in READERS.items() if name in ("scene", "rig", "profile", "faults")}


@pytest.mark.thorough("a process for each kind of text", quick=2)
@pytest.mark.parametrize("kind", TOML)
def test_every_reader_refuses_a_text_that_would_take_minutes(kind: str, tmp_path: Path) -> None:
    text, words = TOML[kind]
    (tmp_path / "x.toml").write_text(text, encoding="utf-8")
    found = said_of(tmp_path, OF_TOML)
    for reader, said in found.items():
        assert said is not None, reader
        assert len(said) < 50_000, reader
    assert words in (found["scene"] or "")


@pytest.mark.parametrize("quote", ['"', "'", '"""', "'''"])
def test_brackets_and_dots_in_texts_and_comments_do_not_count(quote: str) -> None:
    inner = "[" * 100 + "{" * 100 + "a." * 100
    text = f"a = {quote}{inner}{quote} # {inner}\nb = 1\n"
    tomllib.loads(text)
    assert fault_of_text(text) == ""


def test_the_deepest_and_the_longest_are_taken() -> None:
    assert fault_of_text("a = " + "[" * DEEPEST + "]" * DEEPEST) == ""
    assert fault_of_text("a = " + "[" * (DEEPEST + 1)) == "nested too deeply"
    assert fault_of_text("a" + ".a" * (DEEPEST - 1) + " = 1") == ""
    assert "too many parts" in fault_of_text("a" + ".a" * DEEPEST + " = 1")
    assert fault_of_data({"a": [0] * MOST_MEMBERS}) == ""
    assert "1001 members" in fault_of_data({"a": [0] * (MOST_MEMBERS + 1)})


LEAVES = st.text(st.sampled_from("\"'\\[]{}#.=a \n"), max_size=12)


@given(st.dictionaries(st.sampled_from("abc"), LEAVES, max_size=3))
def test_no_text_that_quotes_hide_is_counted(values: dict[str, str]) -> None:
    lines = [f'{key} = """{value}"""' for key, value in values.items()]
    text = "\n".join(lines)
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return
    assert fault_of_text(text) == ""
