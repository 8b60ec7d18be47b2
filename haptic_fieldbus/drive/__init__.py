"""Drives and benches in any protocol: profile, rig, power table, units."""
