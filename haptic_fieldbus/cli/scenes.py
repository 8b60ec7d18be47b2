"""Commands `scenes list|show|check`: the scene library, and the parameters of each scene."""

import sys
from collections.abc import Iterator
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from haptic_fieldbus.cli.options import JsonOption
from haptic_fieldbus.cli.screen import check_files, print_json, show, show_table
from haptic_fieldbus.errors import PlanError
from haptic_fieldbus.numerals import exactly

if TYPE_CHECKING:
    from haptic_fieldbus.scenes.scene import Scene

app = typer.Typer(help="List, show and check scenes: what the hand feels.", no_args_is_help=True)


@app.command("list")
def list_scenes(as_json: JsonOption = False) -> None:
    """List the shipped scenes, and the elements that other packages add."""
    from haptic_fieldbus.scenes.catalogue import scene_summaries
    from haptic_fieldbus.scenes.registry import own_elements

    summaries, own = scene_summaries(), own_elements()
    if as_json:
        print_json({"scenes": summaries, "own_elements": own})
        return
    show_table(
        ("name", "axes", "description"),
        ((str(each["name"]), ", ".join(each["axes"]), str(each["description"])) for each in summaries),
    )
    if own:
        show([(None, "")])
        show_table(("own element", "package", "entry point"), ((e.kind, e.package, e.entry_point) for e in own))
    show([("fault", each.fault) for each in own if each.fault is not None], sys.stderr)


@app.command("show")
def show_scene(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A scene by name, or the path of its file.")],
    as_json: JsonOption = False,
) -> None:
    """Show the axes of a scene, and every parameter that --set can change."""
    from haptic_fieldbus.scenes.catalogue import load_scene

    scene = load_scene(name)
    if as_json:
        from haptic_fieldbus.api import plan
        from haptic_fieldbus.scenes.registry import kind_of

        limit = plan(scene).stability  # on the default bench
        elements: Any = scene.elements
        print_json(
            {
                "name": scene.name,
                "description": scene.description,
                "axes": [{"name": axis.name, "workspace": axis.workspace} for axis in scene.axes],
                # The kind of an element that no scene file can name is None.
                "elements": [{"kind": kind_of(type(element)), **asdict(element)} for element in elements],
                "source": scene.source,
                "made_for": scene.made_for,
                "limit": None if limit is None else limit.to_json()["limit"],
            }
        )
        return
    show([(None, f"{scene.name}: {scene.description}"), (None, scene.source), (None, "")])
    show([("axis", f"{axis.name}: {axis.workspace.value}") for axis in scene.axes])
    show([("made for", str(scene.made_for))] if scene.made_for else [])
    show([(None, "")])
    show_table(("parameter", "value", "unit"), _rows(scene))
    show([(None, "")])
    show([("limit", f"{name}: {text}") for name, text in _limits(scene)])


@app.command("check")
def check_scenes(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Names or paths; default: all shipped scenes.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check scenes, and list all faults of each file with line and key."""
    from haptic_fieldbus.scenes.catalogue import load_scene, scene_names

    check_files(names or scene_names(), load_scene, as_json)


def _limits(scene: "Scene") -> Iterator[tuple[str, str]]:
    """Yield each usable shipped profile with the limit on its shipped bench, or the reason for no limit."""
    from haptic_fieldbus.api import plan
    from haptic_fieldbus.planning.explain import limit_text
    from haptic_fieldbus.protocols.catalogue import load_profile, profile_folder, profile_names
    from haptic_fieldbus.protocols.registry import protocol_named

    for name in profile_names():
        path = str(profile_folder() / f"{name}.toml")  # an own profile may have the same name
        profile = load_profile(path)
        if profile.drive.usable:
            bus = protocol_named(profile.drive.protocol).simulated_bus(profile)
            try:
                yield name, limit_text(plan(scene, drive=path, bus=bus).stability)
            except PlanError as error:  # a motor that goes straight renders no rotary scene
                yield name, str(error)


def _rows(scene: "Scene") -> Iterator[tuple[str, str, str]]:
    """Yield name, value and unit of each parameter that `--set` can change."""
    from haptic_fieldbus.scenes.registry import parameters, quantities
    from haptic_fieldbus.scenes.scene import axes_of

    workspaces = {axis.name: axis.workspace for axis in scene.axes}
    for element in scene.elements:
        space, measured = workspaces[axes_of(element)[0]], quantities(type(element))
        for key in parameters(type(element)):
            value = getattr(element, key)
            unit = measured[key].unit(space) if key in measured and value is not None else ""
            yield f"{element.name}.{key}", _shown(value), unit


def _shown(value: object) -> str:
    """Return a value as in a scene file; a hyphen for None."""
    if isinstance(value, float):
        return exactly(value)
    return "-" if value is None else str(value).lower() if isinstance(value, bool) else str(value)
