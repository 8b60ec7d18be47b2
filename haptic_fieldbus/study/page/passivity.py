"""Section on the passivity controller: stability, feel and cost of a wall with and without it."""

from collections.abc import Sequence
from dataclasses import asdict

from matplotlib.figure import Figure

from haptic_fieldbus.numerals import percent, rounded
from haptic_fieldbus.report.drawing import BLUE, INK, ORANGE
from haptic_fieldbus.study.measure.passivity import Decay, Felt, decays, felt, limit_share
from haptic_fieldbus.study.page.context import Context
from haptic_fieldbus.study.page.html import Entry, Section, paragraph, picture, table
from haptic_fieldbus.study.page.style import dress, figure, svg

QUICK, FULL = (0.5, 0.95, 1.05, 3.0), (0.25, 0.5, 0.75, 0.95, 1.05, 1.3, 1.6, 2.0, 2.5, 3.0)
"""Shares of the stability limit; both reports have those between which a finding lies, and tell the same."""
DURATION, TAPPED = 2.0, 4.0
"""Length of each run, and of the tap [s of virtual time]."""
NAMES = {False: "observer alone", True: "controller"}
COLOURS = {False: ORANGE, True: BLUE}

EXPLAINED = """A scene with <code>passivity = "controller"</code> has the energy that sampling and delay add taken back
by damping, as much as the observer sees: torque held over the displacement after it, against the energy that the
elements store. On the left and in the first table a handle is let go beside a bilateral wall, on the shipped bench
without Coulomb friction: below 1 each turn is smaller than the one before. The second table is a tap on the wall of the
library, where the bench would have taken that energy anyway: there the controller only costs feel."""


def passivity_section(context: Context) -> Section:
    """Measure decays and a tap, without and with the controller, and return their section."""
    shares = QUICK if context.quick else FULL
    found: list[Decay] = []
    for share in context.with_progress(shares, lambda share: f"passivity, {rounded(share)} of the limit"):
        found += decays(context.tools, (share,), DURATION)
    taps = felt(context.tools, TAPPED)
    document = svg(draw(found))
    caption = "Growth of a turn over stiffness, as a share of the limit of stability. Above the line the motion grows."
    body = [paragraph(EXPLAINED), picture("passivity", document, caption), _decay_table(found), _felt_table(taps)]
    return Section(
        "passivity",
        "Passivity controller",
        "".join(body),
        (_finding(found, taps),),
        {"passivity": document},
        {"decay": [asdict(each) for each in found], "tap": [asdict(each) for each in taps]},
    )


def draw(found: Sequence[Decay]) -> Figure:
    """Return a figure of the growth with and without the controller."""
    drawn = figure(3.4)
    panel = drawn.subplots()
    for controlled, name in NAMES.items():
        rows = [each for each in found if each.controlled == controlled]
        panel.plot([each.share for each in rows], [each.growth for each in rows], "o-", color=COLOURS[controlled],
                   label=name)  # fmt: skip
    panel.axhline(1.0, color=INK, linewidth=0.8, linestyle="--")
    dress(panel, "a handle let go beside a wall", "stiffness over its limit of stability [1]", "growth of a turn [1]")
    panel.legend(frameon=False, fontsize=9)
    return drawn


def _decay_table(found: Sequence[Decay]) -> str:
    headings = ("stiffness over its limit", "growth of a turn", "with the controller", "its largest force [N]",
                "energy it took [mJ]")  # fmt: skip
    pairs = zip(found[::2], found[1::2], strict=True)
    return table(headings, (_decay_row(plain, controlled) for plain, controlled in pairs), text_columns=0)


def _decay_row(plain: Decay, controlled: Decay) -> list[Entry]:
    energy = None if controlled.energy is None else 1e3 * controlled.energy
    return [plain.share, plain.growth, controlled.growth, controlled.peak, energy]


def _felt_table(taps: Sequence[Felt]) -> str:
    headings = ("a tap with", "error in contact, % of force", "energy put in [mJ]", "its largest force [N]",
                "periods in which it damps [%]")  # fmt: skip
    return table(headings, map(_felt_row, taps))


def _felt_row(tap: Felt) -> list[Entry]:
    scaled = [None if value is None else scale * value for scale, value in ((100.0, tap.error), (1e3, tap.energy))]
    return [NAMES[tap.controlled], *scaled, tap.peak, None if tap.periods is None else 100.0 * tap.periods]


def _finding(found: Sequence[Decay], taps: Sequence[Felt]) -> str:
    plain, controlled = limit_texts(found)
    told = f"A handle let go beside a wall swings further and further {plain}, with the controller {controlled}"
    before, after = (tap.error for tap in taps)
    if before is None or after is None:
        return f"{told}."
    return (
        f"{told}; a tap on the wall of the library has {percent(before)} of force error, and with it {percent(after)}."
    )


def limit_texts(found: Sequence[Decay]) -> tuple[str, str]:
    """Return where a handle begins to swing further and further, without and with the controller, in words."""
    return _limit_text(found, controlled=False), _limit_text(found, controlled=True)


def _limit_text(found: Sequence[Decay], *, controlled: bool) -> str:
    limit = limit_share(found, controlled=controlled)
    if limit is None:
        return f"at no stiffness up to {rounded(found[-1].share)} times its limit of stability"
    below, above = limit
    return f"at {rounded(above)} times its limit of stability, and not at {rounded(below)} times"
