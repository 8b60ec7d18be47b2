"""Sentences of tests that passed, told at the end of a run: `record_property(TOLD, sentence)`."""

import pytest

TOLD = "told"


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Write what the tests told, those of other processes included."""
    for report in terminalreporter.stats.get("passed", []):
        for name, sentence in report.user_properties:
            if name == TOLD:
                terminalreporter.write_line(str(sentence))
