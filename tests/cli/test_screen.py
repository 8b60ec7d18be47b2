import io
import json
import math
import sys

import pytest

from haptic_fieldbus.cli.screen import ProgressBar, plain, print_json, show, show_table
from haptic_fieldbus.signals import Workspace


class Terminal(io.StringIO):
    """A text stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def narrow(monkeypatch: pytest.MonkeyPatch) -> None:
    """A terminal of 40 columns that knows colours, whatever the one is that runs the tests."""
    for name, value in (("COLUMNS", "40"), ("TERM", "xterm-256color")):
        monkeypatch.setenv(name, value)
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)


LONG = "one two three four five six seven eight nine ten"


def test_lines_stay_whole_and_plain_in_a_pipe() -> None:
    pipe = io.StringIO()
    show([("scene", LONG), ("", "more"), (None, "[b]alone[/b] :smile:"), ("end", "")], pipe)
    assert pipe.getvalue() == f"scene      {LONG}\n           more\n[b]alone[/b] :smile:\nend\n".replace(
        "end\n", "end        \n"
    )


@pytest.mark.parametrize(
    "text", [LONG, "", " a \n\n b ", "a\tb", "bell\a\b\v\f\rend", "[b]x[/b] :smile:", "ä½–", "x\n"]
)
def test_a_pipe_has_what_rich_writes_into_one(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [("scene", text), ("", text), (None, text), ("a key that is longer than its column", text)]
    plain_pipe, rich_pipe = io.StringIO(), io.StringIO()
    show(lines, plain_pipe)
    monkeypatch.setenv("FORCE_COLOR", "")  # Rich then decides, and colours nothing
    show(lines, rich_pipe)
    assert plain_pipe.getvalue() == rich_pipe.getvalue()


def test_a_pipe_is_coloured_where_the_environment_asks_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    pipe = io.StringIO()
    show([("scene", "wall")], pipe)
    assert pipe.getvalue() == "\x1b[1mscene      \x1b[0mwall\n"


def test_lines_are_wrapped_beside_their_key_on_a_terminal() -> None:
    terminal = Terminal()
    show([("scene", LONG)], terminal)
    lines = [line.replace("\x1b[1m", "").replace("\x1b[0m", "") for line in terminal.getvalue().splitlines()]
    assert len(lines) == 2
    assert lines[0].startswith("scene      one")
    assert lines[1].startswith("           ")
    assert all(len(line) <= 40 for line in lines)
    assert " ".join(line[11:] for line in lines) == LONG


def test_keys_are_bold_on_a_terminal_only() -> None:
    terminal, pipe = Terminal(), io.StringIO()
    for stream in (terminal, pipe):
        show([("scene", "wall")], stream)
    assert terminal.getvalue() == "\x1b[1mscene      \x1b[0mwall\n"
    assert pipe.getvalue() == "scene      wall\n"


def test_columns_are_as_wide_as_their_longest_entry(capsys: pytest.CaptureFixture[str]) -> None:
    show_table(("a", "b"), [("one", "x"), ("three", "y")])
    assert capsys.readouterr().out == "a      b\none    x\nthree  y\n"


def test_json_is_one_object_with_its_keys_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"b": 1, "a": {"µ": None}})
    out = capsys.readouterr().out
    assert json.loads(out) == {"b": 1, "a": {"µ": None}}
    assert out.index('"b"') < out.index('"a"')


def test_json_refuses_what_is_no_number() -> None:
    with pytest.raises(ValueError, match="JSON"):
        print_json({"a": math.nan})


def test_values_become_plain() -> None:
    assert plain({"w": Workspace.LINEAR, "t": (1, 2.5, None, True), "o": 1j}) == {
        "w": "linear",
        "t": [1, 2.5, None, True],
        "o": "1j",
    }


def test_the_bar_shows_the_seconds_done(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    progress = ProgressBar(10.0)
    progress(500, 10_000)
    progress(501, 10_000)
    progress(10_000, 10_000)
    progress.close()
    assert "0.5 of 10.0 s" in terminal.getvalue()
    assert "10.0 of 10.0 s" in terminal.getvalue()
    assert "501" not in terminal.getvalue()


def test_a_silent_bar_draws_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    progress = ProgressBar(10.0)
    progress.silent = True
    progress(10_000, 10_000)
    progress.close()
    assert terminal.getvalue() == ""
