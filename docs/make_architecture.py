"""Draw docs/images/architecture.svg, the rooms of the package and who imports whom: `python docs/make_architecture.py`.

The rows are the layers of pyproject.toml and the arrows are the imports of the code. An arrow that follows from others
is left out, and so are those to the loose files at the bottom, which any room may import.
"""

import ast
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from pathlib import Path

import grimp

PROJECT = Path(__file__).resolve().parents[1]
PACKAGE = PROJECT / "haptic_fieldbus"
FILE = PROJECT / "docs" / "images" / "architecture.svg"

LEFT, MIDDLE, RIGHT, OUTSIDE = 82, 202, 322, 436
COLUMNS = {
    **dict.fromkeys(("running", "assessing", "cycle", "margins", "scenes", "numerics", "clock"), LEFT),
    **dict.fromkeys(("sim", "buses", "protocols", "eds", "schemas", "signals"), RIGHT),
    "drive": OUTSIDE,
}
"""Where a room stands in its row; the others stand in the middle."""
WIDTH, ROW, HEAD = 1080, 46, 52
BOX = (100, 28)
TEXT_AT, LONGEST = 506, 78
INK, SOFT, STRIPE, ARROW = "#1f2328", "#59636e", "#f6f8fa", "#818b98"
PURE, TOUCHING, LOOSE = ("#dafbe1", "#2da44e"), ("#ddf4ff", "#0969da"), ("#ffffff", "#818b98")
KINDS = {PURE: "pure: no bus, no clock, no threads", TOUCHING: "touches the world, or imports what does"}


def contract(words: str) -> dict[str, list[str]]:
    """The import contract whose name has these words."""
    settings = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    found: dict[str, list[str]] = next(
        each for each in settings["tool"]["importlinter"]["contracts"] if words in each["name"]
    )
    return found


def layers() -> list[list[str]]:
    """The rooms from the highest layer to the lowest."""
    return [[name.strip() for name in layer.split("|")] for layer in contract("every module stands here")["layers"]]


def imports() -> dict[str, set[str]]:
    """Which rooms each room imports, for types too; loose files are no rooms."""
    graph = grimp.build_graph("haptic_fieldbus", exclude_type_checking_imports=False, cache_dir=None)
    rooms = {name for layer in layers() for name in layer if (PACKAGE / name).is_dir()}
    found: dict[str, set[str]] = {room: set() for room in rooms}
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            ours, theirs = room_of(module), room_of(other)
            if ours in rooms and theirs in rooms and ours != theirs:
                found[ours].add(theirs)
    return found


def room_of(module: str) -> str:
    """The room that a module stands in; empty for the package itself."""
    return module.partition(".")[2].partition(".")[0]


def reduced(imported: Mapping[str, set[str]]) -> dict[str, set[str]]:
    """Without what follows from the rest."""
    return {
        room: others - {far for near in others for far in _below(near, imported)} for room, others in imported.items()
    }


def _below(room: str, imported: Mapping[str, set[str]]) -> set[str]:
    return imported[room].union(*(_below(other, imported) for other in imported[room]))


def sentence(name: str) -> str:
    """The first line of a room's docstring, as plain text."""
    path = PACKAGE / name / "__init__.py" if (PACKAGE / name).is_dir() else PACKAGE / f"{name}.py"
    text = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]
    text = text.replace("`", "").removesuffix(".")
    if len(text) > LONGEST:
        sys.exit(f"{path}: the first sentence has {len(text)} letters, and the picture has room for {LONGEST}")
    return text


