"""Oracles of the cases, written independently of all that they judge: they import numpy, `math` and each other alone.

For more digits than a float has they use `decimal`. No formula here is taken from the package, and no number.
"""
