"""Write the golden texts anew, and remove those left over.

What `plan` says of each library scene and of each profile, and what each scene leaves out. `python -m tests.golden`
writes them; read the difference before you commit it.
"""

from collections.abc import Mapping
from pathlib import Path

from haptic_fieldbus.scenes.catalogue import scene_names
from tests.golden import left_out, plans


def write(texts: Mapping[Path, str]) -> None:
    """Write each text to its file; no other text stays in their folders."""
    for folder in {path.parent for path in texts}:
        folder.mkdir(exist_ok=True)
        for path in set(folder.glob("*.txt")) - set(texts):
            path.unlink()
    for path, text in texts.items():
        path.write_text(text, encoding="utf-8")


write({path: plans.text_of(*case) for path, case in plans.cases().items()})
write({left_out.FOLDER / f"{scene}.txt": left_out.text_of(scene) for scene in scene_names()})
