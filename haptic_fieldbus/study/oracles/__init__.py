"""Oracles of the cases, independent of the judged code: they import only numpy, `math` and each other.

For more digits than a float has they use `decimal`. No formula and no number here comes from the package.
"""
