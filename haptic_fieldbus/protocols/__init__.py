"""Fieldbus protocols for planning: mapped signals, layout, traffic."""
