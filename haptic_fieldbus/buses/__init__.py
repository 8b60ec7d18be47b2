"""Input and output on real buses: one folder for each protocol, all behind the `Bus` protocol."""
