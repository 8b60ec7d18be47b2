"""Whole benches for `identify`, drawn over decades and measured through their simulated bus, with all guards.

What is true is read from the simulation: the values that the rig gives it, and the delay between the instants at which
positions are latched and torques act, which are noted inside the drive.
"""

import math
import random
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haptic_fieldbus.api.identification import BenchTask, bounds_of, identify
from haptic_fieldbus.errors import HapticFieldbusError
from haptic_fieldbus.identification import Announcement, IdentifiedBench
from haptic_fieldbus.identification.experiment import Experiment
from haptic_fieldbus.sim.drive.servo import Servo
from haptic_fieldbus.sim.mechanics.body import Body
from haptic_fieldbus.sim.modbus import station
from tests.planning.test_known_bench import oracle_limit

PROFILES = Path(__file__).resolve().parents[2] / "profiles"
BUSES = {
    "canopen": ("haptic_sim", "bench", 5, "maxon_epos4"),
    "modbus-tcp": ("sim-modbus-tcp", "sim", 1, "generic_cia402_modbus"),
    "modbus-rtu": ("sim-modbus-rtu", "sim", 1, "generic_cia402_modbus"),
}
RATES = {
    "canopen": (100.0, 200.0, 250.0, 500.0, 1000.0),
    "modbus-tcp": (100.0, 200.0, 500.0, 1000.0),
    "modbus-rtu": (100.0, 125.0),
}  # fmt: skipfrom tests.planning.test_known_bench import oracle_limit


@dataclass(frozen=True)
class WholeBench:
    """A drawn bench: what is true of its motor shaft, the table of its simulation, and its drive."""

    seed: int
    bus: str
    rate: float
    inertia: float
    viscous_damping: float
    coulomb_friction: float
    torque_bandwidth: float
    counts: int
    travel: float
    """At the motor shaft [rad]."""
    rated_torque: float
    control_period: float
    control_tick: str
    handle: str
    """Mechanism of the rig."""
    ratio: float
    """Way of the handle for a radian of the motor."""
    parts: tuple[str, ...] = ()
    """Names of what the bench has beside a rigid shaft with friction."""
    stated: tuple[str, ...] = ()
    """Values that the rig states, each wrong by up to a factor of three; none in one of four benches without play."""
    tables: tuple[str, ...] = ()
    """Lines of `[axis.handle.simulation]` for them."""

    def write(self, folder: Path, torque_scale: float = 1.0, **stated: object) -> Path:
        """Write profile and rig into a folder; `stated` replaces keys of the axis. Return the path of the rig."""
        interface, channel, node, name = BUSES[self.bus]
        text = (PROFILES / f"{name}.toml").read_text(encoding="utf-8")
        timing = f'control_period = {self.control_period!r}\ncontrol_tick = "{self.control_tick}"'
        lines = [each for each in text.splitlines() if not each.startswith(("control_period", "control_tick"))]
        for table, more in (("[timing]", timing), ("[sources]", '"timing.control_tick" = "drawn"')):
            at = lines.index(table) + 1
            lines[at:at] = [more]
        (folder / "drive.toml").write_text("\n".join([*lines, ""]), encoding="utf-8")
        keys = {
            "rated_torque": self.rated_torque, "encoder_counts_per_revolution": self.counts, "mechanism": self.handle,
            "i_know": '["encoder_counts_per_revolution"]',
        } | stated  # fmt: skip
        half = 0.5 * self.travel * self.ratio
        rig = folder / "rig.toml"
        rig.write_text("\n".join([
            "[bus.here]", f'interface = "{interface}"', f'channel = "{channel.replace("maxon_epos4", "drive.toml")}"',
            "[axis.handle]", 'bus = "here"', f"node = {node}", 'profile = "drive.toml"',
            *(f"{key} = {value}" for key, value in keys.items()), *self.stated,
            "[axis.handle.limits]", f"position = [{-half!r}, {half!r}]",
            "[axis.handle.permissions]", "sign_pulse = 0.15",
            f"sign_effort = {0.15 * self.rated_torque / self.ratio!r}",
            "[axis.handle.simulation]", f"inertia = {self.inertia!r}", f"viscous_damping = {self.viscous_damping!r}",
            f"coulomb_friction = {self.coulomb_friction!r}", f"torque_bandwidth = {self.torque_bandwidth!r}",
            f"encoder_counts_per_revolution = {self.counts}", f"torque_scale = {torque_scale!r}", *self.tables, "",
        ]), encoding="utf-8")  # fmt: skip
        return rig

    @property
    def lag(self) -> float:
        """Time constant of the torque loop [s]."""
        return 1.0 / (2.0 * math.pi * self.torque_bandwidth)


