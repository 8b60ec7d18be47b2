"""A drive that offers velocity only, for tests: the generic profile with 606Ch in the place of 6064h."""

import re
from pathlib import Path

from haptic_fieldbus.protocols.catalogue import profile_folder

SECTION = '[velocity]\nactual = {{ object = 0x606C, type = "int32", unit = "{unit}" }}\n'


def velocity_only(folder: Path, unit: str = "rpm", *, position: bool = False) -> Path:
    """The file of such a profile; with `position` it keeps that too."""
    text = (profile_folder() / "generic_cia402.toml").read_text(encoding="utf-8")
    kept = r"\g<0>" if position else ""
    text = re.sub(r"\[position\]\nactual = \{.*\}\n", kept + SECTION.format(unit=unit), text)
    source = '"velocity.actual" = "CiA 402-2, 606Ch"\n'
    text = re.sub(r'"position.actual" = .*\n', kept + source, text)
    path = folder / "velocity_only.toml"
    path.write_text(text, encoding="utf-8")
    return path
