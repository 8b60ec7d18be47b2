"""Sections on the error of the force that a hand feels: its sources, integrators in the loop, and impedance."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from haptic_fieldbus import HapticFieldbusError, Plan
from haptic_fieldbus.margins import Plant, frequency_response, sample
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.numerics.batch import Array
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.numerics.linear import StateSpace, parallel
from haptic_fieldbus.numerics.sampled import SampledPlant
from haptic_fieldbus.planning.compile import grouped
from haptic_fieldbus.report import drawing
from haptic_fieldbus.study.measure import loops
from haptic_fieldbus.study.measure.bench import FEW_SCENES, Bench, Tools, bench_of, library_scenes
from haptic_fieldbus.study.measure.loops import HANDLES, LoopGrowth, flicked_free
from haptic_fieldbus.study.page import html

# Force error of the shipped scenes on the simulated bench, split by source.


@dataclass(frozen=True)
class ForceError:
    """Force error of one scene with a hand [N or N·m]; None, and the reason, when it was not measured."""

    scene: str
    rms: float | None = None
    max: float | None = None
    unit: str = "N"
    by_source: Mapping[str, float] = field(default_factory=dict)
    """Shares that sum to 1; negative where a source compensates another one."""
    contact: float | None = None
    """Rms error over rms force in moving contact; None without any."""
    contact_s: float = 0.0
    """Time of moving contact [s]."""
    energy: float | None = None
    """Energy that the error put into the hand [J]."""
    reason: str = ""


def scene_error(tools: Tools, scene: str, duration: float, hand: str | None = None) -> ForceError:
    """Run a scene for `duration` [s] of virtual time, and return its error; a run that fails becomes a reason.

    The hand is that of the scene unless another is named.
    """
    try:
        result = tools.run(scene, duration=duration, hand=hand)
    except HapticFieldbusError as error:
        return ForceError(scene, reason=str(error).splitlines()[0])
    found = result.torque_error
    if found is None:
        return ForceError(scene, reason="too short to be judged")
    return ForceError(
        scene, found.rms, found.max, found.unit, found.by_source, found.contact, found.contact_s,
        result.energy_generated,
    )  # fmt: skip


SECONDS = 3.0
"""Length of each run [s of virtual time], the same in a quick report, so that both have the same errors."""
LED, LED_HAND = "wall", "shake"
"""Scene whose error stands at the top of the page, and the hand that moves the handle."""
# Colour and hatching of each source, in the order in which they are made real.
COLOURS = {
    "sampling and delay": (drawing.BLUE, ""),
    "encoder": (drawing.ORANGE, "//"),
    "tachometer": (drawing.ORANGE, "//"),
    "estimator": (drawing.GREEN, "\\\\"),
    "integrator": (drawing.PURPLE, "xx"),
    "limits": (drawing.GREY, "oo"),
    "torque step": (drawing.SKY, ".."),
    "torque loop": (drawing.VERMILION, "--"),
}

EXPLAINED = """Scenes of the library (quick report: one of each kind) run on the simulated bench (drive, bus, motor,
encoder) at 1 kHz for 3 s, each with its default hand. The ideal is the scene in continuous time on the true motion
of the handle. The error in contact covers moving contact only. Real effects are added one after another: sampling
and delay, encoder, velocity estimator, integrator, limits, torque step of the drive, torque loop. The shares of the
error sum to one; a negative share reduces the error of the others."""


def sources_section(context: html.Context) -> html.Section:
    """Run all scenes of the library, or a few for a quick report, and return their section."""
    scenes = context.with_progress(FEW_SCENES if context.quick else library_scenes(), lambda scene: f"scene {scene}")
    found = [scene_error(context.tools, scene, SECONDS) for scene in scenes]
    led = scene_error(context.tools, LED, SECONDS, LED_HAND)
    known = [each for each in found if each.rms is not None]
    document = drawing.svg(draw(known))
    caption = "Shares of the mean square error by source. A negative share reduces the error of other sources."
    return html.Section(
        "sources",
        "Where the error comes from",
        html.paragraph(EXPLAINED)
        + (html.picture("sources", document, caption) if known else "")
        + sources_table(found),
        (_finding(led),) if led.contact is not None else (),
        {"sources": document} if known else {},
        {"scenes": [asdict(each) for each in found], "led": asdict(led)},
    )


def draw(misfits: Sequence[ForceError]) -> Figure:
    """Return a figure with a bar for each scene, stacked from the shares of its sources."""
    drawn = drawing.figure(1.6 + max(0.28 * len(misfits), min(0.5 * len(misfits), 2.0)))
    panel = drawn.subplots()
    for row, misfit in enumerate(misfits):
        # Positive shares are stacked to the right of 0, negative ones to the left.
        ends = {True: 0.0, False: 0.0}
        for source, share in misfit.by_source.items():
            colour, hatch = COLOURS.get(source, (drawing.GREY, ""))
            panel.barh(row, share, left=ends[share >= 0.0], color=colour, hatch=hatch, edgecolor="white", height=0.62)
            ends[share >= 0.0] += share
    panel.set_yticks(range(len(misfits)), [misfit.scene for misfit in misfits])
    panel.set_ylim(len(misfits) - 0.4, -0.6)
    panel.axvline(0.0, color="#222222", linewidth=0.8)
    drawing.dress(panel, "error split by source", "share of the mean square error [1]", "")
    for source in _seen(misfits):  # bars of no length, for a legend with each source once
        colour, hatch = COLOURS[source]
        panel.barh(0, 0, color=colour, hatch=hatch, edgecolor="white", label=source)
    drawn.legend(loc="outside lower center", ncols=len(COLOURS) + 1, frameon=False, fontsize=9)
    return drawn


def _seen(misfits: Sequence[ForceError]) -> list[str]:
    """Return the sources that occur in any of the scenes, in their usual order."""
    return [source for source in COLOURS if any(source in misfit.by_source for misfit in misfits)]


def sources_table(misfits: Sequence[ForceError]) -> str:
    """Return a table of errors and shares, or of the reason why a scene was not measured."""
    sources = _seen(misfits)

    def row(misfit: ForceError) -> list[html.Entry]:
        if misfit.rms is None:
            return [misfit.scene, html.Cell(misfit.reason, "text"), *[""] * (3 + len(sources))]
        return [
            misfit.scene,
            f"{html.number_text(misfit.rms)} {misfit.unit}",
            f"{html.number_text(misfit.max)} {misfit.unit}",
            html.multiple(100.0, misfit.contact),
            html.multiple(1e3, misfit.energy),
            *(html.multiple(100.0, misfit.by_source.get(source)) for source in sources),
        ]

    headings = ("scene", "rms error", "largest error", "error in contact, % of force", "energy put in [mJ]",
                *(f"{source} [%]" for source in sources))  # fmt: skip
    return html.table(headings, map(row, misfits))


def _finding(led: ForceError) -> str:
    largest = max(led.by_source, key=lambda source: led.by_source[source])
    return (
        f"The wall of the library has a force error of {percent(led.contact or 0.0)} rms over "
        f"{rounded(led.contact_s, 2)} s of moving contact, with the handle moved to and fro once a second for "
        f"{exactly(SECONDS)} s (hand <code>{LED_HAND}</code>); people notice from about 8 %. "
        f"{percent(led.by_source[largest])} of the error is {largest}."
    )


# Section on the lecture's open question: does it matter in the loop that an integrator preserves stability?

QUICK, FULL = 40, 160
"""Number of stiffnesses tried."""
FLICKED = ("forward-euler", "semi-implicit-drift-first", "exact-zoh", "exact-foh", "backward-euler")
"""Methods shown with the flicked handle."""
SHARE, INTEGRATOR_SECONDS = 0.87, 3.0
"""Stiffness of the flicked handle's spring as a share of the stiffest stable one, and time shown [s]."""
TITLES = {
    "clamped": "handle clamped (the lecture's held puck)",
    "in the hand": "handle in the hand that leans",
    "free": "handle free: the device alone",
}

