"""Tests marked `vcan` have real SocketCAN: of this machine, else together in one guest kernel, else they are skipped.

Such a test takes the fixtures `vcan` and `second_vcan` of conftest.py. In a guest they run in a pytest of its own, as
`haptic-fieldbus vcan --guest -- python -m pytest` starts it, whose reports become those of this one, with the text of
each failure. They are one group of xdist, for a guest takes seconds to begin.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

GROUP = "vcan"
INTERFACES = ("vcan0", "vcan1")
TIME_LIMIT_S = 3600.0
"""Of all tests in the guest together; a hang ends there."""
REPORTS_OPTION = "--vcan-reports"
Reports = dict[str, list[dict[str, object]]]
"""By node-ID, as pytest serialises them."""


class Vcan:
    """Hooks of a process that runs tests."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._lent = ExitStack()
        self._host: bool | None = None
        self._reports: Reports | None = None
        self._why = ""

    @pytest.hookimpl(tryfirst=True)  # later, xdist adds the names of groups to the node-IDs
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        for item in items:
            if item.get_closest_marker("vcan"):
                item.add_marker(pytest.mark.xdist_group(GROUP), append=False)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
        """Replace what pytest would do with a test that runs in the guest."""
        if not item.get_closest_marker("vcan") or self._on_host():
            return None
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in self._from_guest(item):
            report.nodeid = item.nodeid
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        # What the test before it has left for others of its module is torn down when this was the last one.
        item.session._setupstate.teardown_exact(nextitem)
        return True

    def pytest_sessionfinish(self) -> None:
        self._lent.close()

    def _on_host(self) -> bool:
        """Whether this kernel has the interfaces; those that it has to make are there until the end of the session."""
        from haptic_fieldbus.vcan import runner

        if self._host is None:
            self._host = self._lent.enter_context(runner.lent(INTERFACES))
            if not self._host:
                self._lent.close()
        return self._host

    def _from_guest(self, item: pytest.Item) -> Iterator[pytest.TestReport]:
        """Reports of a test; one that says why when it was not run."""
        from haptic_fieldbus.errors import VcanError
        from haptic_fieldbus.vcan import runner as guest

        try:
            guest.require_guest()
        except VcanError as error:
            yield not_run(item, "skipped", f"Skipped: {error}")
            return
        if self._reports is None:
            names = [node_id(each) for each in item.session.items if each.get_closest_marker("vcan")]
            self._reports, self._why = in_guest(self._config, names)
        done = self._reports.get(node_id(item), [])
        for data in done:
            if isinstance(data["longrepr"], list):  # of a skipped test; JSON knows no tuples
                data["longrepr"] = tuple(data["longrepr"])
            report = self._config.hook.pytest_report_from_serializable(config=self._config, data=data)
            assert isinstance(report, pytest.TestReport)
            yield report
        if not done or done[-1]["when"] != "teardown":
            yield not_run(item, "failed", f"did not end in the guest kernel, which said:\n{self._why}")


class Writer:
    """Writes reports of tests to a file, a line each."""

    def __init__(self, config: pytest.Config, path: Path) -> None:
        self._config = config
        self._file = path.open("w")

    @pytest.hookimpl(trylast=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        data = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        print(json.dumps(data), file=self._file, flush=True)

    def pytest_unconfigure(self) -> None:
        self._file.close()


def node_id(item: pytest.Item) -> str:
    """Without the names of groups that xdist adds."""
    name, at, groups = item.nodeid.rpartition("@")
    return name if at and "]" not in groups else item.nodeid


def not_run(item: pytest.Item, outcome: str, why: str) -> pytest.TestReport:
    """Report of a test that was not run."""
    path, line, _ = item.location
    text = (path, line or 0, why) if outcome == "skipped" else why
    return pytest.TestReport(item.nodeid, item.location, {}, outcome, text, "setup")  # type: ignore[arg-type]


def in_guest(config: pytest.Config, names: Sequence[str]) -> tuple[Reports, str]:
    """Run tests in a guest kernel: their reports, and all that was printed there."""
    with tempfile.TemporaryDirectory(prefix="haptic-fieldbus-reports-") as folder:
        file, arguments = Path(folder) / "reports.jsonl", Path(folder) / "arguments"
        arguments.write_text("\n".join(names))
        interfaces = [word for name in INTERFACES for word in ("--interface", name)]
        python = [sys.executable, "-m"]
        runner = [*python, "haptic_fieldbus", "vcan", "--guest", *interfaces, "--out", folder]
        inside = [*python, "pytest", "-p", "no:cacheprovider", "--lane", "all", REPORTS_OPTION, str(file)]
        process = subprocess.run(
            [*runner, "--time-limit", str(TIME_LIMIT_S), "--", *inside, f"@{arguments}"],
            cwd=config.rootpath,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST_")},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        lines = file.read_text().splitlines() if file.exists() else []
    reports: Reports = {}
    for line in lines:
        data = json.loads(line)
        reports.setdefault(data["nodeid"], []).append(data)
    return reports, f"{process.stdout[-4000:]}(exit status {process.returncode})"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("lanes").addoption(REPORTS_OPTION, type=Path, help="write reports of tests here, a line each")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Vcan(config))
    path: Path | None = config.getoption(REPORTS_OPTION)
    if path is not None:
        config.pluginmanager.register(Writer(config, path))
