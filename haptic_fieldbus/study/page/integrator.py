"""Section on the lecture's open question: does it matter in the loop that an integrator preserves stability?"""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.numerics.integrators import METHODS
from haptic_fieldbus.report.drawing import GREY, INK, dress, figure, legend, line, name_lines, svg
from haptic_fieldbus.study.measure import loops
from haptic_fieldbus.study.measure.bench import Bench
from haptic_fieldbus.study.measure.loops import HANDLES, LoopGrowth, flicked_free
from haptic_fieldbus.study.page.html import Cell, Context, Entry, Section, number_text, paragraph, picture, table

QUICK, FULL = 40, 160
"""Number of stiffnesses tried."""
FLICKED = ("forward-euler", "semi-implicit-drift-first", "exact-zoh", "exact-foh", "backward-euler")
"""Methods shown with the flicked handle."""
SHARE, SECONDS = 0.87, 3.0
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


def integrator_section(context: Context) -> Section:
    """Measure the growth rates of all methods and return their section."""
    points = QUICK if context.quick else FULL
    methods = context.with_progress(METHODS, lambda method: f"loop with {method}")
    found = [loops.loop_growth(context.bench, method, points) for method in methods]
    stiffness = SHARE * _limit(found, "exact-foh")
    rates, swing = svg(draw(found)), svg(draw_flicked(context.bench, stiffness))
    caption = (
        "Growth rate over virtual stiffness. With a clamped handle only the method matters: forward Euler grows at "
        "every stiffness. In the loop the <i>lateness</i> of the force matters. The axis is linear between ±0.1 s⁻¹."
    )
    swinging = (
        f"The free handle after a flick of 0.1 m/s at {percent(SHARE)} of the limit of <code>exact-foh</code>: same "
        "spring, same mass, different integrators. Curves that leave the frame continue to grow."
    )
    body = [
        paragraph(QUESTION),
        picture("integrator", rates, caption),
        limits_table(found),
        "<h3>The answer</h3>",
        paragraph(answer(found)),
        picture("integrator-flick", swing, swinging),
    ]
    return Section(
        "integrator",
        "Does the integrator's own stability matter in the loop?",
        "".join(body),
        (f"Does preserving stability in the integrator matter in the loop? {short_answer(found)}",),
        {"integrator": rates, "integrator-flick": swing},
        [{"method": each.method, "limit": each.limit, "rate_at_scene": each.at_scene} for each in found],
    )


def draw(growths: Sequence[LoopGrowth]) -> Figure:
    """Return a figure of growth rates over stiffness, a panel for each handle."""
    drawn = figure(4.6)
    for panel, name in zip(drawn.subplots(1, 3, sharey=True), HANDLES, strict=True):
        for growth in growths:
            panel.plot(growth.stiffness, growth.rate[name], **line(growth.method, marked=False))
        _axis(panel)
        dress(panel, TITLES[name], "virtual stiffness [N/m]", "growth rate [1/s]" if name == HANDLES[0] else "")
    legend(drawn, {growth.method: growth.method for growth in growths}, marked=False, ncols=5)
    return drawn


def _axis(panel: Axes) -> None:
    """Scale the axes of a panel and shade the half in which motions grow."""
    # Rates have both signs and many decades: logarithmic beyond ±0.1 1/s, linear in between.
    panel.set_xscale("log")
    panel.set_yscale("symlog", linthresh=0.1, linscale=0.5)
    panel.set_ylim(-1e3, 1e3)
    panel.axhline(0.0, color=INK, linewidth=1.0)
    panel.axhspan(0.0, 1e3, color="#fbeee6", zorder=0)
    panel.text(0.03, 0.96, "grows", transform=panel.transAxes, color=GREY, va="top", size=9)
    panel.text(0.03, 0.04, "fades", transform=panel.transAxes, color=GREY, va="bottom", size=9)


def draw_flicked(bench: Bench, stiffness: float) -> Figure:
    """Return a figure of the force on the free handle over time, at a stiffness that only some methods keep stable."""
    drawn = figure(3.4)
    panel = drawn.subplots()
    largest = 0.0
    for method in FLICKED:
        times, force = flicked_free(bench, method, SECONDS, stiffness)
        if method == "exact-foh":
            largest = float(np.abs(force).max())
        panel.plot(times, force, **line(method, marked=False))
    # Growing curves leave the frame; a frame around them would hide the stable ones.
    panel.set_ylim(-3.0 * largest, 3.0 * largest)
    panel.margins(x=0)
    dress(
        panel,
        f"virtual mass of 0.5 kg, spring of {stiffness:.0f} N/m, handle free",
        "time [s]",
        "force on the handle [N]",
    )
    name_lines(drawn)
    return drawn


def _limit(growths: Sequence[LoopGrowth], method: str, name: str = "free") -> float:
    """Return the stiffest stable spring of a method with this handle [N/m]."""
    return next(growth.limit[name] for growth in growths if growth.method == method)


def limits_table(growths: Sequence[LoopGrowth]) -> str:
    """Return a table of the stiffest stable springs, and of the rates with the stiffness of the scene."""

    def row(growth: LoopGrowth) -> list[Entry]:
        limits = [growth.limit[name] for name in HANDLES]
        preserved = math.isclose(METHODS[growth.method].oscillator_growth(0.1), 1.0, abs_tol=1e-12)
        return [
            growth.method,
            Cell("yes", "good") if preserved else "no",
            *(("any" if math.isinf(k) else number_text(k, 4)) if k else Cell("none", "bad") for k in limits),
            *(0.0 if abs(growth.at_scene[name]) < 1e-9 else growth.at_scene[name] for name in HANDLES),  # or rounding
        ]

    headings = (
        "method", "preserves amplitude at T·ω = 0.1",
        *(f"stiffest stable spring, {name} [N/m]" for name in HANDLES),
        *(f"rate at 200 N/m, {name} [1/s]" for name in HANDLES),
    )  # fmt: skip
    return table(headings, map(row, growths))


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
