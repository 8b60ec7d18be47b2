"""Share of a core that the server of a page takes, and pictures a second that the page draws, on a run at 1 kHz.

First a page without pictures, which acknowledges at once: the server alone. Then a headless Chromium, if there is one,
which shares the processors with run and server. `python benchmarks/view_server.py SECONDS`; default 10.
"""

import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep

import websocket
from rows import machine
from selenium import webdriver
from selenium.webdriver.chrome.options import Options
from selenium.webdriver.chrome.service import Service

SETTLING = 3.0
"""Time before the measurement, in which the page is built [s]."""


def processor_time(pid: int) -> float:
    """Return the processor time that a process has taken [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def server_of(run: int) -> int:
    """Return the process that the run has started."""
    return int(Path(f"/proc/{run}/task/{run}/children").read_text(encoding="utf-8").split()[0])


def plain(address: str, seconds: float) -> float:
    """Take pictures for some time; return how many came in a second."""
    host, _, token = address.removeprefix("http://").partition("/?token=")
    page = websocket.create_connection(
        f"ws://{host}/stream?client=x&token={token}", origin=f"http://{host}", timeout=60
    )
    pictures, end = 0, monotonic() + seconds
    while monotonic() < end:
        if isinstance(page.recv(), bytes):
            pictures += 1
            page.send('{"ack": 1}')
    page.close()
    return pictures / seconds


def drawn(browser: webdriver.Chrome, seconds: float) -> float:
    """Count the pictures that a page draws in a second."""
    count = "return haptic.pictures();"
    before, began = browser.execute_script(count), monotonic()
    sleep(seconds)
    return float((browser.execute_script(count) - before) / (monotonic() - began))


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    words = [sys.executable, "-m", "haptic_fieldbus", "demo", "--no-browser", "--port", "0"]
    print(machine())
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as run:
        address = next(word for line in run.stderr or () for word in line.split() if word.startswith("http"))
        server = server_of(run.pid)
        plain(address, SETTLING)
        before, began = processor_time(server), monotonic()
        pictures = plain(address, seconds)
        share = (processor_time(server) - before) / (monotonic() - began)
        print(f"server alone: {100 * share:.1f} % of a core at {pictures:.0f} pictures a second, at most 15 % promised")
        binary, driver = shutil.which("chromium"), shutil.which("chromedriver")
        if binary and driver:
            options = Options()
            for argument in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
                options.add_argument(argument)
            options.binary_location = binary
            with webdriver.Chrome(options=options, service=Service(driver)) as browser, suppress(KeyboardInterrupt):
                browser.get(address)
                sleep(SETTLING)
                before, began = processor_time(server), monotonic()
                pictures = drawn(browser, seconds)
                share = (processor_time(server) - before) / (monotonic() - began)
                print(
                    f"with a browser: {100 * share:.1f} % of a core, {pictures:.0f} pictures a second drawn, "
                    "at least 30 promised"
                )
        run.terminate()


if __name__ == "__main__":
    main()
