"""Programs and modules that the guest kernel needs, and the Debian packages that bring them."""

import platform
import shutil
from pathlib import Path

from haptic_fieldbus.errors import VcanError

KERNEL = "linux.uml"
PROGRAMS = {KERNEL: "user-mode-linux", "insmod": "kmod", "ip": "iproute2"}
"""Program → package. What else the guest calls is on every Debian: coreutils, util-linux, a POSIX shell."""
MODULES = Path("/usr/lib/uml/modules")
SYSTEM_FOLDERS = ("/usr/local/sbin", "/usr/sbin", "/sbin")
"""Not on the PATH of ordinary users, but on that of the guest."""
PROCESSORS = ("x86_64", "i386", "i486", "i586", "i686")


def program(name: str) -> str | None:
    """Path of a program, also of one that is meant for root."""
    return shutil.which(name) or shutil.which(name, path=":".join(SYSTEM_FOLDERS))


def require_guest() -> None:
    """Raise VcanError, with a command that helps, when no guest kernel can be started here."""
    if platform.system() != "Linux" or platform.machine() not in PROCESSORS:
        raise VcanError(
            f"no vcan on this machine, and User-Mode Linux runs on Linux on x86 only, not on {platform.system()} "
            f"on {platform.machine()}; as root, load the module by: modprobe vcan"
        )
    missing = {name: package for name, package in PROGRAMS.items() if program(name) is None}
    if missing:
        raise VcanError(
            f"no vcan on this machine, and no guest kernel without {', '.join(missing)}; either, as root, "
            f"modprobe vcan and ip link add vcan0 type vcan, or: apt-get install {' '.join(PROGRAMS.values())}"
        )
    if not any(MODULES.glob("*/kernel/drivers/net/can/vcan.ko*")):
        raise VcanError(
            f"no vcan on this machine, and {program(KERNEL)} has no module vcan in {MODULES}; "
            "the one of Debian's package user-mode-linux has: apt-get install --reinstall user-mode-linux"
        )
