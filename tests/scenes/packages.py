"""Packages that add elements, written where a test wants them."""

from pathlib import Path

CLASS = """
from dataclasses import dataclass
from typing import ClassVar
from haptic_fieldbus.numerics.linear import gain
from haptic_fieldbus.scenes.element import STRICT, Stiffness
from haptic_fieldbus.signals import Signal

@dataclass(frozen=True)
class Own:
    axis: str
    stiffness: Stiffness
    name: str = "own"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self):
        return (Signal.POSITION,)

    def force(self, position):
        return -self.stiffness * position

    def linearised(self):
        return gain([[-self.stiffness, 0.0]])
"""
"""The text of a module with an element that holds."""


def install(
    folder: Path, package: str, entry_points: str, module: str = CLASS, group: str = "haptic_fieldbus.elements"
) -> None:
    """Put a package of one module, and the metadata by which it is found, into a folder of the path."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[{group}]\n{entry_points}\n")
    (folder / f"{package}.py").write_text(module)
