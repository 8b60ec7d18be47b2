"""Measurements of the report: each module measures one thing and is independent of pages."""
