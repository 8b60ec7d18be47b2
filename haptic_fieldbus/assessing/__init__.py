"""What a run was: its record, torque error, verdict and result."""
