"""Measurements of accuracy, stability and cost of this package, as one page."""
