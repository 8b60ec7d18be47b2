"""The page: NiceGUI draws its controls, `assets/client.js` its pictures.

A control sends its command through the WebSocket of the page (`haptic.send` of the script), so that one place decides
who steers. Answers come back here: `Controls.show` sets the values that are in force.
"""

import asyncio
import json
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from nicegui import app, ui

from haptic_fieldbus.numerals import rounded, rounded_limit

ASSETS = Path(__file__).parent / "assets"
SPEEDS = {"real time": 1.0, "1/4": 0.25, "1/10": 0.1, "1/50": 0.02}
SPANS = {"2 s": 2, "5 s": 5, "10 s": 10}
_html = partial(ui.html, sanitize=False)
STARTING = 60.0
"""Time for which a page waits for the run to begin [s]."""
HANDS_SHOWN = {"push": "push", "tap": "tap", "push, then release": "release", "none (drag the handle)": "none"}
NO_TRIGGER = "hold at a trip"
FACTS = ("drive", "link", "lateness", "bus load", "energy", "pictures")
CHARTS = (("position", "Position"), ("force", "Force asked and given"), ("error", "Error: given less asked"))


class Source:
    """Description of the run from which pages are made, once it is known, and their controls."""

    def __init__(self) -> None:
        self.hello: dict[str, Any] = {}
        self.first: dict[str, float] = {}
        """Values of the parameters in the file of the scene."""
        self.controls: dict[str, Controls] = {}
        self.known = asyncio.Event()


def build(hub: Source) -> None:
    """Register the page; `hub` is what is between it and the run."""
    app.add_static_files("/assets", ASSETS)

    @ui.page("/", response_timeout=STARTING)
    async def page() -> None:
        await asyncio.wait_for(hub.known.wait(), STARTING - 1.0)
        client = ui.context.client
        controls = Controls(hub.hello, hub.first)
        hub.controls[client.id] = controls
        client.on_delete(lambda: hub.controls.pop(client.id, None))
        ui.add_head_html('<link rel="stylesheet" href="/assets/page.css">')
        ui.add_body_html(
            f'<script>window.hapticClient = "{client.id}";</script><script src="/assets/client.js"></script>'
        )


