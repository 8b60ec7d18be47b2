"""The latency timer of a USB serial adapter: the time for which an FTDI chip holds back what it received.

Reference: AN232B-04 of FTDI.
"""

from pathlib import Path

from haptic_fieldbus.buses.found import Check

SYS = Path("/sys")
LONGEST_LATENCY = 1
"""[ms]; it is 16 after plugging in."""


def latency_timer(port: str, root: Path = SYS) -> Check:
    """Check the latency timer of a serial port, given by name or path; `root` is the folder of sysfs."""
    name = Path(port).name
    file = root / "bus" / "usb-serial" / "devices" / name / "latency_timer"
    try:
        milliseconds = int(file.read_text(encoding="ascii"))
    except (OSError, ValueError):
        return Check("usb_latency_timer", None, f"{name} has none")
    rule = 'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
    advice = f"shorten it: echo 1 > {file}; for good, write {rule} into /etc/udev/rules.d/99-can.rules"
    fits = milliseconds <= LONGEST_LATENCY
    return Check("usb_latency_timer", fits, f"{milliseconds} ms", "" if fits else advice)
