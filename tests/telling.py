"""The end of a run: what tests that passed told by `record_property(TOLD, sentence)`, and missing packages."""

import re

import pytest

TOLD = "told"
MISSING = re.compile(r"apt-get install (?:--\S+ )*([a-z0-9][a-z0-9+.-]+(?: [a-z0-9][a-z0-9+.-]+)*)")
"""How the reason of a skip names the packages of the system that the test needs."""


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Write what the tests told, those of other processes included, and each missing package once."""
    for report in terminalreporter.stats.get("passed", []):
        for name, sentence in report.user_properties:
            if name == TOLD:
                terminalreporter.write_line(str(sentence))
    missing = [each[1].split() for report in terminalreporter.stats.get("skipped", []) if (each := _missing(report))]
    if missing:
        packages = " ".join(sorted({package for each in missing for package in each}))
        terminalreporter.write_line(
            f"packages are missing for {len(missing)} skipped tests: apt-get install {packages}"
        )


def _missing(report: pytest.TestReport) -> re.Match[str] | None:
    return MISSING.search(str(report.longrepr))
