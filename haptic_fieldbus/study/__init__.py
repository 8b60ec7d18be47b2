"""Measurements of the package's own accuracy, stability and cost, written as one page."""
