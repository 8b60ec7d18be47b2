"""One table of a TOML text is changed; every other octet of it stays, or the change is refused."""

import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_fieldbus.documents.edits import Value, table_text, with_table
from tests.lanes import examples

PATH = ("axis", "handle", "proved")
VALUES: dict[str, Value] = {"serial": 0xC17B76A7, "guard": "proved", "guard_ms": 48.924}
RIG = """\
# A bench.  Two spaces, a tab\t and “quotes”
[bus.can]   # the only one
interface = 'socketcan'

[axis.handle]
node = 0x05    # by its DIP switches
text = \"\"\"
[axis.handle.proved]
guard = "in a text"
\"\"\"
[axis.handle.limits]   # in N
effort = 8
"""


def test_a_new_table_comes_last_and_everything_before_it_stays() -> None:
    assert with_table(RIG, PATH, VALUES) == RIG + (
        '\n[axis.handle.proved]\nserial = 0xC17B76A7\nguard = "proved"\nguard_ms = 48.924\n'
    )


def test_a_table_that_is_there_keeps_its_place_its_comments_and_what_follows_it() -> None:
    header = "[axis.handle.proved]  # by a run\n"
    before = RIG.replace("[axis.handle]\nnode", "[axis.handle]\nnodes")
    old = f"{before}{header}# kept\nserial = 1   # gone\nold = true\n\n[axis.handle.proved.sign]\nway = 1\n# end"
    assert with_table(old, PATH, {"guard": "none"}) == (
        f'{before}{header}guard = "none"\n# kept\n\n[axis.handle.proved.sign]\nway = 1\n# end'
    )


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
def test_a_comment_behind_a_value_stays_beside_its_new_value(ending: str) -> None:
    old = [
        "[axis.handle]",
        "[axis.handle.proved]",
        'guard = "a # b"  # cold grease',
        "way = [1, 2]\t# two",
        "old = 1 # gone",
    ]
    new = with_table(ending.join([*old, ""]), PATH, {"guard": "none", "way": [3.0], "more": 1.5})
    told = ['guard = "none"  # cold grease', "way = [3.0]\t# two", "more = 1.5"]
    assert new == ending.join([*old[:2], *told, ""])


@pytest.mark.parametrize("text", ["[axis.handle]", "[axis.handle]\r\nnode = 1\r\n", "axis.handle.node = 1\n"])
def test_line_endings_and_a_missing_last_one_stay(text: str) -> None:
    changed = with_table(text, PATH, {"guard": "none"})
    assert changed.startswith(text)
    assert tomllib.loads(changed)["axis"]["handle"]["proved"] == {"guard": "none"}
    assert ("\r" in changed) is ("\r" in text)
    assert changed.count("\r") in (0, changed.count("\n"))


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("[axis.knob]\nnode = 1\n", r"\[axis\.handle\] no longer exists"),
        ("axis = 5\n", "no longer exists"),
        ("[axis\n", "."),
        ("axis = { handle = { node = 1 } }\n", "."),
        ("[axis.handle]\nproved = { guard = 'none' }\n", "."),
        ("[axis.handle]\nproved.guard = 'none'\n", "."),
        ("[ axis . handle . proved ]\nguard = 'none'\n", "."),
        ('[axis.handle]\n[axis."handle".proved]\nguard = "x"\n', "."),
        ("[axis.handle.proved]\nlist = [\n1,\n[2],\n]\n", "."),
        ("[[axis.handle.proved]]\nguard = 'x'\n", "."),
        ("[" * 5000, "deeply"),
    ],
)
def test_a_form_that_lines_cannot_change_is_refused(text: str, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        with_table(text, PATH, VALUES)


KEYS = st.text(min_size=1, max_size=8)


@settings(max_examples=examples(100))
@given(
    name=KEYS,
    values=st.dictionaries(
        st.from_regex(r"[a-z_]{1,8}", fullmatch=True), st.text(max_size=20) | st.integers(0, 2**32 - 1)
    ),
)
def test_any_name_of_an_axis_and_any_text_come_back_as_they_were(name: str, values: dict[str, Value]) -> None:
    try:
        rig = table_text(("axis", name), {"node": 1})
        tomllib.loads(rig)
    except tomllib.TOMLDecodeError:  # a lone surrogate, which no file can hold
        return
    for _ in range(2):
        rig = with_table(rig, ("axis", name, "proved"), values)
    assert tomllib.loads(rig) == {"axis": {name: {"node": 1, "proved": values}}}


@settings(max_examples=examples(200))
@given(
    st.lists(
        st.sampled_from([*RIG.splitlines(True), "[axis.handle.proved]\n", "guard = 'x'\n", "'''\n", "#\u2028[a]\n"]),
        max_size=25,
    )
)
def test_whatever_the_lines_only_the_table_changes_or_nothing(lines: list[str]) -> None:
    text = "".join(lines)
    try:
        changed = with_table(text, PATH, VALUES)
    except ValueError:
        return
    before, after = tomllib.loads(text), tomllib.loads(changed)
    assert after["axis"]["handle"].pop("proved") == VALUES
    before["axis"]["handle"].pop("proved", None)
    assert after == before
