"""A drive whose handle rolls, as one that a hand leads: `python -m tests.peers.rolling BUS NODE SPEED`.

It hosts the drive as `haptic-fieldbus simulate` does, without friction, until it is killed. SPEED is in m/s.
"""

import sys
from dataclasses import replace

from haptic_fieldbus.sim.canopen.hosting import host
from haptic_fieldbus.sim.host_request import HostRequest, resolve


def main() -> None:
    bus, node, speed = sys.argv[1], int(sys.argv[2]), float(sys.argv[3])
    name, (slot,) = resolve(HostRequest([f"generic_cia402@{node}"], bus))
    axis = replace(slot.axis, coulomb_friction=0.0, viscous_damping=0.0)
    rolling = replace(slot, axis=axis, velocity=speed / axis.mechanism.ratio)
    host(name, [rolling], 0, lambda _: print("ready", flush=True), lambda: False)


if __name__ == "__main__":
    main()