class Controls:
    """The controls of one page."""

    def __init__(self, hello: dict[str, Any], first: dict[str, float]) -> None:
        """Draw them in the present context of NiceGUI."""
        self._sliders: dict[str, tuple[ui.slider, ui.input, ui.html]] = {}
        self._first = first
        self._steered: list[Any] = []
        ui.query(".nicegui-content").classes("page")
        with ui.element("header"):
            self._head(hello)
        _html('<div id="lost" role="alert" hidden></div><div id="trip" role="alert" hidden></div>')
        with ui.element("main"):
            self._pictures(hello)
            with ui.element("aside"):
                self._facts(hello)
                self._parameters(hello)
                if hello["simulated"]:
                    self._simulation(hello)

    def _head(self, hello: dict[str, Any]) -> None:
        bench, scene = hello["bench"], escape(hello["scene_text"], quote=True)
        kind = "simulation" if hello["simulated"] else "real drive"
        _html(
            f"<h1 title='{scene}'>{scene}</h1><p title='{escape(bench, quote=True)}'>"
            f"<b class='is-{kind.split()[0]}'>{kind}</b> {escape(bench)}</p>"
        ).classes("title")
        _html('<span id="state" role="status">–</span><span id="time">–</span>').classes("state")
        _button("contrast", "Light or dark", "haptic.theme()")
        _html(
            '<button id="stop" type="button">STOP<small>Esc</small></button>'
            "<small>no emergency stop: it needs this page and the computer</small>"
        ).classes("stop")

    def _pictures(self, hello: dict[str, Any]) -> None:
        with ui.element("section").classes("pictures"):
            with ui.element("div").classes("handles"):
                for axis in hello["axes"]:
                    _canvas("handle", axis["name"], f"Handle of axis {axis['name']} and what it touches")
            with ui.element("div").classes("laws"):
                for axis in hello["axes"]:
                    _canvas("law", axis["name"], f"Force over position of axis {axis['name']}")
            with ui.element("div").classes("charts"):
                with ui.element("div").classes("tools"):
                    _button("pause", "Hold the charts; the run goes on (key H)", "haptic.hold()", "hold")
                    _button(None, "Save the window as CSV", "haptic.saveCsv()", text="CSV")
                    _button(None, "Save the window as PNG", "haptic.savePng()", text="PNG")
                    columns = {name: name for name in hello["columns"]}
                    triggers = {NO_TRIGGER: None, **columns}
                    _choice(triggers, NO_TRIGGER, "Column that holds the charts", "haptic.arm({column: value})")
                    level = ui.number(placeholder="level").props('dense borderless step=any aria-label="Level"')
                    level.on("update:model-value", js_handler=_JS_LEVEL)
                    _html('<span id="cursor"></span>')
                    _choice(SPANS, "5 s", "Time that is shown", "haptic.span(value)")
                for name, title in CHARTS:
                    with ui.element("div").classes("chart"):
                        _canvas("chart", name, title)
                        label, script = f"Columns of the chart {name}", f"haptic.columns({json.dumps(name)}, value)"
                        choice = _choice(columns, None, label, script, many=True)
                        choice.props('display-value="columns"').classes("columns")

    def _facts(self, hello: dict[str, Any]) -> None:
        rows = "".join(f"<dt>{name}</dt><dd id='fact-{name.replace(' ', '-')}'>–</dd>" for name in FACTS)
        _html(f"<h2>State</h2><dl>{rows}</dl>").classes("card facts")

    def _parameters(self, hello: dict[str, Any]) -> None:
        with ui.element("div").classes("card parameters"):
            _html("<h2>Parameters</h2><p id='role' role='status'></p>")
            self._limits = _html(_limits(hello))
            with ui.element("div").classes("list"):
                for each in hello["parameters"]:
                    self._parameter(each)
            _html('<p id="answer" role="status" aria-live="polite"></p>')
            with ui.element("div").classes("buttons"):
                self._steered += [_button("undo", "Back to the values of the file", "haptic.reset()", text="reset")]
                _button("content_copy", "Copy the command line with these values", "haptic.copy()", text="copy command")

    def _parameter(self, told: dict[str, Any]) -> None:
        """Draw name, number, slider and scale of one parameter."""
        name = told["name"]
        with ui.element("div").classes("parameter") as row:
            _html(f"<label>{escape(name).replace('.', '.<wbr>').replace('_', '_<wbr>')}</label>")
            number = ui.input(value=rounded_limit(told["value"])).props(
                f'dense borderless type=number step=any suffix="{told["unit"]}" aria-label="{name}"'
            )
            slider = ui.slider(min=told["low"], max=told["high"], step=told["step"], value=told["value"])
            slider.props(f'dense aria-label="{name}" data-name="{name}"')
            scale = _html(_scale(told)).classes("scale")
        asked = json.dumps(name)
        slider.on("update:model-value", js_handler=f"(value) => haptic.meant({asked}, value)")
        slider.on("change", js_handler=f"(value) => haptic.change({asked}, value)")
        number.on("change", js_handler=f"(value) => haptic.change({asked}, value)")
        self._sliders[name] = slider, number, scale
        if told["fixed"]:
            row.props(f'title="{told["fixed"]}: begin a new run for this parameter"')
            slider.disable()
            number.disable()
        else:
            self._steered += [slider, number]

    def _simulation(self, hello: dict[str, Any]) -> None:
        with ui.element("div").classes("card simulation"):
            _html("<h2>Simulation</h2>")
            with ui.element("div").classes("buttons"):
                self._steered += [
                    _button("pause", "Pause or go on (key P)", "haptic.pause()", "pause", text="pause"),
                    _button("skip_next", "One period forward (key N)", "haptic.step()", text="step"),
                ]
            pace = next((name for name, speed in SPEEDS.items() if speed == hello["speed"]), "real time")
            hands = {value: name for name, value in HANDS_SHOWN.items()}
            held = hands.setdefault(hello["hand"], hello["hand"])
            chosen = [
                _choice(SPEEDS, pace, "Speed", "haptic.send({speed: value})"),
                _choice({name: value for value, name in hands.items()}, held, "Hand", "haptic.send({hand: value})"),
            ]
            if scenes := {name: name for name in [hello["scene"], *hello["scenes"]] if hello["scenes"]}:
                label = "Scene; ends this run and begins anew"
                chosen += [_choice(scenes, hello["scene"], label, "haptic.scene(value)")]
            for each in chosen:
                each.props(f'outlined :borderless=false label="{each.props["aria-label"]}"')
            self._steered += chosen

    # What comes back.

    def show(self, hello: dict[str, Any], message: dict[str, Any]) -> None:
        """Show the values in force after a change, or after one that was refused."""
        if "scene" in message or "refused" in message:
            self._limits.set_content(_limits(hello))
            for told in hello["parameters"]:
                slider, number, scale = self._sliders[told["name"]]
                slider.set_value(told["value"])
                number.set_value(rounded_limit(told["value"]))
                slider.update()  # also where the page has moved it meanwhile
                number.update()
                scale.set_content(_scale(told))

    def enable(self, steers: bool) -> None:
        """Let the controls act, or not, in a page that only looks."""
        for each in self._steered:
            each.set_enabled(steers)


