"""Command `plan`: compile a scene for a bench and explain the plan; no bus is opened."""

import sys

from haptic_fieldbus.cli.options import BenchOptions, note_assumed_bitrate, options_of
from haptic_fieldbus.cli.screen import KEY_WIDTH, print_json, show


@options_of(BenchOptions)
def plan(options: BenchOptions) -> None:
    """Compile SCENE for a drive and explain the plan: the steps of each period, and all that is left out."""
    from haptic_fieldbus import api
    from haptic_fieldbus.planning.explain import explain
    from haptic_fieldbus.planning.plan_json import plan_json
    from haptic_fieldbus.planning.task import Task

    task = options.given(Task)
    show(note_assumed_bitrate(options.bus), sys.stderr)
    compiled = api.plan.of(task)
    if options.as_json:
        print_json(plan_json(compiled))
    else:
        # `explain` writes the same column of keys; taken apart, the keys become bold and long lines are wrapped.
        show((line[:KEY_WIDTH].strip(), line[KEY_WIDTH:]) for line in explain(compiled).splitlines())
