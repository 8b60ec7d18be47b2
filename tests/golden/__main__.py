from tests.golden.plans import FOLDER, cases, text_of

for scene, profile in cases():
    (FOLDER / f"plan_{scene}_{profile}.txt").write_text(text_of(scene, profile), encoding="utf-8")