_JS_LEVEL = "(value) => haptic.arm({level: value === '' || value === null ? NaN : Number(value)})"


def _choice(options: dict[str, Any], value: str | None, label: str, script: str, *, many: bool = False) -> ui.select:
    """Return a list that runs a script with the `value` of the option that is chosen, or with those of many."""
    choice = ui.select([*options], value=value, multiple=many)
    choice.props(f'dense options-dense borderless aria-label="{label}"')
    chosen = "option.map((each) => options[each.label])" if many else "options[option.label]"
    handler = f"(option) => {{ const options = {json.dumps(options)}, value = {chosen}; {script}; }}"
    return choice.on("update:model-value", js_handler=handler)


def _button(icon: str | None, label: str, script: str, name: str = "", *, text: str = "") -> ui.button:
    """Return a small button that runs a script; the label is its tooltip and its name for a screen reader."""
    button = ui.button(text, icon=icon, color=None).props(f'flat dense no-caps aria-label="{label}" title="{label}"')
    if name:
        button.props(f'id="{name}"')
    return button.on("click", js_handler=f"() => {script}")


def _canvas(kind: str, name: str, label: str) -> None:
    attributes = f'data-kind="{kind}" data-name="{escape(name, quote=True)}" aria-label="{escape(label, quote=True)}"'
    _html(f"<canvas {attributes} role='img' tabindex='0'></canvas>").classes(f"picture {kind}")


def _limits(hello: dict[str, Any]) -> str:
    """Return the limits of the scene, a line for each group of axes."""
    return "".join(f"<p class='limit'>Limit: {escape(text)}</p>" for text in hello["limits"])


def _scale(told: dict[str, Any]) -> str:
    """Return the scale below a slider: its ends, and the limit with the part above it hatched."""
    low, high, limit = told["low"], told["high"], told["limit"]
    marks = f"<i>{rounded(low)}</i><i class='end'>{rounded(high)}</i>"
    if limit is None or not low < limit < high:
        return marks
    place = 100.0 * (limit - low) / (high - low)
    title = f"limit {rounded_limit(limit)} {told['unit']}".rstrip()
    return (
        f"<s style='left:{place:.2f}%'></s>"
        f"<b style='left:{place:.2f}%' data-limit='{limit!r}'>{escape(title)}</b>"
        f"<i>{rounded(low)}</i>"
    )
