"""What a scene truly uses, seen from outside: what a fresh interpreter imports, and which functions a period runs.

The plain wall is the scene that all others are told beside: its text lists all modules, theirs what they have beyond it
(+) and do without (-). Nothing here asks the plan: modules are those in `sys.modules`, functions those that the
interpreter's profiler sees called from decode to encode, after force has faded in.
"""

import subprocess
import sys
from pathlib import Path

FOLDER = Path(__file__).parent / "left_out"

SCRIPT = """
import sys
from haptic_fieldbus.api import plan
from haptic_fieldbus.cycle.cycle import Cycle, decoded_columns

compiled = plan(sys.argv[1])
cycle = Cycle(compiled)
names = decoded_columns(compiled)

def image(number):
    known = {"t_ns": number * compiled.period_ns}
    for axis in compiled.axes:
        known |= {f"{axis.name}.statusword": 0x0637, f"{axis.name}.position counts": number}
    return compiled.image.input.pack(*(known.get(name, 0) for name in names))

for number in range(2000):
    cycle(image(number))
if cycle.trip is not None:
    raise SystemExit(f"tripped: {cycle.trip}")

seen = {}
def watch(frame, event, argument):
    module = frame.f_globals.get("__name__", "")
    if event == "call" and module.startswith("haptic_fieldbus."):
        seen.setdefault(f"{module.removeprefix('haptic_fieldbus.')}: {frame.f_code.co_qualname}")

images = [image(2000 + number) for number in range(20)]
sys.setprofile(watch)
for each in images:
    cycle(each)
sys.setprofile(None)

modules = sorted(name for name in sys.modules if name.startswith("haptic_fieldbus."))
for title, lines in (("modules", modules), ("mapped", compiled.mapped), ("functions of a period", list(seen))):
    print(title, *(f"  {line}" for line in lines), sep="\\n")
"""


def text_of(scene: str) -> str:
    """The text of a scene; that of the wall must be written first."""
    text = _observed(scene)
    if scene == "wall":
        return text
    ours, plain = _modules(text), _modules((FOLDER / "wall.txt").read_text(encoding="utf-8"))
    lines = [f"  + {name}" for name in sorted(ours - plain)] + [f"  - {name}" for name in sorted(plain - ours)]
    return "\n".join(["modules beside those of the wall", *lines, "mapped" + text.partition("\nmapped")[2]])


def _modules(text: str) -> set[str]:
    return {line.strip() for line in text.partition("\nmapped")[0].splitlines()[1:]}


def _observed(scene: str) -> str:
    done = subprocess.run([sys.executable, "-c", SCRIPT, scene], check=False, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{scene}: {done.stderr}")
    return done.stdout
