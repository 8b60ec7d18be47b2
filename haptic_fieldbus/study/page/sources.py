"""Section on the sources of the force error of rendered scenes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field

from matplotlib.figure import Figure

from haptic_fieldbus import HapticFieldbusError
from haptic_fieldbus.numerals import exactly, percent, rounded
from haptic_fieldbus.report.drawing import BLUE, GREEN, GREY, ORANGE, PURPLE, SKY, VERMILION, dress, figure, svg
from haptic_fieldbus.study.measure.bench import FEW_SCENES, Tools, library_scenes
from haptic_fieldbus.study.page.html import Cell, Context, Entry, Section, number_text, paragraph, picture, table

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
    "sampling and delay": (BLUE, ""),
    "encoder": (ORANGE, "//"),
    "tachometer": (ORANGE, "//"),
    "estimator": (GREEN, "\\\\"),
    "integrator": (PURPLE, "xx"),
    "limits": (GREY, "oo"),
    "torque step": (SKY, ".."),
    "torque loop": (VERMILION, "--"),
}

EXPLAINED = """Scenes of the library (quick report: one of each kind) run on the simulated bench (drive, bus, motor,
encoder) at 1 kHz for 3 s, each with its default hand. The ideal is the scene in continuous time on the true motion
of the handle. The error in contact covers moving contact only. Real effects are added one after another: sampling
and delay, encoder, velocity estimator, integrator, limits, torque step of the drive, torque loop. The shares of the
error sum to one; a negative share reduces the error of the others."""


def sources_section(context: Context) -> Section:
    """Run all scenes of the library, or a few for a quick report, and return their section."""
    names = FEW_SCENES if context.quick else library_scenes()
    scenes = context.with_progress(names, lambda scene: f"scene {scene}")
    found = [scene_error(context.tools, scene, SECONDS) for scene in scenes]
    led = scene_error(context.tools, LED, SECONDS, LED_HAND)
    known = [each for each in found if each.rms is not None]
    document = svg(draw(known))
    caption = "Shares of the mean square error by source. A negative share reduces the error of other sources."
    body = [paragraph(EXPLAINED), picture("sources", document, caption) if known else "", sources_table(found)]
    return Section(
        "sources",
        "Where the error comes from",
        "".join(body),
        (_finding(led),) if led.contact is not None else (),
        {"sources": document} if known else {},
        {"scenes": [asdict(each) for each in found], "led": asdict(led)},
    )


def draw(misfits: Sequence[ForceError]) -> Figure:
    """Return a figure with a bar for each scene, stacked from the shares of its sources."""
    drawn = figure(1.6 + max(0.28 * len(misfits), min(0.5 * len(misfits), 2.0)))
    panel = drawn.subplots()
    for row, misfit in enumerate(misfits):
        # Positive shares are stacked to the right of 0, negative ones to the left.
        ends = {True: 0.0, False: 0.0}
        for source, share in misfit.by_source.items():
            colour, hatch = COLOURS.get(source, (GREY, ""))
            panel.barh(row, share, left=ends[share >= 0.0], color=colour, hatch=hatch, edgecolor="white", height=0.62)
            ends[share >= 0.0] += share
    panel.set_yticks(range(len(misfits)), [misfit.scene for misfit in misfits])
    panel.set_ylim(len(misfits) - 0.4, -0.6)
    panel.axvline(0.0, color="#222222", linewidth=0.8)
    dress(panel, "error split by source", "share of the mean square error [1]", "")
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

    def row(misfit: ForceError) -> list[Entry]:
        if misfit.rms is None:
            return [misfit.scene, Cell(misfit.reason, "text"), *[""] * (3 + len(sources))]
        shares = [100.0 * misfit.by_source[s] if s in misfit.by_source else None for s in sources]
        contact = None if misfit.contact is None else 100.0 * misfit.contact
        energy = None if misfit.energy is None else 1e3 * misfit.energy
        return [
            misfit.scene,
            f"{number_text(misfit.rms)} {misfit.unit}",
            f"{number_text(misfit.max)} {misfit.unit}",
            contact,
            energy,
            *shares,
        ]

    headings = ("scene", "rms error", "largest error", "error in contact, % of force", "energy put in [mJ]",
                *(f"{source} [%]" for source in sources))  # fmt: skip
    return table(headings, map(row, misfits))


def _finding(led: ForceError) -> str:
    largest = max(led.by_source, key=lambda source: led.by_source[source])
    return (
        f"The wall of the library has a force error of {percent(led.contact or 0.0)} rms over "
        f"{rounded(led.contact_s, 2)} s of moving contact, with the handle moved to and fro once a second for "
        f"{exactly(SECONDS)} s (hand <code>{LED_HAND}</code>); people notice from about 8 %. "
        f"{percent(led.by_source[largest])} of the error is {largest}."
    )
