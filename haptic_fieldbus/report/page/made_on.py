"""The section on the machine, and on how to make the report again."""

from html import escape

from haptic_fieldbus.report.page.html import Section, paragraph, table

HOW = """Times are those of this machine; errors, limits and stability are the same on any. Every number on this page
is also in <code>report.json</code> and <code>details.json</code> beside it, every figure in <code>figures/</code>."""


def made_on_section(host: dict[str, str], command: str, seconds: float) -> Section:
    """Hardware, versions, command and duration."""
    rows = [[key.replace("_", " "), value] for key, value in host.items()]
    rows.append(["report made in", f"{seconds:.1f} s"])
    body = paragraph(HOW) + paragraph(f"Made by <code>{escape(command)}</code>.")
    return Section("host", "Made on", body + table(("what", "which"), rows, text_columns=2))
