"""The line of each key of a TOML text.

`tomllib` does not keep positions, so tree-sitter parses the text a second time, only when there is a fault. Paths are
those of the data: ("element", 0, "stiffness"). Lines count from 1.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass

import tree_sitter
import tree_sitter_toml

from haptic_fieldbus.documents.expected import KeyPath


@dataclass(frozen=True)
class Position:
    """The line of a key, and its value as it is written."""

    line: int
    text: str = ""
    """Empty for a table."""
    implied: bool = False
    """True for a table without a header of its own: the line is that of the first key or header below it."""


class Positions:
    """The lines of all keys of a text, even of a text that breaks the rules of TOML."""

    def __init__(self, text: str) -> None:
        self.duplicates: list[tuple[KeyPath, int, int]] = []
        """Duplicate keys, with the lines of the second and of the first occurrence."""
        self._positions: dict[KeyPath, Position] = {}
        self._array_sizes: dict[KeyPath, int] = {}
        parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_toml.language()))
        for node in parser.parse(text.encode()).root_node.named_children:
            if node.type == "pair":
                self._read_pairs([node], ())
            elif node.type in ("table", "table_array_element"):
                self._read_table(node)

    def line(self, path: KeyPath) -> int | None:
        """Return the line of a key, or of the innermost written table around it; None when there is none."""
        tables = (path[:length] for length in range(len(path), 0, -1))
        return next((self._positions[table].line for table in tables if table in self._positions), None)

    def text(self, path: KeyPath) -> str:
        """Return the value of a key as it is written; empty for a table and for a missing key."""
        return self._positions[path].text if path in self._positions else ""

    def _read_table(self, node: tree_sitter.Node) -> None:
        """Note a header and the pairs below it."""
        # A broken header may have no children; then the node itself is no key either, and is passed over.
        header, *rest = [child for child in node.named_children if child.type != "comment"] or [node]
        keys = _keys(header)
        if not keys:
            return
        if node.type == "table":
            path = self._resolve(keys)
        else:
            array = (*self._resolve(keys[:-1]), keys[-1])
            index = self._array_sizes.get(array, 0)
            self._array_sizes[array] = index + 1
            path = (*array, index)
            self._positions.setdefault(array, Position(header.start_point.row + 1, implied=True))
        self._write(path, header)
        self._read_pairs([child for child in rest if child.type == "pair"], path)

    def _resolve(self, keys: list[str]) -> KeyPath:
        """Return the path of a header; a table below an array of tables belongs to the last element of the array."""
        path: KeyPath = ()
        for key in keys:
            path = (*path, key)
            if path in self._array_sizes:
                path = (*path, self._array_sizes[path] - 1)
        return path

    def _read_pairs(self, pairs: list[tree_sitter.Node], table: KeyPath) -> None:
        """Note pairs and the contents of their values, with a stack: nesting may be deeper than recursion allows."""
        stack = [(pair, table) for pair in reversed(pairs)]
        while stack:
            node, path = stack.pop()
            if node.type != "pair":
                self._write(path, node, node.text or b"")
                stack.extend(_contents(node, path))
                continue
            parts = [child for child in node.named_children if child.type not in ("comment", "ERROR")]
            keys = _keys(parts[0]) if len(parts) > 1 else []
            if keys:
                inner = (*path, *keys)
                self._write(inner, parts[0], parts[-1].text or b"")
                stack.extend(_contents(parts[-1], inner))

    def _write(self, path: KeyPath, node: tree_sitter.Node, value: bytes = b"") -> None:
        line, before = node.start_point.row + 1, self._positions.get(path)
        if before is not None and not before.implied:
            self.duplicates.append((path, line, before.line))
            return
        self._positions[path] = Position(line, value.decode(errors="replace"))
        for length in range(len(path) - 1, 0, -1):
            self._positions.setdefault(path[:length], Position(line, implied=True))


def _contents(value: tree_sitter.Node, path: KeyPath) -> Iterator[tuple[tree_sitter.Node, KeyPath]]:
    """Yield the contents of an array or an inline table, last first, for a stack."""
    if value.type == "array":
        items = [child for child in value.named_children if child.type not in ("comment", "ERROR")]
        yield from ((item, (*path, index)) for index, item in reversed(list(enumerate(items))))
    elif value.type == "inline_table":
        yield from ((child, path) for child in reversed(value.named_children) if child.type == "pair")


def _keys(node: tree_sitter.Node) -> list[str]:
    """Return the parts of a bare, quoted or dotted key; empty when the node is no key."""
    if node.type not in ("bare_key", "quoted_key", "dotted_key"):
        return []
    try:
        # tomllib removes quotes and splits dots by the rules of TOML.
        data: object = tomllib.loads(f"{(node.text or b'').decode(errors='replace')} = 0")
    except (tomllib.TOMLDecodeError, RecursionError):
        return []
    keys: list[str] = []
    while isinstance(data, dict):
        keys.extend(data)
        data = next(iter(data.values()), 0)
    return keys
