"""Does this tree write the same octets at the same instants as another one? `python benchmarks/same_frames.py TREE`.

Each case is run in both trees and its recordings, results and errors are compared by their hashes: frames (.log) and
rows (.csv) of library scenes on CANopen, Modbus TCP and RTU, on benches that are not rigid, with several axes and
buses, with drawn faults; the seeded runs of the soak; and random frames into drives and into the master. Times of the
computer and paths are left out. `--seeds N` draws that many seeded runs.
"""

import argparse
import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

HOST_TIMES = ("compute_us", "elapsed_s", "date", "source")
"""Keys of a result that hold times of the computer, and paths of the tree."""
SIMULATED = {
    "elastic": "coupling = { stiffness = 20.0, load_inertia = 1.0e-5, damping = 1.0e-3 }",
    "play": "coupling = { stiffness = 20.0, load_inertia = 1.0e-5, damping = 1.0e-3, backlash = 0.01 }",
    "gravity": "gravity = { torque = -4.0e-3 }",
    "cogging": "cogging = { torque = 2.0e-3, periods_per_revolution = 14 }",
    "stribeck": "stribeck = { torque = 1.0e-3, velocity = 0.5 }",
}
"""Tables of a rig whose axis is not rigid."""
AXIS = """\
[axis.{name}]
bus = "{bus}"
node = {node}
profile = "{profile}"
rated_torque = 0.4
encoder_counts_per_revolution = 4096
inertia = 4.0e-5
viscous_damping = 1.0e-4
coulomb_friction = 2.0e-3
limits = {{ speed = 10.0 }}
mechanism = {{ kind = "{kind}" }}
"""


def rig(*axes: str, buses: int = 1) -> str:
    """Return a rig file of axes, on as many CAN buses."""
    heads = [f'[bus.can{number}]\ninterface = "socketcan"\nchannel = "can{number}"\n' for number in range(buses)]
    return "".join([*heads, *axes])


def axis(name: str, node: int = 5, profile: str = "maxon_epos4", bus: str = "can0", further: str = "") -> str:
    """Return the part of a rig file for an axis that goes straight; `further` is its simulated load."""
    text = AXIS.format(name=name, node=node, profile=profile, bus=bus, kind="linear")
    text = text.replace('"linear" }', '"linear", metres_per_revolution = 0.05 }')
    return text + (f"[axis.{name}.simulation]\n{further}\n" if further else "")


