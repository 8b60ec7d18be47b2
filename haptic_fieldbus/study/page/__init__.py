"""Page of the report: sections of text, tables and figures."""
