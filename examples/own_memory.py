"""Define your own element with a memory: clay, which keeps a dent.

Clay yields at a limit of force. When the handle moves back, the clay springs back by limit/stiffness. A hand presses
the handle in and pulls it back. The handle leaves the clay at the dent, not at the original surface.
"""

from dataclasses import dataclass
from typing import ClassVar

from haptic_fieldbus import Scene, SceneAxis, Signal, Workspace, run
from haptic_fieldbus.numerics.linear import StateSpace, gain
from haptic_fieldbus.scenes.element import STRICT, Law, Place, PositiveEffort, Stiffness


@dataclass(frozen=True)
class Clay:
    """Clay from `position` [m] on: of this `stiffness` [N/m] until it yields at `limit` [N]."""

    axis: str
    stiffness: Stiffness
    limit: PositiveEffort
    position: Place = 0.0
    name: str = "clay"
    __pydantic_config__: ClassVar = STRICT

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def begin(self, period: float) -> Law:
        """Position → force on the handle [N]; the surface is where it was first, and moves with what is pressed in."""
        surface, most = self.position, self.limit / self.stiffness

        def law(position: float) -> float:
            nonlocal surface
            surface = max(surface, position - most)
            return -self.stiffness * max(position - surface, 0.0 * position)  # not-a-number goes through

        return law

    def linearised(self) -> StateSpace:
        """Before it yields."""
        return gain([[-self.stiffness, 0.0]])


SCENE = Scene(
    name="clay",
    description="Clay 10 mm to the right",
    axes=(SceneAxis("handle", Workspace.LINEAR),),
    elements=(Clay("handle", stiffness=800.0, limit=3.0, position=0.010),),
)


def main() -> None:
    result = run(SCENE, hand="guide", duration=4.0, settings={"clay.stiffness": "0.5 N/mm"})
    print(result.verdict)
    trace = result.traces[0]
    pressed = trace.position[trace.force < -0.1]
    print(f"pressed in to {1e3 * pressed.max():.2f} mm, let go at {1e3 * pressed[-1]:.2f} mm")


if __name__ == "__main__":
    main()