def drawn_whole_bench(seed: int) -> WholeBench:
    """Draw a bench: all of its values over decades, and some of the parts that a rigid shaft does not have."""
    draw = random.Random(f"whole bench {seed}")
    bus = draw.choice(("canopen", "canopen", "modbus-tcp", "modbus-rtu"))
    rate, counts = draw.choice(RATES[bus]), round(24.0 * (65536.0 / 24.0) ** draw.uniform(0.0, 1.0))
    inertia, acceleration = 10.0 ** draw.uniform(-5.5, -2.5), 10.0 ** draw.uniform(2.8, 4.2)
    # A coarse encoder is moved by a long way, so that its counts tell something.
    travel = max(draw.choice((3.0, 6.0, 12.0)), min(80.0 * 2.0 * math.pi / counts, 12.0 * math.pi))
    # Drives tell it in whole mN·m, and a rig has at most 50 N·m.
    rated = min(max(round(4.0 * inertia * acceleration, 3), 0.002), 50.0)
    speed = min(2.0 * travel, 0.5 * math.sqrt(0.25 * rated / inertia * travel))
    coulomb = 0.25 * rated * 10.0 ** draw.uniform(-1.7, -0.6)
    damping = coulomb / speed * 10.0 ** draw.uniform(-1.8, 0.7)
    linear, gear = draw.random() < 0.5, draw.choice((1.0, 4.0, 10.0))
    metres = draw.choice((0.02, 0.05))
    handle = (
        f'{{ kind = "linear", metres_per_revolution = {metres} }}'
        if linear
        else f'{{ kind = "rotary", gear_ratio = {gear}, sign = {draw.choice((-1, 1))} }}'
    )
    parts, tables, left, load = list[str](), list[str](), coulomb, 0.0
    if draw.random() < 0.35:
        parts.append("stribeck")
        velocity, more = speed * 10.0 ** draw.uniform(-2.0, -0.7), coulomb * draw.uniform(0.1, 0.8)
        tables.append(f"stribeck = {{ torque = {more!r}, velocity = {velocity!r} }}")
    if draw.random() < 0.35:
        parts.append("cogging")
        periods, torque = draw.choice((4, 6, 12, 14, 24, 36)), coulomb * draw.uniform(0.05, 0.5)
        tables.append(f"cogging = {{ torque = {torque!r}, periods_per_revolution = {periods} }}")
        left -= torque
    if draw.random() < 0.3:
        parts.append("gravity")
        hanging = "" if linear else f", hanging_at = {draw.uniform(-1.0, 1.0)!r}"
        tables.append(f"gravity = {{ torque = {left * draw.uniform(0.1, 0.7)!r}{hanging} }}")
    if draw.random() < 0.2:
        parts.append("play")
        load, resonance = inertia * draw.uniform(0.1, 0.6), 2.0 * math.pi * draw.uniform(150.0, 400.0)
        stiffness = load * (1.0 - load / inertia) * resonance**2
        tables.append(
            f"coupling = {{ stiffness = {stiffness!r}, load_inertia = {load!r}, "
            f"damping = {0.2 * stiffness / resonance!r}, backlash = {10.0 ** draw.uniform(-3.5, -2.3)!r} }}"
        )
    known = draw.random() < 0.75 or load > 0.0  # without an inertia a rig takes no coupling
    truths = {"inertia": inertia, "viscous_damping": damping, "coulomb_friction": coulomb}
    slips = {key: value * 3.0 ** draw.uniform(-1.0, 1.0) for key, value in truths.items()}
    slips["inertia"] = max(slips["inertia"], 1.01 * load)  # a rig refuses a load that is larger than the whole
    stated = [f"{key} = {value!r}" for key, value in slips.items()]
    return WholeBench(
        seed, bus, rate, inertia, damping, coulomb, 10.0 ** draw.uniform(2.1, 3.4), counts, travel, rated,
        10.0 ** draw.uniform(-4.3, -3.0), draw.choice(("sync", "free")) if bus == "canopen" else "free", handle,
        metres / (2.0 * math.pi) if linear else 1.0 / gear, tuple(parts), tuple(stated) if known else (),
        tuple(tables),
    )  # fmt: skip


