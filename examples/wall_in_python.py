"""Render a wall without any file: define scene, bench and run in Python.

A hand pushes with 6 N. The handle comes to rest 6 N / 600 N/m = 10 mm inside the wall.
"""

from haptic_fieldbus import CanSection, Limits, LinearMechanism, Rig, RigAxis, Scene, SceneAxis, Workspace, run
from haptic_fieldbus.scenes.wall import Wall

SCENE = Scene(
    name="my_wall",
    description="A wall 10 mm to the right",
    axes=(SceneAxis("handle", Workspace.LINEAR),),
    elements=(Wall(axis="handle", position=0.010, stiffness=600.0),),
)
RIG = Rig(
    bus={"can0": CanSection(interface="haptic_sim", channel="can0", bitrate=1_000_000)},
    axis={
        "handle": RigAxis(
            bus="can0",
            node=5,
            profile="maxon_epos4",
            mechanism=LinearMechanism("linear", metres_per_revolution=0.05),
            encoder_counts_per_revolution=16_384,
            rated_torque=0.4,
            inertia=4.0e-5,
            viscous_damping=2.0e-4,
            coulomb_friction=2.0e-3,
            limits=Limits(effort=20.0, speed=2.0, position=(-0.10, 0.10)),
        )
    },
)


def main() -> None:
    result = run(SCENE, rig=RIG, hand="push", duration=3.0)
    print(result.verdict)
    print(f"rests {1e3 * result.traces[0].position[-1]:.2f} mm from the start")


if __name__ == "__main__":
    main()
