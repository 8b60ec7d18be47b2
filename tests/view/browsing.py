"""Acts at a page in a browser, and waits for its answers."""

from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from tests.view.served import Served

PATIENCE = 120
"""Time in which anything that is waited for happens on a loaded machine [s]."""


Page = tuple[webdriver.Chrome, Served, Path]


def screen(browser: webdriver.Chrome, width: int, height: int) -> None:
    size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def until(browser: webdriver.Chrome, script: str) -> Any:
    """Wait until an expression of the page is true, and return it."""

    def holds(_: webdriver.Chrome) -> Any:
        return browser.execute_script(f"try {{ return {script}; }} catch (error) {{ return null; }}")

    return WebDriverWait(browser, PATIENCE, 0.1).until(holds)


def opened(browser: webdriver.Chrome, served: Served) -> None:
    browser.get(served.address)
    until(browser, "haptic.rows().length > 100 && haptic.drawn[haptic.state().hello.axes[0].name].t_ns > 0")


def typed(browser: webdriver.Chrome, name: str, value: str) -> None:
    field = browser.find_element(By.CSS_SELECTOR, f"input[aria-label='{name}']")
    field.send_keys(Keys.CONTROL, "a")
    field.send_keys(value, Keys.TAB)


STANDING = """
const done = arguments[0];
const asked = () => new Promise((answered) => {
  document.getElementById("answer").textContent = "";
  haptic.send({ change: { "no.parameter": 1 } });
  const there = () => document.getElementById("answer").textContent;
  const look = () => (there() ? requestAnimationFrame(answered) : setTimeout(look, 5));
  look();
});
(async () => {
  let before = -1;
  while (before !== haptic.state().next) { before = haptic.state().next; await asked(); await asked(); }
  done(haptic.state().next);
})();
"""
"""Number of the next row of a run that stands still. Answers of the run come in order with the rows, so two of them
without a row between show that none is on its way."""


WRITTEN = """
const pen = CanvasRenderingContext2D.prototype, write = pen.fillText, clear = pen.fillRect;
window.written = new Map();
pen.fillRect = function (x, y, wide, high) {
  if (x === 0 && y === 0 && wide === this.canvas.clientWidth) window.written.set(this.canvas, []);
  clear.call(this, x, y, wide, high);
};
pen.fillText = function (text, x, y) {
  const wide = this.measureText(text).width, left = { right: x - wide, center: x - wide / 2 }[this.textAlign] ?? x;
  if (window.written.has(this.canvas)) window.written.get(this.canvas).push([text, left, left + wide, y]);
  write.call(this, text, x, y);
};
"""
"""Notes each word on a canvas since it was last cleared, with its left and right end and its base line."""