QUESTION = """The lecture notes end forward Euler with “other techniques preserve stability, but does it matter?”
There are two kinds of stability: that of the method with its own undamped oscillator, and that of the sampled loop
of device, hold, delay and virtual mass. The figure shows the growth rate of the loop, ln(ρ)/T, over the stiffness
of a virtual 0.5 kg mass at 1 kHz on the shipped bench. Above zero the motion grows."""


def integrator_section(context: html.Context) -> html.Section:
    """Measure the growth rates of all methods and return their section."""
    points = QUICK if context.quick else FULL
    methods = context.with_progress(METHODS, lambda method: f"loop with {method}")
    found = [loops.loop_growth(context.bench, method, points) for method in methods]
    stiffness = SHARE * _limit(found, "exact-foh")
    rates, swing = drawing.svg(draw_integrator(found)), drawing.svg(draw_flicked(context.bench, stiffness))
    caption = (
        "Growth rate over virtual stiffness. With a clamped handle only the method matters: forward Euler grows at "
        "every stiffness. In the loop the <i>lateness</i> of the force matters. The axis is linear between ±0.1 s⁻¹."
    )
    swinging = (
        f"The free handle after a flick of 0.1 m/s at {percent(SHARE)} of the limit of <code>exact-foh</code>: same "
        "spring, same mass, different integrators. Curves that leave the frame continue to grow."
    )
    limits = html.paragraph(QUESTION) + html.picture("integrator", rates, caption) + limits_table(found)
    answered = html.paragraph(answer(found)) + html.picture("integrator-flick", swing, swinging)
    return html.Section(
        "integrator",
        "Does the integrator's own stability matter in the loop?",
        f"{limits}<h3>The answer</h3>{answered}",
        (f"Does preserving stability in the integrator matter in the loop? {short_answer(found)}",),
        {"integrator": rates, "integrator-flick": swing},
        [{"method": each.method, "limit": each.limit, "rate_at_scene": each.at_scene} for each in found],
    )


