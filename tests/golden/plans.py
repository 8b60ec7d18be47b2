"""The golden texts of plans: which there are, and how one is made.

Every library scene stands on one profile, and every other profile carries one scene: a new scene adds a text, and a new
drive adds one.
"""

from functools import cache
from pathlib import Path

from haptic_fieldbus.api import plan
from haptic_fieldbus.planning.explain import explain
from haptic_fieldbus.planning.plan import Plan
from haptic_fieldbus.protocols.catalogue import load_profile, profile_names
from haptic_fieldbus.protocols.registry import protocol_named
from haptic_fieldbus.scenes.catalogue import scene_names

FOLDER = Path(__file__).parent
SCENES, PROFILES = FOLDER / "scenes", FOLDER / "profiles"
REFERENCE_PROFILE = "generic_cia402"
"""It holds what the standards say, so no figure of a vendor's drive, measured anew, touches the texts of all scenes."""
REFERENCE_SCENE = "damped_wall"
"""It asks for position and velocity, so its text shows how a drive gives each of them."""


def further_profiles() -> list[str]:
    """Every other profile that can render force; the reference profile's own text is that of the reference scene."""
    return [name for name in profile_names() if load_profile(name).drive.usable and name != REFERENCE_PROFILE]


def cases() -> dict[Path, tuple[str, str]]:
    """The scene and the profile of each text, by its file."""
    scenes = {SCENES / f"{scene}.txt": (scene, REFERENCE_PROFILE) for scene in scene_names()}
    profiles = {PROFILES / f"{profile}.txt": (REFERENCE_SCENE, profile) for profile in further_profiles()}
    return scenes | profiles


@cache
def planned(scene: str, profile: str) -> Plan:
    """The plan of a scene on a profile, made once."""
    drive = load_profile(profile)
    return plan(scene, drive=profile, bus=protocol_named(drive.drive.protocol).simulated_bus(drive))


def text_of(scene: str, profile: str) -> str:
    """The golden text of a scene on a profile."""
    return explain(planned(scene, profile)) + "\n"
