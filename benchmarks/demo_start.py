"""Time from `haptic-fieldbus demo` to its page: address, first rows with torque, and drawn by a headless Chromium.

`python benchmarks/demo_start.py STARTS`; default 3. Without Chromium the last figure is left out. Exit status 1 if the
shortest time to the rows, or to the picture, is above 10 s.
"""

import shutil
import sys
from pathlib import Path
from time import monotonic, sleep

from rows import machine

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

PROMISED = 10.0
"""[s]"""


def start(browse: bool) -> list[float]:
    """Start the demo once and return the times of its stages [s]."""
    from tests.view.served import chromium, serving
    from tests.view.test_server import begun, connected

    began = monotonic()
    with serving("demo", "--no-browser", "--port", "0") as served:
        times = [monotonic() - began]
        page = connected(served, "page")
        begun(page)
        times.append(monotonic() - began)
        page.close()
        if browse:
            with chromium() as browser:  # a person's browser is open already
                before = monotonic()
                browser.get(served.address)
                while not browser.execute_script("return window.haptic && haptic.pictures() > 0"):
                    sleep(0.01)
                times.append(times[0] + monotonic() - before)
    return times


def main() -> int:
    starts = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    browse = bool(shutil.which("chromium") and shutil.which("chromedriver"))
    print(machine())
    found = [start(browse) for _ in range(starts)]
    names = ("address printed", "first rows with torque", "drawn in an open browser")
    for name, times in zip(names, zip(*found, strict=True), strict=False):
        print(f"{name:24} {min(times):.1f} s, at most {max(times):.1f} s in {starts} starts")
    best = max(min(times) for times in list(zip(*found, strict=True))[1:])
    print(f"{best:.1f} s, at most {PROMISED:g} promised")
    return int(best > PROMISED)


if __name__ == "__main__":
    sys.exit(main())
