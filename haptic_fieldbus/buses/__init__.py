"""Input and output: one folder a protocol, each behind the same `Bus`."""