def draw_integrator(growths: Sequence[LoopGrowth]) -> Figure:
    """Return a figure of growth rates over stiffness, a panel for each handle."""
    drawn = drawing.figure(4.6)
    for panel, name in zip(drawn.subplots(1, 3, sharey=True), HANDLES, strict=True):
        for growth in growths:
            panel.plot(growth.stiffness, growth.rate[name], **drawing.line(growth.method, marked=False))
        _axis(panel)
        drawing.dress(panel, TITLES[name], "virtual stiffness [N/m]", "growth rate [1/s]" if name == HANDLES[0] else "")
    drawing.legend(drawn, {growth.method: growth.method for growth in growths}, marked=False, ncols=5)
    return drawn


def _axis(panel: Axes) -> None:
    """Scale the axes of a panel and shade the half in which motions grow."""
    # Rates have both signs and many decades: logarithmic beyond ±0.1 1/s, linear in between.
    panel.set_xscale("log")
    panel.set_yscale("symlog", linthresh=0.1, linscale=0.5)
    panel.set_ylim(-1e3, 1e3)
    panel.axhline(0.0, color=drawing.INK, linewidth=1.0)
    panel.axhspan(0.0, 1e3, color="#fbeee6", zorder=0)
    panel.text(0.03, 0.96, "grows", transform=panel.transAxes, color=drawing.GREY, va="top", size=9)
    panel.text(0.03, 0.04, "fades", transform=panel.transAxes, color=drawing.GREY, va="bottom", size=9)


def draw_flicked(bench: Bench, stiffness: float) -> Figure:
    """Return a figure of the force on the free handle over time, at a stiffness that only some methods keep stable."""
    drawn = drawing.figure(3.4)
    panel = drawn.subplots()
    for method in FLICKED:
        times, force = flicked_free(bench, method, INTEGRATOR_SECONDS, stiffness)
        panel.plot(times, force, **drawing.line(method, marked=False))
        if method == "exact-foh":
            # Growing curves leave the frame; a frame around them would hide the stable ones.
            panel.set_ylim(-3.0 * float(np.abs(force).max()), 3.0 * float(np.abs(force).max()))
    panel.margins(x=0)
    title = f"virtual mass of 0.5 kg, spring of {stiffness:.0f} N/m, handle free"
    drawing.dress(panel, title, "time [s]", "force on the handle [N]")
    drawing.name_lines(drawn)
    return drawn


def _limit(growths: Sequence[LoopGrowth], method: str, name: str = "free") -> float:
    """Return the stiffest stable spring of a method with this handle [N/m]."""
    return next(growth.limit[name] for growth in growths if growth.method == method)


def limits_table(growths: Sequence[LoopGrowth]) -> str:
    """Return a table of the stiffest stable springs, and of the rates with the stiffness of the scene."""

    def row(growth: LoopGrowth) -> list[html.Entry]:
        limits = [growth.limit[name] for name in HANDLES]
        preserved = math.isclose(METHODS[growth.method].oscillator_growth(0.1), 1.0, abs_tol=1e-12)
        return [
            growth.method,
            html.Cell("yes", "good") if preserved else "no",
            *(("any" if math.isinf(k) else html.number_text(k, 4)) if k else html.Cell("none", "bad") for k in limits),
            *(0.0 if abs(growth.at_scene[name]) < 1e-9 else growth.at_scene[name] for name in HANDLES),  # or rounding
        ]

    headings = (
        "method", "preserves amplitude at T·ω = 0.1",
        *(f"stiffest stable spring, {name} [N/m]" for name in HANDLES),
        *(f"rate at 200 N/m, {name} [1/s]" for name in HANDLES),
    )  # fmt: skip
    return html.table(headings, map(row, growths))


