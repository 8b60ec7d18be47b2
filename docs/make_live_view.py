"""The moving picture of the live page: `python docs/make_live_view.py` films it in a headless Chromium.

The run is a simulation whose time goes on by one picture at a time, and the clock of the page goes with it. The film is
therefore the same on each computer but for its fonts. The file tells as text what it shows: the words on the page and
the places of handle and pointer in each picture. It is written again only where that has changed.
"""

import contextlib
import io
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from time import monotonic, sleep
from typing import Any

from PIL import Image
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

PROJECT = Path(__file__).parents[1]
sys.path.insert(0, str(PROJECT))  # the package of this checkout, not an installed one

from haptic_fieldbus.api import run  # noqa: E402
from haptic_fieldbus.clock import VirtualClock  # noqa: E402
from haptic_fieldbus.running.leading import SimulatedTime  # noqa: E402
from haptic_fieldbus.running.live import Live  # noqa: E402
from haptic_fieldbus.view.description import describe  # noqa: E402

FILE = Path(__file__).parent / "images" / "live_view.webp"
SCREEN, SHOWN = (1280, 800), (960, 600)
"""Sizes of the page, and of the film [pixels]."""
FRAME = 0.1
"""Time from one picture to the next [s]."""
BEGIN = 1.5
"""Time before the first picture, in which the torque is enabled [s]."""
PUSHED, AWAY = 0.036, -0.02
"""Places of the pointer [m]."""
SCRIPT: dict[int, tuple[str, Any]] = {
    **{4 + number: ("pull", PUSHED * number / 8) for number in range(9)},
    **{22 + number: ("pull", PUSHED + (AWAY - PUSHED) * number / 6) for number in range(7)},
    32: ("change", 200.0),
    **{40 + number: ("pull", AWAY + (PUSHED - AWAY) * number / 8) for number in range(9)},
    58: ("pull", None),
}
"""Acts of the person at the page before a picture: the wall is touched, made softer, and touched again."""
FRAMES = 70
DURATION_NS = 20_000_000_000
"""Time after which a run ends that nobody films any more."""
QUALITY = 60
PATIENCE = 120.0
"""Longest time for one picture [s]."""
CLOCK = "let at = 0; performance.now = () => at; window.advance = (by) => { at += by; };"
UNSEEN = (
    "for (const each of [document.getElementById('fact-pictures')]) { each.previousSibling.remove(); each.remove(); }"
)
"""Takes away the one thing that depends on the computer: pictures a second."""
WORDS = """return {
  texts: [...document.querySelectorAll("h1, h2, dt, dd, label, #state, #time, #answer, .limit, .scale")]
    .map((each) => each.textContent.trim()).filter((each) => each),
  handle: ["position", "asked", "given"].map((name) => Number(haptic.drawn.handle[name].toPrecision(3))),
  x: Math.round(haptic.drawn.handle.x),
};"""


class FilmTime(SimulatedTime):
    """Time that goes on up to `until_ns`."""

    until_ns = 0
    stands_at_ns = 0
    """The last `until_ns` that was reached."""

    def sleep_until(self, deadline_ns: int) -> int:
        while deadline_ns > (until_ns := self.until_ns) and not self.leaving():
            self.stands_at_ns = until_ns
            sleep(0.001)
        return VirtualClock.sleep_until(self, deadline_ns)


@contextmanager
def chromium() -> Iterator[webdriver.Chrome]:
    binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not (binary and driver):
        sys.exit("needs: apt-get install chromium chromium-driver")
    options = Options()
    for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
        options.add_argument(argument)
    options.binary_location = binary
    browser = webdriver.Chrome(options=options, service=Service(driver))
    try:
        yield browser
    finally:
        browser.quit()


def wait(holds: Callable[[], Any]) -> None:
    """Wait until something holds; raises TimeoutError."""
    end = monotonic() + PATIENCE
    while not holds():
        if monotonic() > end:
            raise TimeoutError("the page does not follow")
        sleep(0.005)


