"""Define your own element: a hardening spring, F = −k·x − h·x³, which is linear beyond its reach.

A hand pushes with a constant 6 N. The handle comes to rest where k·x + h·x³ = 6 N.
"""

from dataclasses import dataclass

from haptic_fieldbus import Scene, SceneAxis, Signal, Workspace, run, stability
from haptic_fieldbus.numerics.linear import StateSpace, gain


@dataclass(frozen=True)
class HardeningSpring:
    """`stiffness` k [N/m] at rest, `hardening` h [N/m³], and the way over which it hardens, `reach` [m]."""

    axis: str
    stiffness: float
    hardening: float
    reach: float
    name: str = "spring"

    @property
    def needs(self) -> tuple[Signal, ...]:
        return (Signal.POSITION,)

    def force(self, position: float) -> float:
        """Force on the handle [N]; as it is odd and grows with x, it always pulls back."""
        curved = min(max(position, -self.reach), self.reach)
        straight = 3.0 * self.reach**2 * (position - curved)
        return -self.stiffness * position - self.hardening * (curved**3 + straight)

    def linearised(self) -> StateSpace:
        """From `reach` on, where it is stiffest: −dF/dx = k + 3·h·x²."""
        return gain([[-self.stiffness - 3.0 * self.hardening * self.reach**2, 0.0]])


SCENE = Scene(
    name="hardening_spring",
    description="A spring that grows stiffer",
    axes=(SceneAxis("handle", Workspace.LINEAR),),
    elements=(HardeningSpring("handle", stiffness=100.0, hardening=2.0e5, reach=0.03),),
)


def main() -> None:
    judged = stability(SCENE)
    print(f"{judged.verdict.value}; stable up to {judged.stiffness_limit.stable:.0f} N/m beside this hardening")
    result = run(SCENE, hand="push", duration=3.0)
    print(result.verdict)
    print(f"rests {1e3 * result.traces[0].position[-1]:.2f} mm from the start")


if __name__ == "__main__":
    main()
