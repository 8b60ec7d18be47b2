"""A browser, and a page of a run in it."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver

from tests.view.browsing import Page, opened, screen
from tests.view.served import chromium, serving


@pytest.fixture
def browser() -> Iterator[webdriver.Chrome]:
    with chromium() as found:
        yield found
        assert [entry["message"] for entry in found.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.fixture
def page(browser: webdriver.Chrome, tmp_path: Path) -> Iterator[Page]:
    record = tmp_path / "run.csv"
    with serving("run", "wall", "--view", "--view-port", "0", "--hand", "none", "--record", str(record)) as served:
        screen(browser, 1280, 800)
        opened(browser, served)
        yield browser, served, record
