"""Assessment of a run: record, torque error, verdict and result."""
