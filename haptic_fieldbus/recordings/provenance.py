"""Provenance of a run: all that is needed to repeat it in simulation, and to know on what it was made.

It is a part of the result, of `run --json`, of MCAP and Parquet files and of pictures. Formats that promise to be what
other programs write (candump, BLF, CSV) have it in a file beside them, `NAME.provenance.json`. The texts are those that
acted: settings, a part of the limit among them, are filled in, and a scene is one file with all that it includes. No
value of an option or an argument whose name says token, password or secret is kept.
"""

import json
import os
import re
import zlib
from base64 import b64encode
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from pathlib import Path, PurePath
from typing import Any, Literal

SIDE_SUFFIX = ".provenance.json"
"""Added to the whole name of a file that cannot hold its provenance."""
PICTURES = (".png", ".svg", ".pdf")
METADATA = "haptic_fieldbus.provenance"
"""Key of the metadata of MCAP and Parquet files, whose value is the JSON object."""
MARK = "haptic-fieldbus provenance "
"""In front of the compressed JSON object in the description of a picture."""
SECRET = re.compile(r"token|password|passwd|secret", re.IGNORECASE)
"""Names of options and arguments whose values are never kept."""
LONGEST_NAME = 200
_IN_NO_NAME = re.compile(r"[/\\:\x00-\x1f]")
"""Characters that no name of a file has on every system."""
_ARGUMENT = re.compile(rf"([^=,;\s]*(?:{SECRET.pattern})[^=,;\s]*=)[^,;]*", re.IGNORECASE)
_USER = re.compile(r"(://[^/@:]*:)[^/@]*@")
HIDDEN = "left out"


def digest(text: str | bytes) -> str:
    """Return the SHA-256 of a text in UTF-8, in hexadecimal."""
    return sha256(text.encode(errors="surrogateescape") if isinstance(text, str) else text).hexdigest()


@dataclass(frozen=True)
class RunText:
    """The text of a file that gives what acted in the run."""

    name: str
    """File name, such as wall.toml."""
    text: str
    sha256: str
    source: str | None = None
    """Path of the file that the caller named; None: none, or left out."""
    source_sha256: str | None = None
    """Digest of that file as it was."""

    @classmethod
    def of(cls, name: str, text: str, source: str | Path | None = None) -> "RunText":
        """Return the text with its digest, and with path and digest of the file that it comes from, if there is one."""
        name = _IN_NO_NAME.sub("_", name)[-LONGEST_NAME:]
        if not source or not (path := Path(source)).is_file():
            return cls(name, text, digest(text))
        return cls(name, text, digest(text), str(path), digest(path.read_bytes()))


@dataclass(frozen=True)
class Conditions:
    """How the run was made: arguments of `run`, with their defaults filled in."""

    rate: float
    """[Hz]"""
    duration: float
    """[s]; of a run that was stopped, up to its end."""
    hand: str
    """"none": no hand."""
    fade_in: float
    """[s]"""
    seed: int
    force: bool = False
    prove: bool = False
    method: str | None = None
    estimator: str | None = None
    changes: tuple[tuple[float, dict[str, float | str | bool]], ...] = ()
    """Times [s from operation enabled] and settings; those that were made, once the run is over."""
    ramp: float | None = None
    """Length of a change [s]."""
    led: tuple[tuple[int, str, float | str | None], ...] | None = ()
    """Commands to the hand on the page of the live view: period, axis and place, none to let go; or no axis and the
    name of a hand that took all handles. None: more than is kept."""
    in_place_of_real: tuple[str, ...] = ()
    """Buses of the rig that were simulated in the place of real ones, whose delays were assumed."""


