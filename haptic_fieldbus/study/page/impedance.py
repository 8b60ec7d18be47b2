"""Section on the impedance that a hand feels at the handle."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_fieldbus import Plan
from haptic_fieldbus.margins import Plant, frequency_response, sample
from haptic_fieldbus.numerals import exactly, rounded
from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.numerics.sampled import SampledPlant
from haptic_fieldbus.planning.compile import grouped
from haptic_fieldbus.report.drawing import BLUE, FELT, GREY, INK, VERMILION, dress, figure, name_lines, svg
from haptic_fieldbus.study.measure.bench import Bench, bench_of
from haptic_fieldbus.study.page.html import Context, Entry, Section, paragraph, picture, table

# Impedance that a hand feels at the handle, Z(jω) = force of the hand over velocity, device included.
#
# The hand shakes the handle with F·e^{jωt}. Without feedback the device moves by x = G·F, G = 1/(m·s² + b·s). The
# samples x_k = X·e^{jωkT} drive the discrete environment H(z). Its force, held and delayed, moves the samples by the
# pulse response P(z), so that X = G·F + P·H·X. The component of the held force at ω is h·H·X with
#
#     h = e^{−jω·td}·(1 − e^{−jωT})/(jωT)·1/(1 + jω·λ),
#
# so the handle moves by x = G·(F + h·H·X) at ω, and Z = F/(jω·x). The small motion at the aliases of ω is left out. The
# ideal is the device with the environment in continuous time: Z = m·jω + b − H_c(jω)/(jω).

Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Impedance:
    """Impedances of one scene [N·s/m], each `(n,)`."""

    scene: str
    frequency: Array
    """Frequencies [Hz], `(n,)`."""
    felt: Complex
    """Impedance of the sampled loop."""
    ideal: Complex
    """Impedance with the environment in continuous time."""
    device: Complex
    """Impedance of the device with its motor off."""


def felt_impedance(bench: Bench, environment: StateSpace, frequency: Array) -> Complex:
    """Return the impedance with the discrete environment x_k → F_k of the loop [N·s/m], `(n,)`."""
    plant, period = bench.plant, bench.period
    s = _laplace(frequency)
    angle = 2.0 * np.pi * frequency * period
    by_itself = 1.0 / (plant.mass * s**2 + plant.damping * s)
    law = frequency_response(environment, angle)
    samples = by_itself / (1.0 - pulse_response(sample(plant, period, bench.delay), angle) * law)
    # expm1 keeps the digits of 1 − e^{−sT} at low frequencies, where both are nearly equal.
    hold = np.exp(-s * bench.delay) * -np.expm1(-s * period) / (s * period) / (1.0 + s * plant.torque_lag)
    moved: Complex = by_itself * (1.0 + hold * law * samples)
    return 1.0 / (s * moved)


def pulse_response(plant: SampledPlant, angle: Array) -> Complex:
    """Return P(e^{jθ}), the sampled position per held force [m/N], for angles θ = ωT, `(n,)`."""
    z = np.exp(1j * angle)
    order = len(plant.transition)
    # A delay that is no whole number of periods splits each period: in its first part the force before still acts.
    force = plant.after[None] * (z**-plant.whole)[:, None, None]
    force = force + plant.before[None] * (z ** -(plant.whole + 1))[:, None, None]
    return np.asarray(np.linalg.solve(z[:, None, None] * np.eye(order) - plant.transition, force)[:, 0, 0])


def ideal_impedance(plant: Plant, space: StateSpace, frequency: Array) -> Complex:
    """Return the impedance with an environment (position, velocity) → force in continuous time [N·s/m], `(n,)`."""
    s = _laplace(frequency)
    systems: Complex = s[:, None, None] * np.eye(space.order) - space.a
    by_input = space.c @ np.linalg.solve(systems, space.b[None] + 0j) + space.d
    law = by_input[:, 0, 0] + s * by_input[:, 0, 1]
    return device_impedance(plant, frequency) - law / s


def device_impedance(plant: Plant, frequency: Array) -> Complex:
    """Return the impedance m·jω + b of the device alone [N·s/m], `(n,)`."""
    return plant.mass * _laplace(frequency) + plant.damping


def _laplace(frequency: Array) -> Complex:
    """Return s = jω for frequencies [Hz], `(n,)`."""
    return (2j * np.pi * frequency).astype(np.complex128)


def impedance(scene: str, bench: Bench, space: StateSpace, environment: StateSpace, points: int = 400) -> Impedance:
    """Return the impedances of a scene at `points` frequencies, from 0.1 Hz to just below half the sampling rate."""
    frequency = np.geomspace(0.1, 0.499 / bench.period, points)
    return Impedance(
        scene,
        frequency,
        felt_impedance(bench, environment, frequency),
        ideal_impedance(bench.plant, space, frequency),
        device_impedance(bench.plant, frequency),
    )


SCENES = ("wall", "damped_wall", "sprung_mass")
"""Scenes that show a spring, an estimated velocity, and virtual states."""

EXPLAINED = """A hand feels the impedance Z(jω): its force divided by the velocity of the handle. Z contains the
mass and friction of the device, and the scene that the handle touches. The sampled curve is the whole loop up to
half the sampling rate: encoder sampling, estimator or integrator, delay, hold and torque loop on the device in
continuous time. The ideal has the same device and the scene in continuous time. Where the real part is negative,
the handle can put out more energy than it took in."""


def impedance_section(context: Context) -> Section:
    """Compute the impedances of a few scenes and return their section."""
    scenes = context.with_progress(SCENES, lambda scene: f"impedance of {scene}")
    found = [of_plan(context.tools.plan(scene)) for scene in scenes]
    document = svg(draw(found))
    caption = (
        "Magnitude, relative error and real part of the impedance. Red: frequencies with a negative real part. "
        "Dashed: the 8 % that a hand notices."
    )
    return Section(
        "impedance",
        "Impedance at the handle",
        paragraph(EXPLAINED) + picture("impedance", document, caption) + impedance_table(found),
        tuple(_finding(each) for each in found[:1]),
        {"impedance": document},
        [
            {"scene": each.scene, "frequency_hz": each.frequency.tolist(), "magnitude": np.abs(each.felt).tolist(),
             "ideal_magnitude": np.abs(each.ideal).tolist(), "real": each.felt.real.tolist()}
            for each in found
        ],
    )  # fmt: skip


def of_plan(plan: Plan) -> Impedance:
    """Return the impedances of a plan's first axis in sustained contact."""
    bench, group = bench_of(plan), next(grouped(plan.axes[:1], plan.period))
    space = parallel([element.linearised() for element in plan.axes[0].elements])
    return impedance(plan.scene.name, bench, space, group.environment())