def short_answer(growths: Sequence[LoopGrowth]) -> str:
    """Return the answer in short, as HTML."""
    best = _limit(growths, "exact-foh")
    euler, drift, held = (_limit(growths, name) for name in ("forward-euler", "semi-implicit-drift-first", "exact-zoh"))
    return (
        "With a clamped puck it does. In the loop the lateness of the force matters more. With a free handle forward "
        f"Euler is stable up to {percent(euler / best)} of the stiffness of the straight-line exact step "
        f"({rounded(euler)} of {rounded(best)} N/m). Drift-first and <code>exact-zoh</code> both preserve stability, "
        f"but lose {percent(1.0 - drift / best)} and {percent(1.0 - held / best)} too; <code>rk4</code> does not "
        "preserve it and loses nothing."
    )


def _softest(growths: Sequence[LoopGrowth]) -> str:
    """Return a sentence on forward Euler with a soft spring in a hand; empty when it is stable with any soft spring."""
    softest = next(growth.softest["in the hand"] for growth in growths if growth.method == "forward-euler")
    if not softest:
        return ""
    return (
        f" With a hand forward Euler also grows below {rounded(softest)} N/m: such a soft spring moves the handle too "
        "little for the hand to absorb the energy of the method."
    )


def answer(growths: Sequence[LoopGrowth]) -> str:
    """Return the answer at length, as HTML."""
    clamped = next(growth.at_scene["clamped"] for growth in growths if growth.method == "forward-euler")
    doubling = f"{rounded(math.log(2.0) / clamped)} s" if clamped > 0.0 else "no time"
    return (
        f"{short_answer(growths)} With a clamped handle nothing absorbs energy from the virtual mass. Forward Euler "
        f"then doubles the amplitude every {doubling} at 200 N/m, and grows at any period (its rate is k·T/2m). In "
        "the loop, the friction of the device and the hand absorb energy. The sampled loop adds energy because the "
        "force is late: by the delay, by T/2 of the hold, and by the lateness of the integrator. Forward Euler "
        "applies its own spring force one period late. Drift-first reads the handle one period late. A held input is "
        "half a period old on average. A method that preserves the energy of its own oscillator cannot prevent this: "
        f"with enough stiffness every such method grows.{_softest(growths)} Backward Euler "
        "is stable at any stiffness only because it damps the mass that it should render. Choose a method without "
        "delay (<code>exact-foh</code>, the default), and check the loop with <code>haptic-fieldbus stability</code>."
    )


# Section on the impedance that a hand feels at the handle.

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
    return device_impedance(plant, frequency) - (by_input[:, 0, 0] + s * by_input[:, 0, 1]) / s


def device_impedance(plant: Plant, frequency: Array) -> Complex:
    """Return the impedance m·jω + b of the device alone [N·s/m], `(n,)`."""
    return plant.mass * _laplace(frequency) + plant.damping


def _laplace(frequency: Array) -> Complex:
    """Return s = jω for frequencies [Hz], `(n,)`."""
    return (2j * np.pi * frequency).astype(np.complex128)


def impedance(scene: str, bench: Bench, space: StateSpace, environment: StateSpace, points: int = 400) -> Impedance:
    """Return the impedances of a scene at `points` frequencies, from 0.1 Hz to just below half the sampling rate."""
    frequency = np.geomspace(0.1, 0.499 / bench.period, points)
    felt, ideal = felt_impedance(bench, environment, frequency), ideal_impedance(bench.plant, space, frequency)
    return Impedance(scene, frequency, felt, ideal, device_impedance(bench.plant, frequency))


SCENES = ("wall", "damped_wall", "sprung_mass")
"""Scenes that show a spring, an estimated velocity, and virtual states."""

IMPEDANCE_EXPLAINED = """A hand feels the impedance Z(jω): its force divided by the velocity of the handle. Z contains
the
mass and friction of the device, and the scene that the handle touches. The sampled curve is the whole loop up to
half the sampling rate: encoder sampling, estimator or integrator, delay, hold and torque loop on the device in
continuous time. The ideal has the same device and the scene in continuous time. Where the real part is negative,
the handle can put out more energy than it took in."""


