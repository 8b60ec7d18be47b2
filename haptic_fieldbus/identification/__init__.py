"""Measurement of a bench: two experiments, and the fit of a shaft to a record."""
