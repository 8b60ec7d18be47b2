"""`plan`: compile a scene for a bench and explain it; nothing is opened."""

import sys

from haptic_fieldbus.cli.options import (
    BusOption,
    DriveOption,
    EstimatorOption,
    JsonOption,
    MethodOption,
    NodeOption,
    RateOption,
    RigOption,
    SceneArgument,
    Selection,
    SetOption,
    note_assumed_bitrate,
)
from haptic_fieldbus.cli.screen import KEY_WIDTH, print_json, show


def plan(
    scene: SceneArgument,
    drive: DriveOption = None,
    bus: BusOption = None,
    node: NodeOption = None,
    rig: RigOption = None,
    rate: RateOption = 1000.0,
    settings: SetOption = None,
    method: MethodOption = None,
    estimator: EstimatorOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compile SCENE for a drive and explain what would run each period, and what is left out."""
    chosen = Selection(drive, bus, node, rig, rate, settings, method, estimator).arguments()
    show(note_assumed_bitrate(bus), sys.stderr)
    from haptic_fieldbus import api
    from haptic_fieldbus.explain import explain
    from haptic_fieldbus.result import plan_json

    compiled = api.plan(scene, **chosen)
    if as_json:
        print_json(plan_json(compiled))
    else:
        show((line[:KEY_WIDTH].strip(), line[KEY_WIDTH:]) for line in explain(compiled).splitlines())
