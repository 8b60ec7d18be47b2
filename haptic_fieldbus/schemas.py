"""Write the JSON Schemas of profiles, buses, rigs and scenes into a folder.

`python -m haptic_fieldbus.schemas FOLDER`
"""

import json
import sys
from pathlib import Path

from haptic_fieldbus.protocols.catalogue import bus_schema, profile_schema, rig_schema
from haptic_fieldbus.protocols.registry import BUILT_IN
from haptic_fieldbus.scenes.catalogue import scene_schema

DIALECT = "https://json-schema.org/draft/2020-12/schema"


def schema_texts() -> dict[str, str]:
    """Return the text of each schema by the name of its file."""
    schemas = {"rig": rig_schema(), "scene": scene_schema()}
    for name in BUILT_IN:
        schemas |= {f"profile.{name}": profile_schema(name), f"bus.{name}": bus_schema(name)}
    return {
        f"{name}.schema.json": json.dumps({"$schema": DIALECT} | schema, indent=2, ensure_ascii=False) + "\n"
        for name, schema in schemas.items()
    }


def main(arguments: list[str]) -> int:
    """Write the schemas into the folder given as the only argument; return the exit code, 2 for wrong usage."""
    if len(arguments) != 1:
        print("usage: python -m haptic_fieldbus.schemas FOLDER", file=sys.stderr)
        return 2
    folder = Path(arguments[0])
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in schema_texts().items():
        (folder / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