@dataclass(frozen=True)
class Provenance:
    """Texts, conditions, time, place and versions of a run."""

    version: str
    """Version of this package."""
    versions: dict[str, str]
    """Versions of Python and of the packages that a run uses."""
    date: str
    """Begin of the run in UTC, ISO 8601."""
    command: tuple[str, ...]
    """Command line of the process."""
    system: str
    """Operating system and machine."""
    host: str | None
    user: str | None
    scene: RunText | None
    """None: an element is an object of Python, which no file can give."""
    rig: RunText
    profiles: tuple[RunText, ...]
    faults: RunText | None
    settings: dict[str, Any]
    """Settings as they were given; the texts have them filled in."""
    conditions: Conditions
    bus: str
    """Name of the bus, or those of all buses."""
    simulated: bool
    rehearsed: bool = False
    """True for a run whose buses counted as real ones, while this program simulated the drives, as in `rehearse`."""
    drives: dict[str, dict[str, str | int | None]] = field(default_factory=dict)
    """By axis: title, vendor, product, revision and serial number that the drive reported."""
    schema: Literal[1] = 1

    def to_json(self) -> dict[str, Any]:
        """Return the JSON object; of an object of Python that acted, its name."""
        table = asdict(self)
        names = {key: table["conditions"][key] for key in ("hand", "method", "estimator")}
        table["conditions"] |= {key: None if name is None else str(name) for key, name in names.items()}
        return {"schema": self.schema, **table}

    @property
    def scene_name(self) -> str:
        """Name of the scene; "scene of Python" where no file can give it."""
        return "scene of Python" if self.scene is None else self.scene.name.removesuffix(".toml")

    def text(self) -> str:
        """Return the JSON object as a text in one line, with ASCII characters alone."""
        return json.dumps(self.to_json())

    def __repr__(self) -> str:
        return f"Provenance({self.version}, {self.date}, scene={getattr(self.scene, 'name', None)!r})"

    def ended(
        self,
        periods: int | None,
        changes: Sequence[tuple[float, Mapping[str, Any]]],
        led: Sequence[tuple[int, str, float | str | None]] | None = (),
    ) -> "Provenance":
        """Return the provenance of a run that was stopped after so many periods (None: it was not), with its changes.

        Of these the times are known to the period, so each is made in the same one again. One that began with the end
        of the run acted on nothing and is left out.
        """
        made = self.conditions if periods is None else replace(self.conditions, duration=periods / self.conditions.rate)
        acted = tuple((time, dict(each)) for time, each in changes if time < made.duration)
        return replace(self, conditions=replace(made, changes=acted, led=None if led is None else tuple(led)))

    @property
    def mark(self) -> str:
        """Text for the description of a picture, from which `read_provenance` reads it back."""
        return marked(self.text())


def marked(text: str) -> str:
    """Return the description of a picture that holds a JSON object."""
    return MARK + b64encode(zlib.compress(text.encode(), 9)).decode()


def hidden(text: str) -> str:
    """Return a text such as the name of a bus without the values of secret arguments: `KEY=VALUE`, `USER:VALUE@`."""
    return _USER.sub(rf"\1{HIDDEN}@", _ARGUMENT.sub(rf"\1{HIDDEN}", text))


def scrubbed(command: Sequence[str], *, paths: bool = True) -> tuple[str, ...]:
    """Return a command line without the values of secret options; without folders unless `paths`."""
    found: list[str] = []
    hide = False
    for word in command:
        name, equals, _ = word.partition("=")
        secret = word.startswith("-") and bool(SECRET.search(name))
        shown = HIDDEN if hide else f"{name}={HIDDEN}" if secret and equals else hidden(word)
        if not paths and os.sep in shown:  # the name of a folder may be that of a person
            shown = PurePath(shown).name if PurePath(shown).suffix or not found else HIDDEN
        found.append(shown)
        hide = secret and not equals
    return tuple(found)


def without_secrets(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table without the values of secret keys, at any depth."""
    return {key: HIDDEN if SECRET.search(key) else _without(value) for key, value in table.items()}


def _without(value: Any) -> Any:
    if isinstance(value, Mapping):
        return without_secrets(value)
    return [_without(each) for each in value] if isinstance(value, list | tuple) else value


def side_file(path: Path) -> Path:
    """Return the file beside a recording that holds its provenance."""
    return path.with_name(path.name + SIDE_SUFFIX)


COUNTED = (".csv", ".log")
"""Suffixes of recordings that do not tell by themselves whether they have their end."""


def write_beside(path: Path, provenance: Provenance, count: int | None = None) -> None:
    """Write the provenance beside a recording, with the number of its rows or frames once it is complete.

    Raises OSError.
    """
    table = provenance.to_json() | ({"count": count} if path.suffix in COUNTED else {})
    with replacing(side_file(path)) as new:
        new.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


@contextmanager
def replacing(target: Path, suffix: str = ".new") -> Iterator[Path]:
    """Yield the name of a new file beside the target, which takes its place once the block has written it."""
    new = target.with_name(f"{target.name}{suffix}")
    try:
        yield new
        new.replace(target)
    finally:
        with suppress(OSError):  # it has another name, or was not begun
            new.unlink()