# What the drive does, noted inside it.


@dataclass
class Noted:
    """Instants inside the simulated drive [ns]: when each angle was latched, and when each torque began to act."""

    latched: list[tuple[int, int]] = field(default_factory=list)
    """(instant, counts)"""
    answered: list[tuple[int, int]] = field(default_factory=list)
    """Members of `latched` that an answer of a Modbus drive tells."""
    acted: list[tuple[int, float]] = field(default_factory=list)
    """(instant, torque [N·m])"""
    speed: float = 0.0
    angle: float = 0.0
    """Largest speed and angle of the true shaft in the experiments; before them, pulses test the motor direction."""
    measures: bool = False
    """Whether an experiment gives the torque."""


@contextmanager
def noting() -> Iterator[Noted]:
    """Note what every simulated drive does meanwhile."""
    noted, counts, target, carried_out = Noted(), Servo.counts, Body.set_target, station._carry_out
    asked = Experiment.effort

    def counting(self: Servo) -> int:
        shown, read_ns = counts(self), self.plant.t_ns
        if self._late:
            if self._free:
                ticks = math.floor((read_ns - self._grid_ns) / self._tick_ns)
                read_ns = self._grid_ns + round(ticks * self._tick_ns)
            read_ns -= self._latency_ns
        noted.latched.append((read_ns, shown))
        if noted.measures:
            noted.speed = max(noted.speed, abs(self.plant.velocity))
            noted.angle = max(noted.angle, abs(self.plant.position))
        return shown

    def effort(self: Experiment, position: float) -> float:
        noted.measures = True
        given = asked(self, position)
        noted.measures = not self.done
        return given

    def setting(self: Body, torque: float) -> None:
        noted.acted.append((self.t_ns, torque))
        target(self, torque)

    def carrying_out(*asked: Any) -> Any:
        answer = carried_out(*asked)
        noted.answered.append(noted.latched[-1])
        return answer

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(station, "_carry_out", carrying_out)
        patch.setattr(Servo, "counts", counting)
        patch.setattr(Experiment, "effort", effort)
        patch.setattr(Body, "set_target", setting)
        yield noted


def mean_delay(noted: Noted, found: IdentifiedBench) -> float:
    """Return the mean time from the latch of a sample until its torque acts, in the motion [s].

    Set-points and samples of the record are found again, as sequences, among the instants inside the drive.
    """
    record = found.records[1]
    torques = np.array(record.torques)
    acting = np.array([torque for _, torque in noted.acted])
    latched = noted.answered or noted.latched
    counts = np.array([shown for _, shown in latched], float)
    places = np.array(record.positions) / record.resolution
    at_torque = _found_again(torques, acting)
    # Positions are counted from the place at enabling, so their steps are compared.
    at_place = _found_again(np.round(np.diff(places)), np.diff(counts))
    return float(np.mean([
        noted.acted[at_torque + k][0] - latched[at_place + k][0] for k in range(300, len(torques) - 300)
    ])) * 1e-9  # fmt: skip


def _found_again(part: np.ndarray, whole: np.ndarray) -> int:
    """Return where a sequence stands in a longer one, by its middle."""
    middle, width = len(part) // 2, 300
    wanted = part[middle : middle + width]
    tolerance = 1e-4 * float(np.abs(wanted).max())
    for sign in (1.0, -1.0):
        for at in range(len(whole) - width):
            if abs(whole[at] - sign * wanted[0]) <= tolerance and np.all(
                np.abs(whole[at : at + width] - sign * wanted) <= tolerance
            ):
                return at - middle
    raise LookupError("the record is not among what the drive did")


