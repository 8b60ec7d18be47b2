"""Parts of a page: text, tables and figures as HTML that needs no other file."""

import math
from base64 import b64encode
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from html import escape, unescape
from pathlib import Path
from typing import TypeVar

from haptic_fieldbus.numerals import DIGITS, rounded
from haptic_fieldbus.study.measure.bench import Bench, Tools
from haptic_fieldbus.study.measure.timing import Cost

Item = TypeVar("Item")
WIDE_CARD, CARD = (2.5, 6.73), (2.5, 5.6)
"""Height and width of figures on the first screen of the page, left and right [inches]."""

# Context that every section is given: bench, tools, choices, and the rows of the report.

Progress = Callable[[str, float], None]
"""Function called with a label of the present measurement, and the share that is done (0 to 1)."""


@dataclass(frozen=True)
class Context:
    """Arguments of a section; `quick` asks for shorter and coarser measurements."""

    tools: Tools
    bench: Bench
    quick: bool
    names: frozenset[str] | None = None
    """Names of the problems or cases to measure; None for all."""
    progress: Progress = lambda label, share: None
    rows: dict[str, list[dict[str, object]]] = field(default_factory=dict)
    """Rows of `report.json` by their key; sections add to them, and all share the same dictionary."""

    costs: list[Cost] = field(default_factory=list)
    """All measured costs, from which the noise of the machine is computed; also shared by all sections."""

    def is_chosen(self, name: str) -> bool:
        """Return whether a problem or case is to be measured."""
        return self.names is None or name in self.names

    def add(self, key: str, row: dict[str, object]) -> None:
        """Add a row to `report.json`."""
        self.rows.setdefault(key, []).append(row)

    def with_progress(self, items: Collection[Item], label: Callable[[Item], str]) -> Iterator[Item]:
        """Yield the items one after another, and report progress before each."""
        for place, item in enumerate(items):
            self.progress(label(item), place / len(items))
            yield item


STYLE = Path(__file__).with_name("page.css").read_text(encoding="utf-8")
"""Style sheet, which stands inside the page."""


@dataclass(frozen=True)
class Section:
    """Section of the report; `body` is HTML, `figures` are SVG documents by the name of their file."""

    name: str
    title: str
    body: str
    findings: tuple[str, ...] = ()
    """Sentences for the top of the page, as HTML."""
    figures: dict[str, str] = field(default_factory=dict)
    details: object = None
    """Entry of `details.json`; None for no entry."""
    card: "Card | None" = None
    """Place on the first screen; None for none."""


@dataclass(frozen=True)
class Card:
    """Place of a section on the first screen, where its first finding stands as the answer to a question."""

    question: str
    body: str
    """Figure or table, as HTML."""


@dataclass(frozen=True)
class Cell:
    """Entry of a table with a mark."""

    text: str
    kind: str
    """Class of the style sheet: `text`, `good` or `bad`; empty for none."""


def paragraph(text: str) -> str:
    """Return a paragraph; `text` is HTML, and is not escaped."""
    return f"<p>{text}</p>\n"


def picture(name: str, document: str, caption: str) -> str:
    """Return a figure with an SVG document inside the page; `caption` is HTML, and is not escaped."""
    # As an image with its own document, the SVG cannot clash with names or styles of the page.
    data = b64encode(document.encode()).decode()
    alternative = escape(_plain(caption), quote=True)
    return (
        f'<figure id="{escape(name)}"><img alt="{alternative}" src="data:image/svg+xml;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>\n"
    )


Entry = str | Cell | float | None


def table(headings: Sequence[str], rows: Iterable[Sequence[Entry]], text_columns: int = 1) -> str:
    """Return a table whose first `text_columns` are aligned as text, the others as numbers.

    Cells are escaped; floats and None are written by `number_text`.
    """
    head = "".join(
        f'<th class="text">{escape(word)}</th>' if place < text_columns else f"<th>{escape(word)}</th>"
        for place, word in enumerate(headings)
    )
    body = "".join(f"<tr>{''.join(_cell(cell, place < text_columns) for place, cell in enumerate(row))}</tr>\n"
                   for row in rows)  # fmt: skip
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}</tbody></table>\n"


def folded(summary: str, body: str) -> str:
    """Return a part that is folded until a reader opens it; `body` is HTML."""
    return f"<details><summary>{escape(summary)}</summary>{body}</details>\n"


def _cell(entry: Entry, is_text: bool) -> str:
    text = entry if isinstance(entry, str | Cell) else number_text(entry)
    marked = text if isinstance(text, Cell) else Cell(text, "text" if is_text else "")
    classes = " ".join(filter(None, [marked.kind, "text" if is_text and marked.kind != "text" else ""]))
    return f'<td class="{classes}">{escape(marked.text)}</td>' if classes else f"<td>{escape(marked.text)}</td>"


def _plain(text: str) -> str:
    """Return HTML without its tags."""
    parts = text.split("<")
    return parts[0] + "".join(part.partition(">")[2] for part in parts[1:])


def number_text(value: float | None, digits: int = DIGITS) -> str:
    """Return a number for a table, rounded to `digits`, or as a power of ten; – for None and NaN."""
    if value is None or math.isnan(value):
        return "–"
    if math.isinf(value):
        return "∞" if value > 0 else "-∞"
    return rounded(value, digits)


def multiple(factor: float, value: float | None) -> float | None:
    """Return a multiple of a value; None if the value is unknown."""
    return None if value is None else factor * value


def plain_text(text: str) -> str:
    """Return HTML as text, without tags and entities."""
    return unescape(_plain(text))


def page(title: str, lead: str, sections: Sequence[Section], assumed: str = "", warning: str = "") -> str:
    """Return the whole page: cards with the answers on the first screen, the other findings, and all sections.

    `lead`, `assumed` and `warning` are HTML.
    """
    cards = "".join(_card(section, section.card) for section in sections if section.card is not None)
    others = [found for section in sections for found in section.findings[section.card is not None :]]
    listed = "".join(f"<li>{finding}</li>" for finding in others)
    found = f'<div class="findings"><strong>Further findings</strong><ul>{listed}</ul></div>' if others else ""
    links = "".join(f'<a href="#{section.name}">{escape(section.title)}</a>' for section in sections)
    bodies = "".join(
        f'<section id="{section.name}"><h2>{escape(section.title)}</h2>\n{section.body}</section>\n'
        for section in sections
    )
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>\n'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">\n<style>\n{STYLE}</style></head>\n'
        f'<body><main><header id="first"><h1>{escape(title)}</h1>\n<p class="lead">{lead}</p>\n'
        f'{_block("busy", warning)}<div class="first">\n{cards}</div>\n{_block("assumed", assumed)}</header>\n'
        f"{found}\n<nav>{links}</nav>\n{bodies}</main></body></html>\n"
    )


def _block(kind: str, text: str) -> str:
    """Return a paragraph of this class; nothing without a text."""
    return f'<p class="{kind}">{text}</p>\n' if text else ""


def _card(section: Section, card: Card) -> str:
    """Return a card with a link to its section."""
    return (
        f'<div class="card"><h2><a href="#{section.name}">{escape(card.question)}</a></h2>'
        f"<p>{section.findings[0]}</p>\n{card.body}</div>\n"
    )
