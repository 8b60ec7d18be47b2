"""Measurements of this package, written as one page."""