@dataclass(frozen=True)
class Measured:
    """A whole bench after `identify`."""

    bench: WholeBench
    found: IdentifiedBench | None
    noted: Noted
    failure: str = ""
    announced: Announcement | None = None

    @cached_property
    def truth(self) -> dict[str, float]:
        """True value of each measured one."""
        bench = self.bench
        assert self.found is not None
        known = {"inertia": bench.inertia, "viscous_damping": bench.viscous_damping,
                 "coulomb_friction": bench.coulomb_friction, "torque_lag": bench.lag}  # fmt: skip
        # An encoder of few counts repeats itself, so that the record cannot be found again.
        with suppress(LookupError):
            known["delay_and_lag"] = mean_delay(self.noted, self.found) + bench.lag
        return known


def measured_whole(bench: WholeBench, folder: Path) -> Measured:
    """Measure a bench by `identify`; a refusal is kept with its sentence."""
    rig = bench.write(folder)
    task = BenchTask(rig, rate=bench.rate, profiles=None)
    with noting() as noted:
        try:
            found = identify(task)
        except HapticFieldbusError as error:
            # Where nothing moved, there may be nothing announced.
            return Measured(bench, None, noted, str(error), bounds_of(task) if noted.angle else None)
    return Measured(bench, found, noted, announced=found.announced)


def limit_share(measured: Measured) -> float | None:
    """Return the limit of a wall on the measured bench as a share of the true one; None where either is unknown."""
    found, bench = measured.found, measured.bench
    if found is None or found.limit is None or measured.truth.get("delay_and_lag", 0.0) < bench.lag:
        return None
    delay = measured.truth["delay_and_lag"] - bench.lag
    true = oracle_limit(bench.inertia, bench.viscous_damping, delay, bench.lag, 1.0 / bench.rate)
    return found.limit[0] * bench.ratio**2 / true


def wrong_with(measured: Measured) -> list[str]:
    """Return the announced bounds that a bench has left."""
    told, noted, ratio = measured.announced, measured.noted, measured.bench.ratio
    if told is None:
        return []
    records = measured.found.records if measured.found else ()
    torque = max((max(map(abs, record.torques)) for record in records), default=0.0) / ratio
    return [
        f"seed {measured.bench.seed}: {what} of {value:.4g}, announced were {most:.4g}"
        for what, value, most in (
            ("travel", noted.angle * ratio, max(-told.low, told.high)),
            ("speed", noted.speed * ratio, told.speed),
            ("effort", torque, told.effort),
        )
        if value > most * 1.001
    ]


def judged(measured: Measured) -> dict[str, bool]:
    """Return for each value whether its interval covers what is true; for a bench that was refused, nothing."""
    if measured.found is None or measured.found.fit is None:
        return {}
    values = measured.found.fit.values
    return {name: values[name].low <= true <= values[name].high for name, true in measured.truth.items()}


def accurate(measured: Measured) -> dict[str, bool]:
    """Return for inertia, delay with lag, and damping whether they are as near to the truth as they have to be."""
    if measured.found is None or measured.found.fit is None:
        return {}
    bench, truth, values = measured.bench, measured.truth, measured.found.fit.values
    off = {name: abs(values[name].value - true) for name, true in truth.items()}
    share = 0.05 if bench.counts >= 100 else 0.1
    told = {"inertia": off["inertia"] <= share * truth["inertia"]}
    if "delay_and_lag" in truth:
        told["delay_and_lag"] = off["delay_and_lag"] <= max(1e-4, 0.1 * truth["delay_and_lag"])
    seen = truth["viscous_damping"] * measured.found.fit.top_speed > 0.05 * truth["coulomb_friction"]
    near = off["viscous_damping"] <= 0.15 * truth["viscous_damping"]
    return told | {"viscous_damping": near or not seen or bool(values["viscous_damping"].reason)}
