"""Write the JSON Schemas of all files that people write into a folder.

`python -m haptic_fieldbus.schemas FOLDER`; with `--shipped` a scene has no elements of other packages.
"""

import json
import sys
from pathlib import Path

from haptic_fieldbus.documents import schema_of
from haptic_fieldbus.protocols.catalogue import bus_schema, profile_schema, rig_schema
from haptic_fieldbus.protocols.registry import BUILT_IN
from haptic_fieldbus.scenes.catalogue import scene_schema
from haptic_fieldbus.sim.faults import FaultFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
SHIPPED = "--shipped"


def schema_texts(*, own: bool = False) -> dict[str, str]:
    """Return the text of each schema by the name of its file; with `own`, scenes have added elements too."""
    schemas = {"rig": rig_schema(), "scene": scene_schema(own=own), "faults": schema_of(FaultFile)}
    for name in BUILT_IN:
        schemas |= {f"profile.{name}": profile_schema(name), f"bus.{name}": bus_schema(name)}
    return {
        f"{name}.schema.json": json.dumps({"$schema": DIALECT} | schema, indent=2, ensure_ascii=False) + "\n"
        for name, schema in schemas.items()
    }


def main(arguments: list[str]) -> int:
    """Write the schemas into the folder that is given; return the exit code, 2 for wrong usage."""
    folders = [each for each in arguments if each != SHIPPED]
    if len(folders) != 1:
        print(f"usage: python -m haptic_fieldbus.schemas FOLDER [{SHIPPED}]", file=sys.stderr)
        return 2
    folder = Path(folders[0])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_texts(own=SHIPPED not in arguments).items():
        (folder / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
