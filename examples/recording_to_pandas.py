"""Record a run, read it back as a frame of pandas, and compute on it: how far the handle went into the wall.

Needs the extra "data". The cells (# %%) can be run one by one in an editor or a notebook.
"""

# %% Record a row for each period; the provenance goes into the file
from pathlib import Path
from tempfile import TemporaryDirectory

from haptic_fieldbus import read_recording, run

folder = TemporaryDirectory()
path = Path(folder.name, "wall.mcap")
run("wall", hand="push", duration=2.0, record=path)

# %% Read it back
recording = read_recording(path)
frame = recording.to_frame()
frame["time"] = recording.time
print(frame[["time", "handle.position", "handle.command"]].tail(3))
if recording.provenance is not None:
    print(f"seed {recording.provenance.conditions.seed}, version {recording.provenance.version}")

# %% Stiffness as it was rendered: force over depth, where the handle is deep in the wall
inside = frame[frame["handle.position"] > 0.025]
depth = inside["handle.position"] - 0.020
print(f"rendered {float((-inside['handle.command'] / depth).mean()):.0f} N/m")
folder.cleanup()
