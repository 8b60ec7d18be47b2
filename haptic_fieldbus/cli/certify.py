"""Command `certify`: the largest stiffness that is seen well damped on a bench, and the onset that taps tell."""

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

from haptic_fieldbus.cli.options import (
    OF_A_RUN,
    RENDERING,
    SceneOptions,
    check_plot,
    draw,
    note_assumed_bitrate,
    number,
    option,
    options_of,
)
from haptic_fieldbus.cli.output import never_wait
from haptic_fieldbus.cli.run import ask, instruct, tell_question
from haptic_fieldbus.cli.screen import plain, print_json, show
from haptic_fieldbus.numerals import in_unit, lines_of, object_of

KEYS = ("seen", "onset", "predicted", "bench", "date")
KEPT = ("seed", "yes")
"""Options of `run` that this command has too."""


@dataclass(frozen=True, kw_only=True)
class CertifyOptions(SceneOptions):
    """Options of `certify`."""

    by_hand: Annotated[
        bool, option(None, "You tap the handle yourself, up to the limit; else the drive does.", RENDERING, "--by-hand")
    ] = False
    share: Annotated[
        float, option("SHARE", "Largest stiffness, as a share of the onset.", RENDERING, default=0.8, parser=number)
    ] = 0.8
    above: Annotated[
        bool, option(None, "With --yes, go above the limit without asking; nobody holds.", None, "--above")
    ] = False


@options_of(CertifyOptions, without=[*(each for each in OF_A_RUN if each not in KEPT), "verbose"])
def certify(options: CertifyOptions) -> None:
    """Raise the stiffness of SCENE in steps and tap it: the largest one that is well damped, and the onset. Measure
    first: `identify`."""
    from haptic_fieldbus.api.certification import CertifyTask
    from haptic_fieldbus.api.certification import certify as raise_stiffness
    from haptic_fieldbus.api.provenance import picture_mark

    check_plot(options.plot)
    show(note_assumed_bitrate(options.bus), sys.stderr)
    talk = sys.stderr if options.as_json else sys.stdout

    def announce(told: Iterable[str]) -> None:
        show([("move" if place == 0 else "", line) for place, line in enumerate(told)], talk)
        talk.flush()

    if not sys.stdin.isatty():
        never_wait()
    mark = "" if options.plot is None else picture_mark(files=[options.rig] if options.rig else [])
    above = tell_question if options.above else None if options.yes or not sys.stdin.isatty() else ask
    found = raise_stiffness(
        CertifyTask(options.task(), options.by_hand, options.share, options.seed),
        confirm=tell_question if options.yes else ask,
        above=above,
        instruct=None if options.yes or not sys.stderr.isatty() else instruct,
        announce=announce,
        progress=lambda stiffness, unit: (
            show([("tapping", in_unit(stiffness, unit))], sys.stderr) if sys.stderr.isatty() else None
        ),
    )
    rows = list(found.rows())
    if options.as_json:
        print_json({key: plain(value) for key, value in object_of(rows, KEYS).items()})
    else:
        show(lines_of(rows))
    sys.stdout.flush()
    if options.plot is not None:
        from haptic_fieldbus.report.certificate_page import draw_certificate

        draw(options.plot, draw_certificate(found), mark)
        if not options.as_json:
            show([("plot", str(options.plot))])
