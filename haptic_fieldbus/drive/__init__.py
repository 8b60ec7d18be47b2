"""What a drive offers, whatever its protocol: profile, rig, power table, units."""