def runs() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the arguments of every run; a rig is its text, and `suffix` that of its recording."""
    from haptic_fieldbus.scenes.catalogue import scene_names

    for scene in scene_names():
        yield f"scene {scene}", {"scene": scene, "duration": 1.2, "seed": 1}
    for scene in ("wall", "damped_wall", "free_puck", "virtual_shaft"):
        for suffix in (".log", ".csv"):
            yield f"{scene} {suffix}", {"scene": scene, "duration": 2.0, "suffix": suffix}
    for seed in range(8):
        faults = {"faults": f"random@{seed}", "seed": seed, "duration": 1.5, "fade_in": 0.1}
        yield f"faults {seed}", {"scene": "wall", "hand": "sine", **faults}
        yield f"faults two axes {seed}", {"scene": "virtual_shaft", "suffix": ".csv", **faults}
        for bus in ("sim-modbus-tcp", "sim-modbus-rtu@115200"):
            yield f"faults {bus} {seed}", {"scene": "wall", "bus": bus, "suffix": ".csv", **faults}
    for hand in ("push", "tap", "sine", "guide", "shake", "release", "none"):
        for bus in ("sim", "sim-modbus-tcp", "sim-modbus-rtu"):
            more = {"suffix": ".csv" if bus != "sim" else ".log", "duration": 1.5}
            yield f"hand {hand} {bus}", {"scene": "wall", "hand": hand, "bus": bus, **more}
    for rate in (250.0, 500.0, 2000.0):
        yield f"rate {rate}", {"scene": "wall", "rate": rate, "duration": 1.0, "force": True}
    for name, further in {**SIMULATED, "all": "\n".join([*SIMULATED.values()][1:])}.items():
        for suffix in (".log", ".csv"):
            bench = rig(axis("handle", further=further))
            yield f"bench {name} {suffix}", {"scene": "wall", "rig": bench, "suffix": suffix, "duration": 1.2}
    two = axis("left", 5), axis("right", 6, "generic_cia402")
    yield "two on one bus", {"scene": "virtual_shaft", "rig": rig(*two), "duration": 1.0, "axes": True}
    apart = axis("left", 5), axis("right", 5, "generic_cia402", bus="can1")
    yield "two buses", {"scene": "virtual_shaft", "rig": rig(*apart, buses=2), "duration": 1.0, "axes": True}
    yield "proved", {"scene": "wall", "prove": True, "duration": 0.5}
    yield "changed", {"scene": "wall", "duration": 1.5, "changes": [(0.7, {"wall.stiffness": 300.0})]}


def run_one(arguments: dict[str, Any]) -> str:
    """Return what a run wrote and ended with, as one hash."""
    from haptic_fieldbus import api
    from haptic_fieldbus.errors import HapticFieldbusError
    from haptic_fieldbus.scenes.catalogue import load_scene

    given = {**arguments}
    suffix, text, two = given.pop("suffix", ".log"), given.pop("rig", None), given.pop("axes", False)
    with TemporaryDirectory() as folder:
        record = Path(folder) / f"run{suffix}"
        if text is not None:
            given["rig"] = Path(folder) / "rig.toml"
            given["rig"].write_text(text, encoding="utf-8")
            given["bus"] = "sim"
        if two:
            first, second = [each.name for each in load_scene(given["scene"]).axes]
            given["axes"] = {first: "left", second: "right"}
        error = ""
        result: Any = None
        try:
            result = api.run(**given, record=record)
        except HapticFieldbusError as raised:
            error, result = f"{type(raised).__name__}: {raised}", getattr(raised, "result", None)
        text = error + told(None if result is None else result.to_json())
        octets = record.read_bytes() if record.exists() else b""
    return hashlib.sha256(octets + text.replace(folder, "").encode()).hexdigest()


def told(value: object) -> str:
    """Return a result as text, without the times of the computer."""

    def without(each: Any) -> Any:
        if isinstance(each, dict):
            return {key: without(inner) for key, inner in each.items() if key not in HOST_TIMES}
        return [without(inner) for inner in each] if isinstance(each, list | tuple) else each

    return json.dumps(without(value), sort_keys=True, default=str)


def seeded(seed: int) -> str:
    """Return the verdict and the frames of a seeded run of the soak."""
    from tests.soak.case import case_of, run_case

    verdict = run_case(case_of(seed, 0.6))
    return hashlib.sha256((verdict.line() + verdict.digest).encode()).hexdigest()


def frames_into_drives(seed: int) -> str:
    """Return what two drives and two programs sent and heard among random frames, with the instants."""
    from haptic_fieldbus.clock import VirtualClock
    from haptic_fieldbus.sim.canopen.bus import SimulatedBus
    from tests.soak.frames import CHANNEL, NODES, made_up

    random, seen = Random(f"same/{seed}"), hashlib.sha256()
    clock, channel = VirtualClock(), f"{CHANNEL},generic_cia402@{9 + seed % 3}"
    with SimulatedBus(channel, clock=clock) as bus, SimulatedBus(channel, clock=clock) as other:
        bus.world.watch(lambda t_ns, frame, _port: seen.update(f"{t_ns} {frame}".encode()))
        for _ in range(1500):
            for _ in range(random.choice((1, 1, 1, 4))):
                random.choice((bus, other)).send(made_up(random, NODES))
            for program in (bus, other):
                while (message := program.recv(random.choice((0.0, 0.0, 0.0005)))) is not None:
                    seen.update(f"{message.timestamp} {message}".encode())
    return seen.hexdigest()


def frames_into_master(seed: int) -> str:
    """Return what is broken when random frames come to the master; it says how far the master got."""
    from tests.soak.frames import into_master

    return repr(into_master(seed, 300))


def cases(seeds: int) -> Iterator[tuple[str, Callable[[], str]]]:
    """Yield every case by name."""
    for name, arguments in runs():
        yield name, partial(run_one, arguments)
    for seed in range(6):
        yield f"frames into drives {seed}", partial(frames_into_drives, seed)
        yield f"frames into master {seed}", partial(frames_into_master, seed)
    for seed in range(seeds):
        yield f"seeded {seed}", partial(seeded, seed)


def hashes(tree: Path, seeds: int, only: str) -> dict[str, str]:
    """Run all cases with the package of a tree."""
    environment = {**os.environ, "PYTHONPATH": str(tree), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, __file__, "--work", str(seeds), "--only", only]
    done = subprocess.run(command, env=environment, cwd=tree, stdout=subprocess.PIPE, text=True, check=True)
    found: dict[str, str] = json.loads(done.stdout)
    return found


def main() -> int:
    """Compare this tree with another one, or with the hashes that an earlier call has kept."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tree", type=Path, nargs="?", help="the other tree, or a file of its hashes")
    parser.add_argument("--keep", type=Path, help="write the hashes of the other tree to this file")
    parser.add_argument("--seeds", type=int, default=40)
    parser.add_argument("--only", default="", help="cases whose names begin with this text")
    parser.add_argument("--work", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.work is not None:
        print(json.dumps({name: case() for name, case in cases(given.work) if name.startswith(given.only)}))
        return 0
    if given.tree.is_dir():
        before = hashes(given.tree.resolve(), given.seeds, given.only)
    else:
        before = json.loads(given.tree.read_text(encoding="utf-8"))
    if given.keep is not None:
        given.keep.write_text(json.dumps(before), encoding="utf-8")
        return 0
    now = hashes(Path(__file__).resolve().parents[1], given.seeds, given.only)
    other = [name for name, found in now.items() if before.get(name) != found]
    print("\n".join([*other, f"{len(now)} cases, {len(other)} differ"]))
    return 1 if other else 0


if __name__ == "__main__":
    sys.exit(main())
