"""Use a recording as a regression test of a controller: yesterday's feedback through today's cycle.

The recording may come from a simulated or a real bench; no drive is needed to compare. The cells (# %%) can be run one
by one in an editor or a notebook.
"""

# %% Yesterday: a run is recorded
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from haptic_fieldbus import compare_recording, run
from haptic_fieldbus.scenes.wall import Wall

folder = TemporaryDirectory()
path = Path(folder.name, "wall.csv")
run("wall", hand="push", duration=1.5, record=path)

# %% Today: the same set-points come out
print("first difference:", compare_recording(path))

# %% A line of the controller is changed, and the first period that differs is named
force = Wall.force
with patch.object(Wall, "force", lambda wall, *feedback: 1.05 * force(wall, *feedback)):
    difference = compare_recording(path)
print("first difference:", difference)
folder.cleanup()
