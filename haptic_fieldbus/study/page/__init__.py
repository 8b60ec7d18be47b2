"""The report as people read it: sections of text, tables and figures."""
