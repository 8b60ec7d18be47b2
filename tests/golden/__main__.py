from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_fieldbus.scenes.catalogue import scene_names
from tests.golden import left_out, plans

for scene, profile in plans.cases():
    (plans.FOLDER / f"plan_{scene}_{profile}.txt").write_text(plans.text_of(scene, profile), encoding="utf-8")
left_out.FOLDER.mkdir(exist_ok=True)
for scene in ["wall", *scene_names()]:
    (left_out.FOLDER / f"{scene}.txt").write_text(left_out.text_of(scene), encoding="utf-8")
with TemporaryDirectory() as folder:
    text = plans.velocity_only_text(Path(folder))
    (plans.FOLDER / "velocity_only_damped_wall.txt").write_text(text, encoding="utf-8")
