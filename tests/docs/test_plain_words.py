"""Everything that people read is written in plain words: phrases that were replaced once must not come back.

To keep another phrase out, add it to `PLAIN` with the plain words. To check more files, add them to `READ`.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from tests.cases import every

PROJECT = Path(__file__).resolve().parents[2]

PLAIN = {
    "a hand can tell": "people notice from 8 %",
    "above the cautious limit": "limit 750 N/m; 600 is inside, margin 1.25",
    "after it was left alone": "watchdog fired after 48.9 ms (set to 50 ms)",
    "asked for were": "set to 50 ms",
    "can only disappoint": "each step is safe to fail",
    "feels like the ideal": "feels right: force error 1.4 %",
    "in 1 of 100": "p99",
    "let a loop live": "run in real time",
    "let things go wrong": "simulate faults",
    "lets things go wrong": "simulates faults",
    "more than the ideal": "the loop added 8.6 mJ",
    "ms, alone": "host stopped: 51.4 ms (drive watchdog 50 ms)",
    "no more than a guess": "possible match",
    "nobody asked for": "unsolicited",
    "nobody is there to confirm": "no terminal to confirm on; add --yes",
    "of all that is random": "random seed",
    "passive at no stiffness": "not passive",
    "passive at none": "not passive",
    "periods that it takes": "accepted loop periods",
    "prove that your drives let go": "test the drive watchdog",
    "sign from torque to motion was not seen": "motor direction not confirmed",
    "somebody else is on": "another master on can0",
    "somebody else on the bus": "another master on the bus",
    "take back what excuses": "cancel the allowance",
    "taken on trust": "not tested",
    "the house on one page": "architecture",
    "the most telling alone": "root cause",
    "what a motion is multiplied by": "spectral radius 0.9993 (below 1 decays)",
    "what is given against what was stored": "trips when the loop puts out more than was stored",
    "µs as a rule": "median",
}
"""Phrase in small letters → the plain words that replace it."""

READ = (
    "README.md",
    "SECURITY.md",
    "CONTRIBUTING.md",
    "docker/**/*.md",
    "docs/*.py",
    "docs/**/*.md",
    "examples/**/*.md",
    "examples/**/*.py",
    "profiles/*.md",
)
"""Files that people read, as patterns of `Path.glob`."""

RIDDLE = re.compile(r"\s*\b(What|Who|Those)\b")
"""Opening of a docstring that names nothing; a noun or a verb says it."""
WITH_DOCSTRINGS = ("haptic_fieldbus", "tests", "docs", "benchmarks", "examples")
"""Folders of which every docstring is read."""

FILES = sorted({path for pattern in READ for path in PROJECT.glob(pattern)})
CODE = re.compile(r"^ *```.*?^ *```|`[^`\n]*`", re.MULTILINE | re.DOTALL)
"""Commands and output of the program; the program's own texts are checked in its files."""


def prose(path: Path) -> Iterator[str]:
    """Yield the texts of a page without its code, or the docstrings and other strings of a Python file."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".py":
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield node.value
    else:
        yield CODE.sub(" … ", text)


def phrases_in(text: str) -> list[str]:
    """Return the phrases of `PLAIN` in a text, also where a line ends inside one."""
    words = " ".join(text.split()).lower()
    return [phrase for phrase in PLAIN if phrase in words]


@every("path", FILES, ids=lambda path: str(path.relative_to(PROJECT)))
def test_what_people_read_has_none_of_the_phrases_that_were_replaced(path: Path) -> None:
    found = [f'"{phrase}": write "{PLAIN[phrase]}"' for text in prose(path) for phrase in phrases_in(text)]
    assert not found


def test_each_pattern_has_files() -> None:
    assert [pattern for pattern in READ if not list(PROJECT.glob(pattern))] == []


def test_a_phrase_is_found_at_the_end_of_a_line_and_in_a_docstring_but_not_in_shown_output(tmp_path: Path) -> None:
    page, program = tmp_path / "page.md", tmp_path / "program.py"
    page.write_text("# The House on\none page\n\n```text\n90 µs as a rule\n```\n\n`taken on trust`\n", encoding="utf-8")
    program.write_text('"""Take back what\nexcuses one."""\nTEXT = "taken " "on trust"\n', encoding="utf-8")
    assert [phrase for text in prose(page) for phrase in phrases_in(text)] == ["the house on one page"]
    assert [phrase for text in prose(program) for phrase in phrases_in(text)] == [
        "take back what excuses",
        "taken on trust",
    ]


def riddles_in(text: str) -> list[str]:
    """Return the opening lines of the docstrings, also of those behind an attribute, that begin with a riddle."""
    bare = [node.value for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Expr)]
    texts = [each.value for each in bare if isinstance(each, ast.Constant) and isinstance(each.value, str)]
    return [each.strip().splitlines()[0] for each in texts if RIDDLE.match(each)]


def test_no_docstring_begins_with_a_riddle() -> None:
    files = (path for folder in WITH_DOCSTRINGS for path in sorted((PROJECT / folder).rglob("*.py")))
    texts = ((path.relative_to(PROJECT), path.read_text(encoding="utf-8")) for path in files)
    # The search for the words is quick; only a file that has them is parsed.
    found = [f"{path}: {line}" for path, text in texts if RIDDLE.search(text) for line in riddles_in(text)]
    assert not found, "begin with a noun or a verb"


def test_a_riddle_is_found_wherever_a_docstring_stands() -> None:
    text = (
        '"""What it is."""\nA = 1\n"""Those of it."""\n\ndef f():\n    """\n    Who calls.\n    """\n    "Whatever"\n'
    )
    assert riddles_in(text) == ["What it is.", "Those of it.", "Who calls."]