def picture() -> str:
    """The text of the SVG file."""
    rows = layers()
    height = HEAD + len(rows) * ROW + 12
    places = {
        name: (COLUMNS.get(name, MIDDLE), HEAD + row * ROW + ROW // 2)
        for row, layer in enumerate(rows)
        for name in layer
    }
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
            'font-family="Helvetica, Arial, sans-serif">',
            "<title>The rooms of haptic_fieldbus and who imports whom</title>",
            f'<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto">'
            f'<path d="M0 0.8 8 4 0 7.2z" fill="{ARROW}"/></marker>',
            f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
            *_key(),
            *_stripes(rows),
            *_arrows(places),
            *(_box(name, *place) for name, place in places.items()),
            *(line for row, layer in enumerate(rows) for line in _words(layer, HEAD + row * ROW + ROW // 2)),
            "</svg>\n",
        ]
    )


def _key() -> Iterator[str]:
    at = LEFT - BOX[0] // 2
    yield f'<text x="{at}" y="21" font-size="13" fill="{INK}">An arrow: the upper room imports the lower one.</text>'
    yield (
        f'<text x="{at}" y="39" font-size="12" fill="{SOFT}">Not drawn: what follows from other arrows, and the loose '
        "files (dashed).</text>"
    )
    for place, ((fill, edge), words) in enumerate(KINDS.items()):
        y = 21 + 18 * place
        yield (
            f'<rect x="{TEXT_AT}" y="{y - 11}" width="20" height="13" rx="3" fill="{fill}" stroke="{edge}"/>'
            f'<text x="{TEXT_AT + 28}" y="{y}" font-size="12" fill="{SOFT}">{words}</text>'
        )


def _stripes(rows: Iterable[list[str]]) -> Iterator[str]:
    for row, _ in enumerate(rows):
        if row % 2 == 0:
            yield f'<rect y="{HEAD + row * ROW}" width="{WIDTH}" height="{ROW}" fill="{STRIPE}"/>'


def _arrows(places: Mapping[str, tuple[int, int]]) -> Iterator[str]:
    """From the lower edge of a room to the upper edge of another; several from one room leave side by side."""
    half = BOX[1] // 2
    for room, others in sorted(reduced(imports()).items()):
        across = sorted(others, key=lambda other: places[other])
        for number, other in enumerate(across):
            (x, y), (to_x, to_y) = places[room], places[other]
            start = x + round((number - (len(across) - 1) / 2) * 26)
            above = abs(start - to_x) < BOX[0] // 2
            end = start if above else to_x + max(-26, min(26, round((start - to_x) * 0.2)))
            bend = f"{start} {y + half + 16} {end} {to_y - half - 18}"
            yield (
                f'<path d="M{start} {y + half}C{bend} {end} {to_y - half - 1}" fill="none" stroke="{ARROW}" '
                'stroke-width="1.4" marker-end="url(#tip)"/>'
            )


def _box(name: str, x: int, y: int) -> str:
    fill, edge = _kind(name)
    width, height = BOX
    dashes = "" if (PACKAGE / name).is_dir() else ' stroke-dasharray="4 3"'
    return (
        f'<rect x="{x - width // 2}" y="{y - height // 2}" width="{width}" height="{height}" rx="5" fill="{fill}" '
        f'stroke="{edge}"{dashes}/>'
        f'<text x="{x}" y="{y + 5}" font-size="14" text-anchor="middle" fill="{INK}">{name}</text>'
    )


def _kind(name: str) -> tuple[str, str]:
    if not (PACKAGE / name).is_dir():
        return LOOSE
    return PURE if f"haptic_fieldbus.{name}" in contract("pure half")["source_modules"] else TOUCHING


def _words(layer: list[str], y: int) -> Iterator[str]:
    """Purposes of the rooms of a row; where there are several, each with its name."""
    for line, name in enumerate(layer):
        at = y + 4 + round((line - (len(layer) - 1) / 2) * 14)
        called = f'<tspan font-weight="bold">{name}</tspan>  ' if len(layer) > 1 else ""
        yield f'<text x="{TEXT_AT}" y="{at}" font-size="12" fill="{INK}">{called}{escape(sentence(name))}</text>'


if __name__ == "__main__":
    FILE.write_text(picture(), encoding="utf-8")
    print(FILE, file=sys.stderr)
