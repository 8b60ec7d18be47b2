"""`plan`, `stability` and `run` carry along what is assumed of the drive."""

import json

import pytest

from tests.cli.command import Command

TIMES = "torque loop 1000 Hz, control period 0.5 ms"


def test_the_commands_say_it_in_words_and_in_json(command: Command) -> None:
    for words in (("plan", "wall"), ("stability", "wall")):
        shown = command(*words, "--drive", "generic_cia402")
        assert f"assumed    {TIMES}" in shown.out
        assert json.loads(command(*words, "--drive", "generic_cia402", "--json").out)["assumed"] == [TIMES]


@pytest.mark.thorough("two runs")
def test_a_run_says_it_in_words_and_in_json(command: Command) -> None:
    words = ("run", "wall", "--drive", "generic_cia402", "--duration", "0.2")
    assert f"assumed    {TIMES}; not stated by the profile" in command(*words, "-v").out
    assert json.loads(command(*words, "--json").out)["plan"]["assumed"] == [TIMES]
