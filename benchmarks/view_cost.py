"""Cost of a view in the loop: the row in the ring and the values of the run, beside the row of any record.

Nobody reads in the first row; in the second one another process maps the ring and copies new rows 60 times a second.
"""

import subprocess
import sys

from rows import Row, cost, show

from haptic_fieldbus.api import plan
from haptic_fieldbus.assessing.loop_report import LoopReport, Record
from haptic_fieldbus.cycle.cycle import Cycle, columns
from haptic_fieldbus.running.ending import EndSignals
from haptic_fieldbus.running.live import Live

ROWS = 20_000
READER = """
import sys
from time import sleep
from haptic_fieldbus.running.ring import RingReader
ring, first = RingReader(int(sys.argv[1])), 0
while True:
    sleep(1 / 60)
    first += len(ring.since(first)[1])
"""


def main() -> None:
    found = plan("wall")
    row = tuple(float(number) for number in range(len(columns(found))))
    plain, cycle, report = Record(columns(found), ROWS), Cycle(found), LoopReport()
    with Live(lambda *_: {}) as live:
        record = Record(columns(found), ROWS)
        live.follow(found, record)
        live.begin(found, cycle, report, None, EndSignals())
        alone = Row("nobody looks", cost(lambda: record.push(row), 2000, 60), cost(lambda: plain.push(row), 2000, 60))
        assert live.ring is not None
        fd = live.ring.fd
        with subprocess.Popen([sys.executable, "-c", READER, str(fd)], pass_fds=[fd]) as reader:
            looked = Row("a page looks", cost(lambda: record.push(row), 2000, 60), alone.reference)
            reader.terminate()
    show([alone, looked])
    print(f"more in a period: {1e6 * (alone.ours - alone.reference):.2f} µs, at most 3 promised")


if __name__ == "__main__":
    main()
