"""Put a controller of your own into the loop, and step through it period by period.

The controller is a spring of 200 N/m with a damper of 2 N·s/m. A hand pushes with 6 N, so the handle comes to rest at
6 N / 200 N/m = 30 mm. The cells (# %%) can be run one by one in an editor or a notebook.
"""

# %% A function of the feedback, and what it declares of itself
from typing import Any

from haptic_fieldbus import session

STIFFNESS, DAMPING = 200.0, 2.0


def controller(feedback: Any) -> float:
    """Position [m] and velocity [m/s] → force on the handle [N]."""
    return float(-STIFFNESS * feedback.position - DAMPING * feedback.velocity)


# %% The loop: a state for each period
needs = ("position", "velocity")
with session(effort=controller, needs=needs, stiffness=STIFFNESS, damping=DAMPING, hand="push", duration=3.0) as live:
    states = list(live)

# %% What came of it
fastest = max(states, key=lambda state: state.velocity or 0.0)
print(live.result.verdict if live.result else "no result")
print(f"fastest at {fastest.time:.2f} s, rests {1e3 * states[-1].position:.2f} mm from the start")