class Film:
    """The pictures of one run, and what each shows."""

    def __init__(self, live: Live, browser: webdriver.Chrome) -> None:
        self.live, self.browser, self.time = live, browser, FilmTime()
        live.time = self.time
        self.pictures: list[Image.Image] = []
        self.shown: list[dict[str, Any]] = []

    def make(self, address: str) -> None:
        """Film the run, which another thread makes, and stop it."""
        width, height = SCREEN
        self.browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": CLOCK})
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        self.browser.get(address)
        wait(lambda: self.ask("window.haptic && haptic.state().hello && haptic.state().steers"))
        self.browser.execute_script(UNSEEN)
        self.go_on(BEGIN)
        for number in range(FRAMES):
            if number in SCRIPT:
                self.act(*SCRIPT[number])
            self.go_on(FRAME)
            self.shown.append(self.browser.execute_script(WORDS))
            with Image.open(io.BytesIO(self.browser.get_screenshot_as_png())) as picture:
                self.pictures.append(picture.convert("RGB").resize(SHOWN, Image.Resampling.LANCZOS))
        self.browser.execute_script("haptic.stop()")

    def ask(self, expression: str) -> Any:
        return self.browser.execute_script(f"return {expression};")

    def act(self, what: str, value: Any) -> None:
        """Do what a person does, and wait until the run knows it."""
        if what == "pull":
            self.browser.execute_script("haptic.pull('handle', arguments[0])", value)
            leading = self.live._leading
            assert leading is not None
            wait(lambda: value in (leading._asked.get("handle"), leading._pulls.get("handle")))
        else:
            self.browser.execute_script("haptic.change('wall.stiffness', arguments[0])", value)
            wait(lambda: self.ask("haptic.state().hello.parameters[0].value") == value)

    def go_on(self, seconds: float) -> None:
        """Let time go on, and the page draw it."""
        self.time.until_ns += round(seconds * 1e9)
        wait(lambda: self.time.stands_at_ns == self.time.until_ns)
        ring = self.live.ring
        wait(lambda: ring is not None and self.ask("haptic.state().next") == ring.pushed)
        self.browser.execute_script("advance(arguments[0]); dispatchEvent(new Event('resize'))", 1e3 * seconds + 1.0)
        self.browser.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")


@contextmanager
def served(live: Live) -> Iterator[str]:
    """Serve the page of a run by a process of its own, and yield its address."""
    words = [sys.executable, "-m", "haptic_fieldbus", "view", "--run", live.path.stem, "--port", "0"]
    with subprocess.Popen(words, cwd=PROJECT, stderr=subprocess.PIPE, text=True) as server:
        try:
            yield server.stderr.readline().split()[-1] if server.stderr else ""
        finally:
            server.terminate()


def filmed() -> Film:
    """Film the page of a wall that is touched with the mouse."""
    with chromium() as browser, Live(describe) as live, served(live) as address:
        film, wrong = Film(live, browser), list[BaseException]()

        def work() -> None:
            try:
                film.make(address)
            except BaseException as error:
                wrong.append(error)
                film.time.until_ns = DURATION_NS

        thread = Thread(target=work)
        thread.start()
        run("wall", hand="none", duration=1e-9 * DURATION_NS, live=live)
        thread.join()
    if wrong:
        raise wrong[0]
    return film


def content(path: Path) -> Any:
    """Return what a film tells that it shows; None for a file that tells nothing."""
    with contextlib.suppress(OSError, KeyError), Image.open(path) as film:
        return json.loads(film.info["xmp"])
    return None


def save(film: Film, path: Path) -> None:
    """Write a film with what it shows."""
    first, *others = film.pictures
    first.save(
        path, save_all=True, append_images=others, duration=round(1e3 * FRAME), loop=0, quality=QUALITY, method=6,
        xmp=json.dumps(film.shown).encode(),
    )  # fmt: skip


def main() -> None:
    film = filmed()
    if content(FILE) != film.shown:
        save(film, FILE)
    print(FILE)


if __name__ == "__main__":
    main()
