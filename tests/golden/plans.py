"""The golden texts of plans: which there are, and how one is made."""

from itertools import product
from pathlib import Path

from haptic_fieldbus.api import plan
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.scenes.catalogue import scene_names
from tests.velocity_only import velocity_only

FOLDER = Path(__file__).parent


def cases() -> list[tuple[str, str]]:
    """Every library scene on every profile that can render force over CAN."""
    usable = [name for name in profile_names() if load_profile(name).drive.usable]
    return list(product(scene_names(), usable))


def text_of(scene: str, profile: str) -> str:
    return explain(plan(scene, drive=profile)) + "\n"


def velocity_only_text(folder: Path) -> str:
    """A scene on a drive that offers velocity only; its profile is written into the folder."""
    return text_of("damped_wall", str(velocity_only(folder)))
