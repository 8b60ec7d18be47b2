"""Running the command line inside the test's process."""

import pytest

from haptic_fieldbus.cli import main
from tests.cli.command import Command, FinalState
from tests.number_style import strange_numbers


@pytest.fixture
def command(capsys: pytest.CaptureFixture[str]) -> Command:
    """Call it with the words of a command line; what it tells people has no number in a style of its own."""

    def call(*words: object) -> FinalState:
        with pytest.raises(SystemExit) as stopped:
            main([str(word) for word in words])
        code = stopped.value.code
        captured = capsys.readouterr()
        assert strange_numbers(captured.err if "--json" in words else captured.out + captured.err) == []
        return FinalState(code if isinstance(code, int) else 0, captured.out, captured.err)

    return call
