"""Numbers in a text that are not written as `haptic_fieldbus.numerals` writes them."""

import re

PADDED_EXPONENT = re.compile(r"\d[eE](?:\+|-0)\d+")
GROUPED = re.compile(r"(?<![\w.,-])\d{1,3}(?:[ \u00a0\u2009\u202f,]\d{3})+(?![\w.,]*\w)")
TYPOGRAPHIC_MINUS = re.compile(r"(?<![\w)\]] )\u2212\d[\d.]*")


def strange_numbers(text: str, *, is_prose: bool = False) -> list[str]:
    """Return all numbers with a padded exponent or a plus in it, with grouped thousands or, but in prose, with −."""
    styles = (PADDED_EXPONENT, GROUPED) if is_prose else (PADDED_EXPONENT, GROUPED, TYPOGRAPHIC_MINUS)
    return [found for style in styles for found in style.findall(text)]
