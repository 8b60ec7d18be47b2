"""Description of drives and benches, independent of the protocol: profile, rig, power table, units."""
