"""A virtual CAN interface as a test handles it."""

import subprocess
from dataclasses import dataclass

import pytest

from haptic_fieldbus.vcan import runner


@dataclass(frozen=True)
class Link:
    """An interface by its name; python-can opens it by `interface="socketcan", channel=link.name`."""

    name: str

    @property
    def bus(self) -> str:
        """As `--bus` takes it."""
        return f"socketcan:{self.name}"

    @property
    def is_up(self) -> bool:
        return runner.is_up(self.name)

    def down(self) -> None:
        """As when a cable is pulled; a test that may not do so here is skipped."""
        self._set("down")

    def up(self) -> None:
        self._set("up")

    def _set(self, *words: str) -> None:
        done = subprocess.run(["ip", "link", "set", self.name, *words], capture_output=True, text=True, check=False)
        if "not permitted" in done.stderr:
            pytest.skip(f"this user must not set {self.name} {' '.join(words)}")
        done.check_returncode()
