"""Checks of a CAN adapter, from what the system tells of it, and of the way to a drive and back.

Under Linux, /sys and `ip -details -json link show` know driver, state, bit rate and queue of a SocketCAN interface, and
the latency timer of a serial port. Everywhere else only the round trip can be measured.

Reference: Documentation/networking/can.rst of Linux.
"""

import json
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from haptic_fieldbus.buses.found import Check
from haptic_fieldbus.buses.usb_serial import SYS, latency_timer
from haptic_fieldbus.protocols.canopen.bus import CanSection

SHORTEST_QUEUE, ADVISED_QUEUE = 100, 1000
"""Transmit queue [frames]: below the first, a burst of SDO and PDO frames of some axes is refused."""
VIRTUAL = ("vcan", "vxcan")
HEALTHY = ("ERROR-ACTIVE",)
SERIAL = ("slcan", "serial", "robotell", "seeedstudio")
"""Interfaces of python-can whose channel is a serial port."""
Show = Callable[[str], str]
"""Function that returns what `ip` tells of an interface, as JSON; empty when it tells nothing."""


def shown_by_ip(channel: str) -> str:
    """Return the details of a network interface as `ip` prints them; empty without `ip`, or such an interface."""
    try:
        command = ["ip", "-details", "-json", "link", "show", channel]
        return subprocess.run(command, capture_output=True, text=True, check=False, timeout=5).stdout
    except (OSError, subprocess.TimeoutExpired):
        return ""


def adapter_checks(section: CanSection, root: Path = SYS, show: Show = shown_by_ip) -> Iterator[Check]:
    """Yield the checks of the adapter of a bus; those that do not apply to its interface are missing or None."""
    if section.interface == "socketcan":
        link = SocketCanLink(section, root, _details(show(section.channel)))
        yield from (link.driver(), link.state(), link.bit_rate(), link.queue())
    else:
        yield Check("driver", None, f"{section.interface}, by python-can")
        told = f"{section.bitrate} bit/s asked for; the adapter does not tell what it does"
        yield Check("bit_rate", None, told)
        yield Check("queue", None, f"{section.interface} tells no queue")
    yield _latency_timer(section, root)


@dataclass(frozen=True)
class SocketCanLink:
    """One SocketCAN interface, as the system describes it."""

    section: CanSection
    root: Path
    details: dict[str, Any]

    @property
    def _can(self) -> dict[str, Any]:
        found: dict[str, Any] = self.details.get("linkinfo", {}).get("info_data", {})
        return found

    @property
    def _virtual(self) -> bool:
        return self.details.get("linkinfo", {}).get("info_kind") in VIRTUAL

    def driver(self) -> Check:
        channel = self.section.channel
        folder = self.root / "class" / "net" / channel
        if not folder.exists():
            advice = f"there is no {channel}: plug the adapter in; its name is shown by: ip -details link show type can"
            return Check("driver", False, f"no interface {channel}", advice)
        name = (folder / "device" / "driver").resolve().name if (folder / "device" / "driver").exists() else "virtual"
        return Check("driver", True, name)

    def state(self) -> Check:
        """Check that the interface is up, and its controller takes part in the bus."""
        channel, flags = self.section.channel, self.details.get("flags", [])
        if not self.details:
            return Check(
                "state", None, "unknown: `ip` tells nothing", "install iproute2, so that the state can be read"
            )
        if "UP" not in flags:
            return Check("state", False, "down", f"bring it up: {_up(self.section, virtual=self._virtual)}")
        controller = self._can.get("state", "virtual" if self._virtual else "unknown")
        if controller in HEALTHY or self._virtual:
            return Check("state", True, f"up, {controller.lower()}")
        advice = (
            "frames are lost or not acknowledged: check that a second node has power and the same bit rate, CAN high "
            "and CAN low, and both 120 Ω terminators (60 Ω between the lines); then: "
            f"{_up(self.section, virtual=False)}"
        )
        return Check("state", False, f"up, {controller.lower()} ({channel})", advice)

    def bit_rate(self) -> Check:
        asked, found = self.section.bitrate, self._can.get("bittiming", {}).get("bitrate")
        if found is None:
            return Check("bit_rate", None, "none, a virtual bus has no bits" if self._virtual else "unknown")
        advice = "" if found == asked else f"set it: {_up(self.section, virtual=False)}"
        return Check("bit_rate", found == asked, f"{found} bit/s, {asked} asked for", advice)

    def queue(self) -> Check:
        channel = self.section.channel
        try:
            length = int((self.root / "class" / "net" / channel / "tx_queue_len").read_text(encoding="ascii"))
        except (OSError, ValueError):
            return Check("queue", None, "unknown")
        rule = f'ACTION=="add", SUBSYSTEM=="net", KERNEL=="{channel}", ATTR{{tx_queue_len}}="{ADVISED_QUEUE}"'
        advice = (
            f"lengthen it: ip link set {channel} txqueuelen {ADVISED_QUEUE}; for good, write {rule} into "
            "/etc/udev/rules.d/99-can.rules"
        )
        fits = length >= SHORTEST_QUEUE
        return Check("queue", fits, f"{length} frames", "" if fits else advice)


def _details(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text or "[]")
    except ValueError:
        return {}
    return found[0] if isinstance(found, list) and found and isinstance(found[0], dict) else {}


def _up(section: CanSection, *, virtual: bool) -> str:
    channel = section.channel
    if virtual:
        return f"ip link set {channel} up"
    return f"ip link set {channel} down; ip link set {channel} up type can bitrate {section.bitrate} restart-ms 100"


def _latency_timer(section: CanSection, root: Path) -> Check:
    if section.interface not in SERIAL:
        return Check("usb_latency_timer", None, "none, the bus is on no serial port")
    return latency_timer(section.channel.split("@")[0], root)
