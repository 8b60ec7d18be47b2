"""A run with its page, as a user begins it: processes of their own, found by the address that they print."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
GROWTH = 20_000_000
"""Largest growth of a server under attack [octets]."""
ADDRESS = re.compile(r"http://\S+")


@dataclass
class Served:
    """A command that serves a page."""

    process: "subprocess.Popen[str]"
    address: str

    @property
    def port(self) -> int:
        return urlsplit(self.address).port or 0

    @property
    def origin(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    @property
    def token(self) -> str:
        return self.address.partition("token=")[2]

    def ended(self) -> tuple[int, str, str]:
        """Wait for the end; return exit status, standard output and standard error."""
        out, err = self.process.communicate(timeout=120)
        return self.process.returncode, out, err


@contextmanager
def serving(*arguments: str, port: int | None = None) -> Iterator[Served]:
    """Run a command in the block, and end it after it; `port` is that of its bus on UDP multicast."""
    words = [sys.executable, "-m", "haptic_fieldbus", *arguments]
    wire = {} if port is None else {"CAN_CONFIG": f'{{"port": {port}}}'}
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, **wire}
    ) as process:
        try:
            assert process.stderr is not None
            told = ""
            while not (found := ADDRESS.search(told)):
                line = process.stderr.readline()
                assert line, f"no address: {told}"
                told += line
            yield Served(process, found[0])
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
            process.communicate(timeout=120)


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    found = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                with open(f"/proc/{entry}/stat", encoding="utf-8") as file:
                    parent = int(file.read().rpartition(")")[2].split()[1])
            except OSError:
                continue
            found += [int(entry)] if parent == pid else []
    return found


def descendants(pid: int) -> list[int]:
    """Return the processes that a process, and those that it has started, have started."""
    found = children(pid)
    return [*found, *(each for child in found for each in descendants(child))]


@contextmanager
def chromium() -> Iterator[webdriver.Chrome]:
    """Start a headless browser for the block."""
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    options.binary_location = str(CHROMIUM)
    found = webdriver.Chrome(options=options, service=Service(DRIVER))
    try:
        yield found
    finally:
        found.quit()


def memory_of(pid: int) -> int:
    """Return the resident memory of a process [octets]."""
    text = Path(f"/proc/{pid}/status").read_text(encoding="utf-8")
    return 1024 * int(text.partition("VmRSS:")[2].split()[0])
