"""Input and output: one folder for each protocol, all behind the same `Bus`."""
