"""The values that a schema allows at a key, in plain words.

The schema is Pydantic's JSON Schema of a dataclass; only the keywords in these schemas are read.
"""

from typing import Any

from haptic_fieldbus.numerals import exactly

Schema = dict[str, Any]
KeyPath = tuple[str | int, ...]

_PLAIN = {"string": "a string", "boolean": "true or false", "object": "a table", "null": "nothing"}


class Expectation:
    """The schema of one kind of table, searched by key."""

    def __init__(self, schema: Schema) -> None:
        self._root = schema

    def nodes(self, path: KeyPath, value: object) -> list[Schema]:
        """Return the schemas allowed at `path`; `value` is the whole table; its `kind`s select union members."""
        nodes = self._alternatives(self._root, value)
        for step in path:
            value = child(value, step)
            children = [inner for node in nodes for inner in _children(node, step)]
            nodes = [leaf for inner in children for leaf in self._alternatives(inner, value)]
        return nodes

    def names(self, path: KeyPath, value: object) -> list[str]:
        """Return the keys that the table at `path` may have."""
        return [name for node in self.nodes(path, value) for name in node.get("properties", {})]

    def choices(self, path: KeyPath, value: object) -> list[str]:
        """Return the words allowed at `path`; empty if it takes no words, or any text."""
        allowed = [choice for node in self.nodes(path, value) for choice in _constants(node)]
        return [choice for choice in allowed if isinstance(choice, str)]

    def describe(self, path: KeyPath, value: object, *, hexadecimal: bool = False) -> str:
        """Return the values allowed at `path` in words, such as "a number above 0"; "a value" for an unknown key."""
        described = [_describe(node, hexadecimal) for node in self.nodes(path, value)]
        return " or ".join(dict.fromkeys(described)) or "a value"

    def _alternatives(self, node: Schema, value: object) -> list[Schema]:
        while "$ref" in node:
            node = self._root["$defs"][node["$ref"].rpartition("/")[2]]
        union = node.get("anyOf") or node.get("oneOf")
        if not union:
            return [node]
        if "discriminator" in node:
            chosen = node["discriminator"]["mapping"].get(str(child(value, node["discriminator"]["propertyName"])))
            union = [{"$ref": chosen}] if chosen else union
        leaves = [leaf for option in union for leaf in self._alternatives(option, value)]
        # TOML has no null: None is a key that is left out.
        return [leaf for leaf in leaves if leaf.get("type") != "null"]


def child(value: object, step: str | int) -> object:
    """Return the value below `step`; None when there is none."""
    if isinstance(value, dict):
        return value.get(step)
    if isinstance(value, list) and isinstance(step, int) and step < len(value):
        return value[step]
    return None


def _children(node: Schema, step: str | int) -> list[Schema]:
    if isinstance(step, int):
        fixed = node.get("prefixItems", [])
        item = fixed[step] if step < len(fixed) else node.get("items")
    else:
        item = node.get("properties", {}).get(step, node.get("additionalProperties"))
    return [item] if isinstance(item, dict) else []


def _constants(node: Schema) -> list[object]:
    return list(node["enum"]) if "enum" in node else [node["const"]] if "const" in node else []


def _describe(node: Schema, hexadecimal: bool) -> str:
    if constants := [f'"{value}"' if isinstance(value, str) else str(value) for value in _constants(node)]:
        return listed(constants, "or")
    match node.get("type"):
        case "integer":
            return "a whole number" + _bounds(node, hexadecimal)
        case "number":
            return "a number" + _bounds(node, False)
        case "string" if node.get("minLength"):
            return "a non-empty string"
        case "array":
            return _describe_list(node, hexadecimal)
        case "object" if "properties" in node:
            return f"a table with {listed(list(node['properties']), 'and')}"
        case "object" if node.get("minProperties"):
            return "a non-empty table"
        case kind:
            return _PLAIN.get(kind or "", "a value")


def _describe_list(node: Schema, hexadecimal: bool) -> str:
    if fixed := node.get("prefixItems", []):
        # The members of the tuples in use are described alike.
        return f"a list of {len(fixed)} values, each {_describe(fixed[0], hexadecimal)}"
    least, most = node.get("minItems"), node.get("maxItems")
    count = f" of {most} values" if least == most and most else f" of at least {least}" if least else ""
    item = node.get("items", {})
    return f"a list{count}, each {_describe(item, hexadecimal)}" if "type" in item else f"a list{count}"


def _bounds(node: Schema, hexadecimal: bool) -> str:
    def shown(bound: float) -> str:
        if hexadecimal and bound >= 0:
            return f"0x{int(bound):X}"
        return exactly(bound) if node.get("type") == "number" else str(int(bound))

    low, high = node.get("minimum"), node.get("maximum")
    if low is None and node.get("type") == "integer" and "exclusiveMinimum" in node:
        low = node["exclusiveMinimum"] + 1
    if low is not None and high is not None:
        return f" from {shown(low)} to {shown(high)}"
    parts = [
        f"{words} {shown(node[key])}"
        for key, words in (
            ("minimum", "of at least"),
            ("exclusiveMinimum", "above"),
            ("maximum", "at most" if "exclusiveMinimum" in node else "of at most"),
            ("exclusiveMaximum", "below"),
        )
        if key in node
    ]
    return " " + " and ".join(parts) if parts else ""


def listed(words: list[str], last: str) -> str:
    """Return words as «a, b or c», with `last` before the last word."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"
