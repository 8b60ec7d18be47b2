"""Recordings of runs: their provenance, and the formats of their rows."""
