"""Sweep stiffness and damping of a wall, and draw where it is passive, stable and unstable.

Needs the extras "data" and "plot". The cells (# %%) can be run one by one in an editor or a notebook.
"""

# %% Judge 60 x 40 walls; the same call goes on where it was stopped
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from haptic_fieldbus import sweep

folder = TemporaryDirectory()
found = sweep(
    "wall",
    {"wall.stiffness": np.geomspace(10.0, 30000.0, 60), "wall.damping": np.linspace(0.0, 20.0, 40)},
    out=Path(folder.name, "walls"),
    workers=1,  # with more, a script on Windows or macOS needs `if __name__ == "__main__":`
)
print(f"{found.points} points, {found.stable_fraction or 0.0:.0%} of them stable")

# %% A map of the verdicts, a figure of matplotlib that may be changed
figure = found.plot()
figure.axes[0].plot([600.0], [0.0], "k*", markersize=14, clip_on=False)
figure.savefig(Path(folder.name, "walls.png"))

# %% Compute on the rows: the stiffest stable wall for each damping
frame = found.to_frame()
stable = frame[frame["verdict"] != "unstable"].groupby("wall.damping")["wall.stiffness"].max()
print(f"without damping stable up to {stable.iloc[0]:.0f} N/m, with 20 N·s/m up to {stable.iloc[-1]:.0f} N/m")

# %% The same points as simulated loops, which grow where the verdict says unstable
simulated = sweep("wall", {"wall.stiffness": np.geomspace(800.0, 3000.0, 20)}, engine="loop", steps=5000, workers=1)
loops = simulated.to_frame()
print(f"simulated loops grow from {loops[loops['grew']]['wall.stiffness'].min():.0f} N/m")
folder.cleanup()