def error(curve: Impedance) -> np.ndarray:
    """Return the relative error |Z/Z_ideal − 1|, `(n,)`."""
    return np.asarray(np.abs(curve.felt / curve.ideal - 1.0))


def draw(impedances: Sequence[Impedance]) -> Figure:
    """Return a figure of magnitude, relative error and real part, a column for each scene."""
    drawn = figure(7.6)
    panels = drawn.subplots(3, len(impedances), sharex=True, squeeze=False, height_ratios=[1.3, 1.0, 1.0])
    for (top, middle, bottom), curve in zip(panels.T, impedances, strict=True):
        f = curve.frequency
        top.loglog(f, np.abs(curve.felt), color=BLUE, linewidth=2.4, label="sampled loop")
        top.loglog(f, np.abs(curve.ideal), color=INK, linewidth=1.1, label="ideal, continuous")
        top.loglog(f, np.abs(curve.device), color=GREY, linewidth=1.1, linestyle="--", label="device, motor off")
        middle.loglog(f, error(curve), color=VERMILION, linewidth=1.6)
        middle.axhline(FELT, color=GREY, linewidth=1.0, linestyle=(0, (5, 4)))
        bottom.semilogx(f, curve.felt.real, color=BLUE, linewidth=1.8)
        bottom.semilogx(f, curve.ideal.real, color=INK, linewidth=1.0)
        bottom.fill_between(
            f, curve.felt.real, 0.0, where=curve.felt.real < 0.0, color=VERMILION, alpha=0.3, linewidth=0
        )
        bottom.axhline(0.0, color=INK, linewidth=0.7)
        # Resonances would stretch the axis: it is scaled by the ideal, whose real part is the damping felt.
        top_of = 1.5 * float(curve.ideal.real.max())
        bottom.set_ylim(-0.6 * top_of, top_of)
        first = curve is impedances[0]
        dress(top, curve.scene, "", "impedance |Z| [N·s/m]" if first else "")
        dress(middle, "", "", "error |Z / ideal − 1| [1]" if first else "")
        dress(bottom, "", "frequency [Hz]", "real part of Z [N·s/m]" if first else "")
    name_lines(drawn, panels[0, :1])
    return drawn


def impedance_table(impedances: Sequence[Impedance]) -> str:
    """Return a table of errors, and of the lowest frequencies with a perceptible error or a negative real part."""
    places = (1.0, 10.0, 100.0)

    def row(curve: Impedance) -> list[Entry]:
        values = [100.0 * float(np.interp(place, curve.frequency, error(curve))) for place in places]
        return [
            curve.scene,
            *values,
            _first(curve, error(curve) > FELT),
            _first(curve, curve.felt.real < 0.0),
        ]

    headings = ("scene", *(f"error at {exactly(place)} Hz [%]" for place in places), "first above 8 % at",
                "Re Z first negative at")  # fmt: skip
    return table(headings, map(row, impedances))


def _first(curve: Impedance, holds: np.ndarray) -> str:
    """Return the lowest frequency at which the mask `holds`, `(n,)`, is True; "nowhere" when there is none."""
    return f"{rounded(curve.frequency[int(np.argmax(holds))])} Hz" if holds.any() else "nowhere"


def _finding(curve: Impedance) -> str:
    off = error(curve)
    early, worst = 100.0 * float(np.interp(1.0, curve.frequency, off)), 100.0 * float(off.max())
    return (
        f"At the handle the {curve.scene} differs from the ideal by {rounded(early)} % at 1 Hz, and by at most "
        f"{rounded(worst)} %, at the resonance of device and {curve.scene} ({rounded(curve.frequency[off.argmax()])} "
        "Hz)."
    )