def impedance_section(context: html.Context) -> html.Section:
    """Compute the impedances of a few scenes and return their section."""
    scenes = context.with_progress(SCENES, lambda scene: f"impedance of {scene}")
    found = [of_plan(context.tools.plan(scene)) for scene in scenes]
    document = drawing.svg(draw_impedance(found))
    caption = (
        "Magnitude, relative error and real part of the impedance. Red: frequencies with a negative real part. "
        "Dashed: the 8 % that a hand notices."
    )
    return html.Section(
        "impedance",
        "Impedance at the handle",
        html.paragraph(IMPEDANCE_EXPLAINED) + html.picture("impedance", document, caption) + impedance_table(found),
        tuple(_impedance_finding(each) for each in found[:1]),
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


def draw_impedance(impedances: Sequence[Impedance]) -> Figure:
    """Return a figure of magnitude, relative error and real part, a column for each scene."""
    drawn = drawing.figure(7.6)
    panels = drawn.subplots(3, len(impedances), sharex=True, squeeze=False, height_ratios=[1.3, 1.0, 1.0])
    for (top, middle, bottom), curve in zip(panels.T, impedances, strict=True):
        f = curve.frequency
        top.loglog(f, np.abs(curve.felt), color=drawing.BLUE, linewidth=2.4, label="sampled loop")
        top.loglog(f, np.abs(curve.ideal), color=drawing.INK, linewidth=1.1, label="ideal, continuous")
        top.loglog(
            f, np.abs(curve.device), color=drawing.GREY, linewidth=1.1, linestyle="--", label="device, motor off"
        )
        middle.loglog(f, error(curve), color=drawing.VERMILION, linewidth=1.6)
        middle.axhline(drawing.FELT, color=drawing.GREY, linewidth=1.0, linestyle=(0, (5, 4)))
        bottom.semilogx(f, curve.felt.real, color=drawing.BLUE, linewidth=1.8)
        bottom.semilogx(f, curve.ideal.real, color=drawing.INK, linewidth=1.0)
        bottom.fill_between(
            f, curve.felt.real, 0.0, where=curve.felt.real < 0.0, color=drawing.VERMILION, alpha=0.3, linewidth=0
        )
        bottom.axhline(0.0, color=drawing.INK, linewidth=0.7)
        # Resonances would stretch the axis: it is scaled by the ideal, whose real part is the damping felt.
        top_of = 1.5 * float(curve.ideal.real.max())
        bottom.set_ylim(-0.6 * top_of, top_of)
        first = curve is impedances[0]
        drawing.dress(top, curve.scene, "", "impedance |Z| [N·s/m]" if first else "")
        drawing.dress(middle, "", "", "error |Z / ideal − 1| [1]" if first else "")
        drawing.dress(bottom, "", "frequency [Hz]", "real part of Z [N·s/m]" if first else "")
    drawing.name_lines(drawn, panels[0, :1])
    return drawn


def impedance_table(impedances: Sequence[Impedance]) -> str:
    """Return a table of errors, and of the lowest frequencies with a perceptible error or a negative real part."""
    places = (1.0, 10.0, 100.0)

    def row(curve: Impedance) -> list[html.Entry]:
        values = [100.0 * float(np.interp(place, curve.frequency, error(curve))) for place in places]
        return [curve.scene, *values, _first(curve, error(curve) > drawing.FELT), _first(curve, curve.felt.real < 0.0)]

    headings = ("scene", *(f"error at {exactly(place)} Hz [%]" for place in places), "first above 8 % at",
                "Re Z first negative at")  # fmt: skip
    return html.table(headings, map(row, impedances))


def _first(curve: Impedance, holds: np.ndarray) -> str:
    """Return the lowest frequency at which the mask `holds`, `(n,)`, is True; "nowhere" when there is none."""
    return f"{rounded(curve.frequency[int(np.argmax(holds))])} Hz" if holds.any() else "nowhere"


def _impedance_finding(curve: Impedance) -> str:
    off = error(curve)
    early, worst = 100.0 * float(np.interp(1.0, curve.frequency, off)), 100.0 * float(off.max())
    return (
        f"At the handle the {curve.scene} differs from the ideal by {rounded(early)} % at 1 Hz, and by at most "
        f"{rounded(worst)} %, at the resonance of device and {curve.scene} ({rounded(curve.frequency[off.argmax()])} "
        "Hz)."
    )
